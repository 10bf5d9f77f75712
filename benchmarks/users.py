# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m benchmarks.users``: what one user feels while another holds the mechanism.

One pushes a free device with a multisine, the other one holds the mechanism elsewhere, by an arm of
known impedance Z. With Y the admittance of the mechanism alone between both points, desired is

    v_a = (Y_aa - Y_ab Z (1 + Y_bb Z)⁻¹ Y_ba) F_a

where Y is that of the simulator's own step, linearised: see ``analysis/linear_point.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import typer

from hapticmech_ros import SharedSession, Simulator, load_scene
from hapticmech_ros.analysis.impedance import (
    PUSH_N_PER_HZ,
    amplitudes,
    free_directions,
    multisine,
)
from hapticmech_ros.analysis.linear_point import linear_point
from hapticmech_ros.arrays import Array
from hapticmech_ros.cli import run_app
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.hand import ArmHand, Waypoint

FREQUENCIES_HZ = np.array([1.0, 2.0, 3.0, 5.0, 7.0, 10.0])
PERIODS_S = (1e-3, 5e-4, 2.5e-4)
# Until what the start has set in motion has died away, and how long is looked at.
SETTLING_S, WINDOW_S = 4.0, 1.0
PUSHER, HOLDER = "a", "b"
ARM = ArmHand(kind="arm", impedance="firm", start_delay=0.0, waypoints=(Waypoint(time=0.0),))
# Of two links, or of both ends of one: (link, place in it, m).
POINTS = {
    "shared_payload": (("payload", (0.04, 0.0, 0.0)), ("payload", (-0.04, 0.0, 0.0))),
    "spatial_arm": (("hand", (0.0, 0.0, 0.06)), ("upper_arm", (0.0, 0.0, 0.2))),
    "stewart_platform": None,
}


@dataclass(frozen=True)
class Felt:
    """What is felt along one direction.

    Attributes:
        scene: its name.
        period: s.
        direction: (6,) of the push, largest part 1 N or 0.02 N m.
        matters: (k,) by how much the other arm changes what is felt, relative.
        error: (k,) size of felt over desired, less 1, complex.
    """

    scene: str
    period: float
    direction: Array
    matters: Array
    error: Array


def held_scene(name: str, period: float) -> Scene:
    """Return a scene held at two points, by nobody and by an arm."""
    scene = load_scene(name)
    point, places = scene.operational_points[0], POINTS[name]
    if places is None:
        x, y, z = point.origin.xyz
        places = ((point.link, (x + 0.05, y, z)), (point.link, (x - 0.05, y, z)))
    points = [
        {"name": label, "link": link, "origin": {"xyz": list(xyz)}}
        for label, (link, xyz) in zip((PUSHER, HOLDER), places, strict=True)
    ]
    hands = [
        {"point": PUSHER, "hand": {"kind": "constant_wrench"}},
        {"point": HOLDER, "hand": ARM},
    ]
    return scene.with_(operational_points=points, hands=hands, simulation={"period": period})


def felt(name: str, period: float) -> list[Felt]:
    """Return what is felt along every free direction."""
    scene = held_scene(name, period)
    simulator = Simulator(scene)
    terms = simulator.evaluate(simulator.initial_state())
    directions = free_directions(Analyser(simulator.mechanism, PUSHER).analyse(terms))
    times = np.arange(round((SETTLING_S + WINDOW_S) / period)) * period
    push = multisine(times, FREQUENCIES_HZ, PUSH_N_PER_HZ * FREQUENCIES_HZ)
    calm, (held, alone) = _twists(scene, np.zeros((times.size, 6))), _desired(simulator)
    window, found = times >= SETTLING_S - 0.5 * period, []
    given = amplitudes(times, push, FREQUENCIES_HZ)
    for direction in directions:
        moved = (_twists(scene, push[:, None] * direction) - calm)[window] @ direction
        answer = amplitudes(times[window], moved, FREQUENCIES_HZ) / given
        wanted, free = (np.einsum("i,kij,j->k", direction, one, direction) for one in (held, alone))
        error, matters = np.abs(wanted / answer - 1.0), np.abs(free / wanted - 1.0)
        found.append(Felt(name, period, direction, matters, error))
    return found


def _twists(scene: Scene, pushes: Array) -> Array:
    """Return twists (n, 6) of the device that is pushed."""
    session = SharedSession(scene)
    return np.array(
        [session.tick(hand_wrenches={PUSHER: one})[PUSHER].device.twist for one in pushes]
    )


def _desired(simulator: Simulator) -> tuple[Array, Array]:
    """Return admittances (k, 6, 6) of the point pushed: with the arm at the other, and without."""
    state = simulator.initial_state()
    points = [linear_point(simulator, state, name) for name in (PUSHER, HOLDER)]
    step, period = points[0].step, simulator.period
    push = np.hstack([point.push for point in points])
    twist = np.vstack([point.twist for point in points])
    parts = (
        (ARM.mass, ARM.angular_inertia),
        (ARM.damping, ARM.angular_damping),
        (ARM.stiffness, ARM.angular_stiffness),
    )
    mass, damping, stiffness = (np.diag([line] * 3 + [turn] * 3) for line, turn in parts)
    held, alone = [], []
    for s in 2j * np.pi * FREQUENCIES_HZ:
        z = np.exp(s * period) * np.eye(len(step)) - step
        y = twist @ np.linalg.solve(z, push)
        arm = s * mass + damping + stiffness / s
        back = np.linalg.solve(np.eye(6) + y[6:, 6:] @ arm, y[6:, :6])
        alone.append(y[:6, :6])
        held.append(y[:6, :6] - y[:6, 6:] @ arm @ back)
    return np.array(held), np.array(alone)


def table(found: Sequence[Felt]) -> str:
    """Return the largest errors of each scene and period as a table for a document."""
    heads = " | ".join(f"{f:g} Hz" for f in FREQUENCIES_HZ)
    lines = [
        f"| scene | period, ms | directions | {heads} | arm matters by |",
        f"|---|--:|--:|{'--:|' * len(FREQUENCIES_HZ)}--:|",
    ]
    for key in dict.fromkeys((one.scene, one.period) for one in found):
        rows = [one for one in found if (one.scene, one.period) == key]
        worst = np.max([one.error for one in rows], axis=0)
        errors = " | ".join(f"{100.0 * error:.2g} %" for error in worst)
        least = min(float(one.matters.min()) for one in rows)
        most = max(float(one.matters.max()) for one in rows)
        share = f"{100.0 * least:.0f} to {100.0 * most:.0f} %"
        lines.append(f"| `{key[0]}` | {1e3 * key[1]:g} | {len(rows)} | {errors} | {share} |")
    return "\n".join(lines)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def users() -> None:
    """Push beside another user's arm, and print by how much what is felt is off."""
    print(table([one for name in POINTS for period in PERIODS_S for one in felt(name, period)]))


if __name__ == "__main__":
    run_app(app)
