"""Trials of passivity, on all cores, into a file."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path

from hapticmech_ros.bench.feel.benchmark import LOOPS
from hapticmech_ros.bench.feel.passive.trial import Found, Trial, scene_of, tried
from hapticmech_ros.workers import worker_pool

JSON_NAME = "bench_passivity.json"
SECONDS = 60.0

Show = Callable[[str], None]


def trials(
    scenes: Sequence[str],
    devices: Sequence[str],
    hands: Sequence[str],
    delays: Sequence[float],
    seconds: float = SECONDS,
) -> list[Trial]:
    """Return a trial for every combination, with the loops closed in the device and over the link.

    Args:
        scenes: names or paths.
        devices: presets, or "scene".
        hands: names.
        delays: s, each way.
        seconds: s.
    """
    return [
        Trial(scene, device, hand, delay, local, seconds=seconds)
        for scene, device, hand, delay, local in product(
            scenes, devices, hands, delays, LOOPS.values()
        )
    ]


def run_passivity(asked: Sequence[Trial], out: Path, show: Show = lambda line: None) -> list[Found]:
    """Run trials, and write what came of them into ``out``.

    Args:
        asked: what to try.
        out: folder, made if it is not there.
        show: told of each trial that is over.

    Raises:
        SceneError: a scene that cannot be loaded.
        InvalidInputError: an unknown hand or device.
    """
    for trial in {(trial.scene, trial.device, trial.hand): trial for trial in asked}.values():
        scene_of(trial)
    found = []
    with worker_pool() as pool:
        for one in pool.map(tried, asked):
            found.append(one)
            show(_line(one))
    out.mkdir(parents=True, exist_ok=True)
    rows = [{**asdict(one), "passive": one.passive} for one in found]
    text = json.dumps(rows, indent=1, ensure_ascii=False)
    (out / JSON_NAME).write_text(text + "\n", encoding="utf-8")
    return found


def _line(found: Found) -> str:
    trial = found.trial
    where = "device" if trial.local else "controller"
    verdict = "passive" if found.passive else f"NOT passive {found.ended}".rstrip()
    return (
        f"{trial.scene}, {trial.device}, {trial.hand}, {1e3 * trial.delay:g} ms, loop in {where}: "
        f"{verdict}, {1e3 * found.lowest:.2f} mJ, {found.most_force:.1f} N"
    )
