# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Z-width: the stiffest stable joint constraint over its damping.

Position channels are off, so that the wall alone is tested: along the constrained directions n_i
the device is coupled to a mechanism that does not move. The signal is the velocity of the device
relative to the operational point, n_iᵀ ė / √m_ℓ, in m/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.analysis.linear_loop import (
    NOBODY,
    diverges,
    held_by,
    law_of,
    tick_matrix,
)
from hapticmech_ros.analysis.penetration import directions
from hapticmech_ros.analysis.scene_variants import (
    at_once,
    held_by_nobody,
    held_still,
    with_constraint,
    without_channel,
)
from hapticmech_ros.analysis.stability_rules import (
    FINE,
    delayed_stiffness,
    frontier,
    passive_stiffness,
)
from hapticmech_ros.analysis.touch import Observe, Setup, touched
from hapticmech_ros.arrays import Array
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.architecture import device_inertia
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Sample

# Dampings as shares of the one that is unstable without stiffness.
Z_WIDTH_SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)
# Relative speed of the device after the touch, m/s: commands stay within the device's limits, slew
# included, also at the stiffest walls; rounding is four orders of magnitude below it.
TOUCH_SPEED = 2e-5
# m/s; a decaying oscillation stays near the speed of the touch.
LOST_SPEED = 20.0 * TOUCH_SPEED
# Length of the response: cycles of the wall's oscillation, multiples of the loop's delay, and its
# bounds in ticks.
CYCLES, DELAYS = 10.0, 60
SHORTEST, LONGEST = 300, 8000
# Range of the search, N/m.
SOFTEST, STIFFEST = 1e-2, 1e8


@dataclass(frozen=True, slots=True)
class ZPoint:
    """The stiffest stable joint constraint at one damping.

    Attributes:
        scene: its name.
        rate_hz: of the loop.
        delay: periods from measuring to acting.
        hand: ``nobody``, or ``still`` for the scene's hand at the pose of grasp.
        loop: where the wall is closed: ``device`` or ``controller``.
        damping: b of the joint constraint, N s/m.
        mass: of the device along the direction that is unstable first, kg per unit of P_c.
        measured: k, N/m, from sessions; None if even the softest wall is unstable.
        predicted: k, N/m, at which the linear model of the loop has an eigenvalue on the unit
            circle; None as above, or for a nonlinear hand.
        rule: k, N/m, (b + B) / (T / 2 + t_d).
        passive: k, N/m, up to which the wall is passive by Colgate and Schenkel.
    """

    scene: str
    rate_hz: float
    delay: int
    hand: str
    loop: str
    damping: float
    mass: float
    measured: float | None
    predicted: float | None
    rule: float
    passive: float


