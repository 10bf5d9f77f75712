# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""M-width: the lightest and the heaviest mechanism that a device renders stably.

The mechanism's inertias are scaled, and with them the felt inertia X⁻¹. The hand is a mass rigidly
fixed to the device, or the scene's own hand, which stays where it took hold. Stability is judged by
the command to the device: if the loop is unstable, the actuators' limits lead to a limit cycle,
which is less visible in the hand's force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.analysis.impedance import TORQUE_UNIT
from hapticmech_ros.analysis.linear_loop import Held, diverges, held_by, law_of, tick_matrix
from hapticmech_ros.analysis.scene_variants import (
    at_once,
    held_by_nobody,
    held_still,
    scaled,
)
from hapticmech_ros.analysis.stability_rules import FINE, frontier, lightest_mass
from hapticmech_ros.analysis.touch import MassHeldDevice, Setup, touched
from hapticmech_ros.arrays import Array
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.architecture import device_inertia
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Sample, Session

# N, of the push of one period, or of G times the push if that is larger, so that no limit is
# reached; a decaying command stays near it.
TOUCH_N = 0.5
LOST_N = 8.0 * TOUCH_N
# Length of the response, s: with a mass fixed to the device, which reacts within samples; with the
# scene's hand, which oscillates; and of the scene's hand with a heavy mechanism.
WATCHED_S, SWINGING_S, SLOW_S = 0.6, 2.0, 6.0
# Range of the search, felt over device inertia.
LIGHTEST, HEAVIEST = 1e-3, 300.0
HEAVY = (10.0, 100.0, HEAVIEST)


@dataclass(frozen=True, slots=True)
class MPoint:
    """The lightest and the heaviest felt inertia of a scene, over the device's.

    Inertias are 1 / λ_max(Λ_d X): along the direction that is felt lightest.

    Attributes:
        scene: its name.
        delay: periods from measuring to acting.
        local: whether the device closes the force channel.
        hand: ``mass`` or ``scene``.
        share: mass of the hand over that of the device; 0 for the scene's hand.
        own: felt inertia of the unscaled mechanism.
        measured: lightest stable inertia, from sessions.
        predicted: lightest stable inertia by eigenvalues of the linear model; None for a nonlinear
            hand.
        rule: m_a / (m_d + 2 m_a) for a hand with mass; None for the scene's hand.
        heaviest: heaviest stable inertia of 10, 100 and 300 times the device's; 0 if none is.
    """

    scene: str
    delay: int
    local: bool
    hand: str
    share: float
    own: float
    measured: float | None
    predicted: float | None
    rule: float | None
    heaviest: float


def m_width(scene: Scene, point: str = "", delay: int = 1, share: float | None = 1.0) -> MPoint:
    """Return the lightest and the heaviest stable felt inertia.

    Args:
        scene: with any device; its ``controller.force_channel.local`` is kept.
        point: operational point; the first one if empty.
        delay: periods from measuring to acting.
        share: mass of a hand fixed to the device over the device's; None for the scene's hand.

    Raises:
        InvalidInputError: a negative share, a delay below 0, or a scene's hand that does not hold
            at a place: the device then never comes to rest.
    """
    if share is None and "waypoints" not in type(scene.hand).model_fields:
        raise InvalidInputError("hand", scene.hand.kind, "must hold the device at a place")
    case = _Case(scene, point, delay, share)
    # The search is over 1 / inertia, of which large values are unstable.
    guess = 1.0 if share in (None, 0.0) else 1.0 / lightest_mass(1.0, share or 0.0)
    bounds = 1.0 / HEAVIEST, 1.0 / LIGHTEST
    watched = WATCHED_S if share is not None else SWINGING_S
    measured = frontier(lambda lightness: case.stable(lightness, watched), guess, *bounds)
    predicted = frontier(case.predicted, guess, *bounds, FINE) if case.linear else None
    seconds = SLOW_S if share is None else WATCHED_S
    heavy = [one for one in HEAVY if case.stable(1.0 / one, seconds)]
    return MPoint(
        scene=scene.name,
        delay=delay,
        local=scene.controller.force_channel.local,
        hand="scene" if share is None else "mass",
        share=share or 0.0,
        own=case.own,
        measured=None if measured is None else case.felt(measured),
        predicted=None if predicted is None else case.felt(predicted),
        rule=None if share is None else lightest_mass(1.0, share),
        heaviest=max(heavy, default=0.0),
    )


class _Case:
    def __init__(self, scene: Scene, point: str, delay: int, share: float | None) -> None:
        self._scene = at_once(held_still(scene) if share is None else held_by_nobody(scene))
        self._point, self._delay, self._share = point, delay, share
        self._analysis = Session(self._scene, point).tick().analysis
        inertia = self._inertia = device_inertia(scene.device)
        x = self._analysis.inverse_inertia
        self.own = 1.0 / float(np.linalg.eigvals(inertia @ x).real.max())
        zero = np.zeros((6, 6))
        fixed = None if share is None else Held(zero, zero, share * inertia)
        self._held = held_by(self._scene) if fixed is None else fixed
        found = self._analysis
        free = found.spectrum.wrenches[:, found.weights < 1.0].sum(axis=1)
        self._push = np.zeros(6)
        self._push[found.rows] = free
        self._push *= TOUCH_N / _size(self._push)

    @property
    def linear(self) -> bool:
        """Whether the hand has a linear impedance."""
        return self._held is not None

    def stable(self, lightness: float, seconds: float) -> bool:
        """Return whether a session with a mechanism this light comes to rest after a touch."""
        scene, share = self._scaled(lightness), self._share
        device = None if share is None else lambda one: MassHeldDevice(one, share)
        setup = Setup(scene, self._point, self._delay, device=device)
        ticks = round(seconds / scene.simulation.period)
        push = min(1.0, 1.0 / lightness) * self._push
        return touched(setup, push, _command, ticks, LOST_N).stable

    def predicted(self, lightness: float) -> bool:
        """Return whether the linear model of the loop is stable."""
        if self._held is None:
            return False
        sample = Session(self._scaled(lightness), self._point, self._delay).tick()
        found, law = sample.analysis, law_of(ControlArchitecture(self._scene), sample.model)
        x, rows = found.inverse_inertia, found.rows
        return not diverges(tick_matrix(self._scene, law, x, rows, self._delay, self._held))

    def felt(self, lightness: float) -> float:
        """Return the least felt inertia of a mechanism this light, by X_τ, over the device's."""
        model = Session(self._scaled(lightness), self._point, self._delay).tick().model
        return 1.0 / float(np.linalg.eigvals(self._inertia @ model.inverse_inertia).real.max())

    def _scaled(self, lightness: float) -> Scene:
        return scaled(self._scene, 1.0 / (lightness * self.own))


def _command(sample: Sample) -> Array:
    wrench = sample.output.device.copy()
    wrench[3:] /= TORQUE_UNIT
    return wrench


def _size(wrench: Array) -> float:
    return float(max(np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:]) / TORQUE_UNIT))
