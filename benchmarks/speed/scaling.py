# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a step costs over size: rows of parallelograms, chains, and platforms on many legs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.accuracy.n_four_bar import n_four_bar
from benchmarks.speed.contender import Method, Peer, initial_state
from benchmarks.speed.equality import Check, check
from benchmarks.speed.platform import stewart_platform
from benchmarks.speed.problems import Problem
from benchmarks.speed.reference import parallelograms, reference
from benchmarks.speed.result import timed, timed_in_turn, warm_up
from hapticmech_ros.analysis.study import Show, silent
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene, scene_from_document

SIZES = {"windows": (10, 20, 40, 80), "chain": (10, 20, 40, 80), "platform": (6, 12, 24, 48)}
TITLES = {
    "windows": "A02, N parallelograms",
    "chain": "chain of N rods",
    "platform": "platform on N legs",
}
# s, until which all are compared, and step of the timing.
COMPARED, STEP = 0.1, 1e-3
# Integrators whose steps do the same work are compared: four evaluations of the dynamics, and the
# peers' cheapest besides.
RULES = ("rk4", "discrete")

LARGEST = 200
LENGTH, MASS = 1.0, 1.0


@dataclass(frozen=True, slots=True)
class Growth:
    """CPU time of a step over size.

    Attributes:
        family: one of ``SIZES``.
        peer, method: names.
        sizes: N.
        cpu_s_per_step: s, median at each size; None where the check was not passed.
    """

    family: str
    peer: str
    method: str
    sizes: tuple[int, ...]
    cpu_s_per_step: tuple[float | None, ...]

    @property
    def exponent(self) -> float | None:
        """Slope of log time over log size; None unless all sizes are known."""
        known = [cpu for cpu in self.cpu_s_per_step if cpu is not None]
        if len(known) < max(len(self.sizes), 2):
            return None
        return float(np.polyfit(np.log(self.sizes), np.log(known), 1)[0])


def sized(family: str, size: int) -> Problem:
    """Return a mechanism of size N with its reference at 0.1 s."""
    times, (point, build) = (COMPARED,), _FAMILIES[family]
    scene = build(size)
    problem = Problem(
        scene.name,
        TITLES[family],
        lambda: scene,
        times,
        "point",
        (point,),
        (0, 1),
        STEP,
        large=True,
    )
    if family == "windows":
        readings = parallelograms(size, times)
    else:
        readings, _ = reference(scene, problem.outputs)
    return replace(problem, values=(tuple(tuple(reading[0]) for reading in readings),))


def growth(
    peers: Sequence[Peer],
    sizes: Mapping[str, Sequence[int]] = SIZES,
    repeats: int = 5,
    budget_s: float = 0.2,
    show: Show = silent,
) -> tuple[tuple[Growth, ...], tuple[Check, ...]]:
    """Check every peer at every size, then time its steps in turn with the others'."""
    racers = [(p, m) for p in peers for m in p.methods if m.name in RULES]
    found: dict[tuple[str, str, str], list[float | None]] = defaultdict(list)
    checks: list[Check] = []
    for family, numbers in sizes.items():
        for size in numbers:
            show(f"{TITLES[family]}: N = {size}")
            problem = sized(family, size)
            seen = [check(problem, peer, method) for peer, method in racers]
            checks += seen
            fit = [one for one, verdict in zip(racers, seen, strict=True) if verdict.passed]
            times = _times(problem.scene, fit, repeats, budget_s)
            for peer, method in racers:
                time = times.get((peer.name, method.name))
                found[family, peer.name, method.name].append(time)
    grown = tuple(Growth(*key, tuple(sizes[key[0]]), tuple(cpu)) for key, cpu in found.items())
    return grown, tuple(checks)


def _times(
    scene: Scene, racers: Sequence[tuple[Peer, Method]], repeats: int, budget_s: float
) -> dict[tuple[str, str], float]:
    start, ready = initial_state(scene), {}
    for peer, method in racers:
        contender = peer.contender(scene, start, method, STEP, method.settings_for(scene)[-1])
        warm_up(contender)
        cost_s = max(timed(contender, 5) / 5, 1e-7)
        # So few that no motion is lost, whatever the setting.
        steps = max(3, min(round(COMPARED / STEP), round(budget_s / cost_s)))
        ready[peer.name, method.name] = contender, steps
    found = timed_in_turn(ready, repeats)
    return {name: float(np.median(times)) for name, times in found.items()}


def chain(links: int) -> Scene:
    """Return a chain of uniform rods (1 kg, 1 m) on hinges about z, let go level.

    The point ``tip`` is the last rod's free end; gravity along -y. Rods start a little bent, one to
    the other side of the next, so that all joints move from the start.

    Raises:
        InvalidInputError: ``links`` is not from 1 to 200.
    """
    if not 1 <= links <= LARGEST:
        raise InvalidInputError("links", links, f"must be from 1 to {LARGEST}")
    return scene_from_document(_document(links), source=f"chain({links})")


def _document(links: int) -> dict[str, Any]:
    moments = dict.fromkeys(("ixx", "iyy", "izz"), MASS * LENGTH**2 / 12.0)
    rod = {"mass": MASS, "com": [0.5 * LENGTH, 0.0, 0.0], "inertia": moments}
    return {
        "format": "hapticmech-scene/1",
        "name": f"chain_{links}",
        "description": f"A chain of {links} rods",
        "task_space": "planar",
        "gravity": [0.0, -9.81, 0.0],
        "links": [
            {
                "name": f"rod{k}",
                "parent": f"rod{k - 1}" if k else "world",
                "joint": {
                    "name": f"hinge{k}",
                    "type": "revolute",
                    "origin": {"xyz": [LENGTH if k else 0.0, 0.0, 0.0]},
                },
                "inertial": rod,
            }
            for k in range(links)
        ],
        "operational_points": [
            {"name": "tip", "link": f"rod{links - 1}", "origin": {"xyz": [LENGTH, 0.0, 0.0]}}
        ],
        "initial_state": {"q": {f"hinge{k}": 0.1 * (-1.0) ** k for k in range(links)}},
        "hand": {"kind": "constant_wrench"},
    }


# Point that is compared, and mechanism of a size.
_FAMILIES: dict[str, tuple[str, Callable[[int], Scene]]] = {
    "windows": ("b0", n_four_bar),
    "chain": ("tip", chain),
    "platform": ("rim", stewart_platform),
}