class Wall:
    """The joint constraints of a scene at its start.

    Args:
        scene: with a joint constraint at its start.
        point: operational point; the first one if empty.

    Attributes:
        scene: without ramp and position channels.
        mass: of the device along the direction with the largest gain, 1 / λ_max(Λ_d⁻¹ P_c), kg.
        physical: damping of the device along it, N s/m per unit of P_c.
        local: whether the device closes the wall.

    Raises:
        InvalidInputError: a scene without a constraint at its start.
    """

    def __init__(self, scene: Scene, point: str = "") -> None:
        self.scene, self._point = without_channel(at_once(scene)), point
        self.local = scene.controller.joint_constraint.local
        found = directions(self.scene, point)
        self._analysis, self._normals = found.analysis, found.held
        if not self._normals.size:
            raise InvalidInputError(
                "scene", scene.name, "must have a joint constraint at its start"
            )
        mobility = np.linalg.inv(device_inertia(scene.device))
        gain = self._normals.T @ mobility @ self._normals
        sizes, ways = np.linalg.eigh(gain)
        self.mass = 1.0 / float(sizes[-1])
        shape = mobility @ self._normals @ ways[:, -1]
        loss = np.array([scene.device.damping] * 3 + [scene.device.angular_damping] * 3)
        self.physical = float(shape @ (loss * shape)) * self.mass**2
        wrench = self._normals @ np.linalg.solve(gain, np.ones(len(sizes)))
        self._push = wrench * TOUCH_SPEED / np.sqrt(len(sizes))

    def observe(self) -> Observe:
        """Return the signal of a sample: n_iᵀ ė / √m_ℓ, m/s."""
        normals = self._normals.T

        def watch(sample: Sample) -> Array:
            return np.asarray(normals @ (sample.device.twist - sample.point.twist))

        return watch

    def stable(self, stiffness: float, damping: float, delay: int, hand: str) -> bool:
        """Return whether a session with these gains comes to rest after a touch.

        Args:
            stiffness: of the joint constraint, N/m.
            damping: of it, N s/m.
            delay: periods.
            hand: ``nobody`` or ``still``.
        """
        scene = self._with(stiffness, damping, hand)
        period = scene.simulation.period
        cycle = 2.0 * np.pi / np.sqrt(stiffness / self.mass) / period
        ticks = int(np.clip(CYCLES * cycle, max(SHORTEST, DELAYS * (delay + 1)), LONGEST))
        push = self._push / period
        setup = Setup(scene, self._point, delay)
        return touched(setup, push, self.observe(), ticks, LOST_SPEED).stable

    def predicted(self, damping: float, delay: int, hand: str) -> float | None:
        """Return the stiffness, N/m, at which the linear model of the loop becomes unstable."""
        held = NOBODY if hand == "nobody" else held_by(self.scene)
        if held is None:
            return None
        model = operational_model_of(self._analysis)

        def stable(stiffness: float) -> bool:
            scene = self._with(stiffness, damping, hand)
            law = law_of(ControlArchitecture(scene), model)
            rows, x = self._analysis.rows, model.inverse_inertia
            return not diverges(tick_matrix(scene, law, x, rows, delay, held))

        period = self.scene.simulation.period
        guess = damping / (period * (0.5 + self.late(delay)))
        return frontier(stable, guess, SOFTEST, STIFFEST, FINE)

    def late(self, delay: int) -> int:
        """Return the delay of the wall, periods, in a loop with a delay of ``delay`` periods."""
        return 0 if self.local else delay

    def most_damping(self, delay: int) -> float:
        """Return B, N s/m, at which a damper alone is unstable: T B / m = 2 sin(π / (4 d + 2)).

        d is the delay of the wall, :meth:`late`.

        Raises:
            InvalidInputError: a delay below 0.
        """
        if delay < 0:
            raise InvalidInputError("delay", delay, "must be 0 or more periods")
        largest = 2.0 * np.sin(np.pi / (4 * self.late(delay) + 2))
        return float(self.mass * largest / self.scene.simulation.period)

    def _with(self, stiffness: float, damping: float, hand: str) -> Scene:
        scene = with_constraint(self.scene, stiffness, damping)
        return held_by_nobody(scene) if hand == "nobody" else held_still(scene)


def z_width(
    scene: Scene,
    point: str = "",
    delay: int = 1,
    hand: str = "nobody",
    shares: Sequence[float] = Z_WIDTH_SHARES,
) -> list[ZPoint]:
    """Return the stiffest stable joint constraint at each damping.

    Args:
        scene: with a joint constraint at its start, with any device and hand.
        point: operational point; the first one if empty.
        delay: periods from measuring to acting.
        hand: ``nobody``, or ``still`` for the scene's.
        shares: dampings as shares of the one that is unstable without stiffness.

    Raises:
        InvalidInputError: no constraint, a delay below 0, another hand, or a share outside (0, 1).
    """
    if hand not in ("nobody", "still"):
        raise InvalidInputError("hand", hand, "must be nobody or still")
    for share in shares:
        if not 0.0 < share < 1.0:
            raise InvalidInputError("share of damping", share, "must be between 0 and 1")
    wall, period = Wall(scene, point), scene.simulation.period
    found = []
    for share in shares:
        damping = share * wall.most_damping(delay)
        rule = delayed_stiffness(wall.physical, damping, period, wall.late(delay) * period)
        predicted = wall.predicted(damping, delay, hand)
        measured = frontier(
            lambda stiffness, b=damping: wall.stable(stiffness, b, delay, hand),  # type: ignore[misc]
            rule,
            SOFTEST,
            STIFFEST,
        )
        passive = passive_stiffness(wall.physical, damping, period)
        loop = "device" if wall.local else "controller"
        found.append(
            ZPoint(
                *(scene.name, 1.0 / period, delay, hand, loop, damping, wall.mass),
                *(measured, predicted, rule, passive),
            )
        )
    return found
