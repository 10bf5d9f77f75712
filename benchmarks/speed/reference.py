# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reference motions by other means than this package's dynamics and integrators.

Rows of parallelograms are one equation for one angle. The others are Pinocchio's dynamics under an
adaptive rule of order 8, computed twice, with other tolerances and another pull on the closures:
both have to agree. ``python -m benchmarks.speed.reference`` writes what is stored; names of scenes
behind it limit it to these.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from benchmarks.accuracy.cases import Output
from benchmarks.speed.contender import Reading, State, initial_state
from benchmarks.speed.pinocchio_peer import PinocchioDynamics, local_rates
from benchmarks.speed.problems import ASKED, PATH, Problem
from benchmarks.words import refuse_unknown
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene

COMMAND = "python -m benchmarks.speed.reference"
# Both ways agree to this, m or rad.
AGREEMENT = 1e-10
# Relative and absolute tolerance, and pull a on the closures (1/s), of the two ways.
WAYS = ((3e-14, 5.0), (2e-13, 20.0))
SOFTNESS, ACCURACY, ITERATIONS = 1e-9, 1e-14, 100
# Of the duration: between two, coordinates are counted from a new origin.
SEGMENTS = 100
GRAVITY = 9.81


def reference(scene: Scene, outputs: Sequence[Output]) -> tuple[list[Reading], float]:
    """Return what outputs are at their times, and how far the two ways are apart, m or rad.

    Args:
        scene: what moves.
        outputs: all of the same times, s; their values are not used.

    Raises:
        HapticMechError: the two ways are further apart than 1e-10, or the solver gave up.
    """
    return _agreed(scene.name, *(_motion(scene, outputs, *way) for way in WAYS))


def parallelograms(windows: int, times: Sequence[float], tolerance: float = 3e-14) -> list[Reading]:
    """Return the position (x, y) of ``b0`` of A02: N + 1 uprights turn by θ, N tops move along.

    ((N + 1)/3 + N) θ̈ = -g ((N + 1)/2 + N) cos θ, from θ = π/2, θ̇ = -1 rad/s; rods of 1 kg, 1 m.
    """
    uprights = windows + 1
    pull = GRAVITY * (uprights / 2.0 + windows) / (uprights / 3.0 + windows)
    state, begun = np.array([np.pi / 2.0, -1.0]), 0.0
    found: list[Reading] = []
    for end in times:
        # A run for each: values between steps would be of lower order.
        run = solve_ivp(
            lambda _, y: (y[1], -pull * np.cos(y[0])),
            (begun, end),
            state,
            method="DOP853",
            rtol=tolerance,
            atol=tolerance,
        )
        state, begun = run.y[:, -1], end
        found.append([(float(np.cos(state[0])), float(np.sin(state[0])))])
    return found


def _motion(
    scene: Scene, outputs: Sequence[Output], tolerance: float, pull: float
) -> list[Reading]:
    dynamics = PinocchioDynamics(scene, pull, SOFTNESS, ACCURACY, ITERATIONS)
    model, state = dynamics.model, initial_state(scene)
    times, found, begun = outputs[0].times, [], 0.0
    for end in times:
        parts = max(1, round(SEGMENTS * (end - begun) / times[-1]))
        for _ in range(parts):
            state = _segment(dynamics, model, state, (end - begun) / parts, tolerance)
        found.append(dynamics.read(state.q, outputs))
        begun = end
    return found


def _segment(
    dynamics: PinocchioDynamics, model: pin.Model, start: State, span: float, tolerance: float
) -> State:
    size = model.nv

    def rates(_: float, y: Array) -> Array:
        theta, v = y[:size], y[size:]
        accel = dynamics.acceleration(pin.integrate(model, start.q, theta), v)
        return np.concatenate((local_rates(dynamics.tree, theta, v), accel))

    first = np.concatenate((np.zeros(size), start.v))
    options = {"rtol": tolerance, "atol": tolerance}
    found = solve_ivp(rates, (0.0, span), first, method="DOP853", **options)
    if not found.success:
        raise HapticMechError(f"no reference: {found.message}")
    end = found.y[:, -1]
    return State(pin.integrate(model, start.q, end[:size]), end[size:])


def _agreed(name: str, one: list[Reading], other: list[Reading]) -> tuple[list[Reading], float]:
    apart = max(
        float(np.abs(np.array(first) - np.array(second)).max())
        for firsts, seconds in zip(one, other, strict=True)
        for first, second in zip(firsts, seconds, strict=True)
    )
    if not apart <= AGREEMENT:
        raise HapticMechError(f"{name}: two references differ by {apart:.1e}")
    return one, apart


def write(names: Sequence[str] = (), path: Path = PATH) -> None:
    """Compute references anew and store them.

    Args:
        names: of scenes; all if empty. What is stored of others stays.
        path: of the file.

    Raises:
        InvalidInputError: no such scene.
    """
    refuse_unknown("scene", names, [asked.name for asked in ASKED])
    known = json.loads(path.read_text(encoding="utf-8"))["cases"]
    stored: dict[str, dict[str, Any]] = {one["name"]: one for one in known}

    def entry(asked: Problem) -> dict[str, Any]:
        if names and asked.name not in names:
            return stored[asked.name]
        if asked.windows:
            ways = (parallelograms(asked.windows, asked.times, way[0]) for way in WAYS)
            values, apart = _agreed(asked.name, *ways)
        else:
            values, apart = reference(asked.scene, asked.outputs)
        per_output = [[list(reading[k]) for reading in values] for k in range(len(values[0]))]
        return {"name": asked.name, "times": asked.times, "values": per_output, "apart": apart}

    text = json.dumps({"command": COMMAND, "cases": [*map(entry, ASKED)]}, indent=1)
    path.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(sys.argv[1:])
