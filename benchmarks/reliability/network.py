# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph over a real path: delay, jitter, loss, reordering, outages, clocks that differ."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from functools import partial
from itertools import chain
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from benchmarks.reliability.emulated_network import EmulatedNetwork, Path
from benchmarks.reliability.figure import Figure
from benchmarks.reliability.split_graph import NODE, SplitGraph, Watched, of_one_user, run_for
from hapticmech_ros.analysis.passivity import Trial, scene_of
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import document_of
from hapticmech_ros.scene.controller import Connection
from hapticmech_ros.session import Session

SCENE = "five_bar"
DELAYS = (0.0, 0.01, 0.05)
KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "20 % jitter": {"jitter": 0.2},
    "5 % loss": {"loss": 0.05},
    "5 % reordered": {"reordered": 0.05},
    "all of it": {"jitter": 0.2, "loss": 0.05, "reordered": 0.05},
}
# The longer one is more than after what the hosts forget each other, 5 s.
OUTAGE_S, LONG_OUTAGE_S = 2.0, 8.0
CLOCK_AHEAD_S = -3.0
# Declared where the path adds nothing by itself: a network is there.
NO_DELAY = 0.0005
ENGAGED, FORCE_RATIO, ENERGY_J, MARGIN_S, BACK_S = 0.99, 1.5, -1e-3, 0.02, 1.0
# Answers to samples that were sent before only these stopped.
ONE_WAY_MARGIN_S = 0.04
# Simulated connections whose largest forces are compared.
SEEDS = 9


def run(quick: bool, out: FilePath) -> list[Figure]:
    """Return the figures of this part.

    Args:
        quick: a few short trials instead of all.
        out: folder for logs and what was watched.

    Raises:
        NoNetworkError: no network can be emulated here.
    """
    seconds, outages = (6.0, 1) if quick else (60.0, 5)
    kinds, delays = (["all of it"], (0.01, 0.05)) if quick else (list(KINDS), DELAYS)
    paths = (_path(delay, kind, seconds, out) for delay in delays for kind in kinds)
    figures = list(chain.from_iterable(paths))
    for delay in (0.05,) if quick else DELAYS:
        figures += _outage(delay, "plain", outages, out)
    figures += _outage(0.05, "plain", outages, out, one_way=True)
    figures += _outage(0.05, "plain", 1, out, LONG_OUTAGE_S)
    figures += _path(0.05, "plain", seconds, out, also="not declared", declared=False)
    behind = f"the device's clock {-CLOCK_AHEAD_S:g} s behind"
    device = (sys.executable, "-m", "benchmarks.reliability.shifted_clock", str(CLOCK_AHEAD_S))
    figures += _path(0.01, "plain", seconds, out, also=behind, device=device)
    firm = _firm_arm(seconds, out)
    return [*figures, *_path(0.05, "all of it", seconds, out, "a firm arm", scene=firm)]


def _firm_arm(seconds: float, out: FilePath) -> str:
    """Return a scene's file: an arm that holds firmly and moves, walls of 2000 N/m."""
    firm = scene_of(Trial(SCENE, hand="firm", seconds=seconds))
    scene = firm.model_copy(update={"connection": Connection()})
    file = out / "a_firm_arm.yaml"
    out.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(document_of(scene)), encoding="utf-8")
    return str(file)


def simulated_force(delay: float, kind: str, seconds: float, name: str = SCENE) -> float:
    """Return the largest force (N) over a simulated connection of the same delay, for as long.

    The median of some connections: where delays are random, so is the largest force.
    """
    path, scene, largest = Path(delay, **KINDS[kind]), load_scene(name), []
    for seed in range(1, 1 + (SEEDS if path.jitter or path.loss else 1)):
        late = Connection(delay=delay, jitter=path.jitter, loss=path.loss, seed=seed)
        session = Session(scene.model_copy(update={"connection": late}))
        ticks = range(round(seconds / session.period))
        largest.append(max(np.linalg.norm(session.tick().device.applied[:3]) for _ in ticks))
    return float(np.median(largest))


def _watched(
    name: str,
    path: Path,
    seconds: float,
    out: FilePath,
    outages: tuple[float, ...] = (),
    device: tuple[str, ...] = NODE,
    scene: str = SCENE,
    lasts: float = OUTAGE_S,
    one_way: bool = False,
    declared: bool = True,
) -> tuple[Watched, list[float]]:
    """Run a graph over a path that is declared as it is; return also when it was cut and mended."""
    given = {"network_delay": path.delay or NO_DELAY} if declared else {}
    nothing = Path(out=True)
    with EmulatedNetwork(path, path) as network:
        cut = partial(network.set, to_rest=nothing, to_device=path if one_way else nothing)
        mend = partial(network.set, path)
        events = [event for at in outages for event in ((at, cut), (at + lasts, mend))]
        with SplitGraph(network, out / name, of_one_user(scene, given, device)) as graph:
            made = run_for(graph, seconds, events)
            return graph.watched()[""], made


def _path(
    delay: float,
    kind: str,
    seconds: float,
    out: FilePath,
    also: str = "",
    scene: str = SCENE,
    device: tuple[str, ...] = NODE,
    declared: bool = True,
) -> Iterator[Figure]:
    name = ", ".join(filter(None, (f"{1e3 * delay:g} ms", kind, also)))
    folder, path = name.replace(" ", "_"), Path(delay, **KINDS[kind])
    seen, _ = _watched(folder, path, seconds, out, scene=scene, device=device, declared=declared)
    most = FORCE_RATIO * simulated_force(delay, kind, seconds, scene)
    took = f"passivity control took {seen.dissipated.max():.2g} J"
    yield Figure(f"{name}: largest force", float(seen.force.max()), "N", most, None, 1, took)
    if not declared:
        # Gains are reduced then, and that is said.
        said = bool(seen.figure("teleoperation_controller", "loop_warning"))
        yield Figure(f"{name}: said", 100.0 * said, "%", None, 100.0, 1)
        return
    held = f"held {seen.figure('haptic_device', 'times_held')}×"
    yield Figure(f"{name}: engaged", seen.engaged(), "", None, ENGAGED, 1, held)
    yield Figure(f"{name}: least E_h", float(seen.from_hand.min()), "J", None, ENERGY_J, 1)


def _outage(
    delay: float,
    kind: str,
    count: int,
    out: FilePath,
    lasts: float = OUTAGE_S,
    one_way: bool = False,
) -> Iterator[Figure]:
    path, every = Path(delay, **KINDS[kind]), lasts + 3.0
    way = " to the controller" if one_way else ""
    name = f"{1e3 * delay:g} ms, {kind}, {lasts:g} s of total loss{way}"
    starts = tuple(3.0 + every * index for index in range(count))
    folder = f"outage_{1e3 * delay:g}_ms_{lasts:g}_s{way.replace(' ', '_')}"
    seconds = starts[-1] + every
    seen, made = _watched(folder, path, seconds, out, starts, lasts=lasts, one_way=one_way)
    cut, mended = made[::2], made[1::2]
    zero = max(seen.zero_after(a, b) for a, b in zip(cut, mended, strict=True))
    back = max(seen.back_after(b) for b in mended)
    within = 2.0 * delay + ONE_WAY_MARGIN_S if one_way else delay + MARGIN_S
    yield Figure(f"{name}: zero force within", 1e3 * zero, "ms", 1e3 * within, None, count)
    yield Figure(f"{name}: back within", back, "s", BACK_S, None, count)
    yield Figure(f"{name}: least E_h", float(seen.from_hand.min()), "J", None, ENERGY_J, 1)
