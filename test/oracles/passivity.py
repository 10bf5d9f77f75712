# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Time-domain passivity at the device: it gives back no more than it has got.

After Hannaford and Ryu (2002), for a device whose commands are held over a sample. The actuators
have taken

    W = Σ -u · ξ                            ξ the displacement over each sample: exact

from the device, the hand has put E_h = W + ½ vᵀ Λ_d v (and what friction took) into it, and the
controller tells E_m, what the mechanism has got at its point, as late as the connection is. With
an allowance ε and a slack s, W is kept above

    max(min(0, E_m) - ε, E_m - s)

The first bound is passivity at the hand: E_h never falls below -ε, or below what the mechanism gave
of its own (gravity, drives, others that push it). It holds however late E_m is, for what the
mechanism can give is its own affair at any time. The second keeps an unstable loop from living on
what the hand once put in and the mechanism has long lost.

A command that would go below is changed by as little damping as does it, -λ Λ_d v, and is shortened
where even the most damping does not: at rest nothing else helps.
"""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.saturation import limited
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Passivity
from oracles.local_model import FORCE, TWIST, displacement

NO_WRENCH = np.zeros(6)
NO_WRENCH.flags.writeable = False
# Most damping, as a share of what stops the device within a sample.
MOST_DAMPING = 0.4


class PassivityController:
    """Watches a device's energies, and holds commands to them.

    Args:
        bounds: what may be given.
        inertia: (6,) diagonal of Λ_d, kg and kg m².
        period: s, over which a command is held.
        limits: force and torque that the actuators have, N and N m.
        acts: (6,) 1 where there are actuators; everywhere if left out.
        filtered: whether the twist of samples lags: what was moved over the last period then counts
            too, whichever says that more is given.
        lag: s, of the actuators, of first order: they still give a part of what they gave before,
            and go on with what they are told for as long.

    Attributes:
        actuators: W, J, since E_m was told first; before that, since the last :meth:`begin`.
        mechanism: E_m as it was told last, J; None until it is, and nothing is held back.
        dissipated: J, that the controller's damping has taken in excess of the commands.
        changed: samples in which a command was changed.
    """

    def __init__(
        self,
        bounds: Passivity,
        inertia: Array,
        period: float,
        limits: tuple[float, float],
        acts: Array | None = None,
        filtered: bool = False,
        lag: float = 0.0,
    ) -> None:
        self.bounds = bounds
        self.changed = 0
        self._limits, self._filtered = limits, filtered
        # Mean share, over a period, of what actuators gave before.
        self._kept = lag / period * -math.expm1(-period / lag) if lag > 0.0 else 0.0
        self._acts = np.ones(6) if acts is None else acts
        self._inertia, self._period = inertia, period
        # What is foreseen, s, and what a held wrench moves in it, per acceleration.
        self._ahead = period + lag
        self._moved = 0.5 * self._ahead**2
        self._most = MOST_DAMPING / period
        self.begin()

    def begin(self) -> None:
        """Start anew: the hand takes hold, or nobody holds."""
        self.actuators = self.dissipated = 0.0
        self.mechanism: float | None = None
        self._place: Array | None = None
        self._added = self._rate = self._applied = NO_WRENCH

    def set_mechanism_energy(self, mechanism: float | None) -> None:
        """Take E_m, J; None while nobody tells it.

        When it is told first, the account begins: what a commander without one gave before, be it
        of his own, is no debt that the next one's damping has to collect.
        """
        if self.mechanism is None and mechanism is not None:
            self.actuators = self.dissipated = 0.0
        self.mechanism = mechanism

    def hand(self, sample: Array) -> float:
        """Return E_h at a sample (19,), J, without what friction took."""
        twist = sample[TWIST]
        return self.actuators + 0.5 * float(twist @ (self._inertia * twist))

    @property
    def available(self) -> float:
        """J that the actuators may give now; infinite while E_m is not known."""
        if self.mechanism is None or not self.bounds.control:
            return math.inf
        least = min(0.0, self.mechanism) - self.bounds.allowance
        return self.actuators - max(least, self.mechanism - self.bounds.slack)

    def record(self, sample: Array, applied: Array) -> None:
        """Account for the last period.

        Args:
            sample: (19,) of the device now.
            applied: (6,) by the actuators on the device, held until now.
        """
        if self._place is not None:
            way = displacement(self._place, sample)
            # Its mean is that of the middle of the period.
            acceleration = (applied - self._added + sample[FORCE]) / self._inertia
            self._rate = way / self._period + 0.5 * self._period * acceleration
            self.actuators -= float(applied @ way) - float(self._added @ way)
        self._place = sample[:7].copy()
        self._applied = applied - self._added if self._kept else NO_WRENCH

    def enforce(self, command: Array, sample: Array, added: Array = NO_WRENCH) -> Array:
        """Return the command (6,), changed where it would give more than there is.

        Args:
            command: (6,) on the hand, by the device, for the next period.
            sample: (19,) of the device now.
            added: (6,) by the device's driver, for its weight and friction: what it gives stays in
                the device, and does not count.
        """
        self._added = added
        available = self.available
        if available == math.inf:
            return command
        twist, hand = sample[TWIST], sample[FORCE]
        asked = limited(self._acts * command, *self._limits)
        acting = asked + self._kept * (self._applied - asked) if self._kept else asked
        given = self._given(acting, twist, hand)
        if self._filtered:
            seen = self._given(acting, self._rate, hand)
            if seen > given:
                twist, given = self._rate, seen
        if given <= available:
            return command
        self.changed += 1
        held = self._within(acting, twist, hand, available)
        self.dissipated += given - self._given(held, twist, hand)
        # Actuators that lag do it a little later: undoing their lag would shake the device.
        return held

    def _given(self, command: Array, twist: Array, hand: Array) -> float:
        """Return what a command gives in the next period, J, as far as can be foreseen."""
        way = self._ahead * twist + self._moved * (command + hand) / self._inertia
        return float(command @ way)

    def _within(self, command: Array, twist: Array, hand: Array, available: float) -> Array:
        momentum = self._inertia * twist
        # Given by command - λ momentum: square λ² - slope λ + given.
        given = self._given(command, twist, hand)
        square = self._moved * float(momentum @ twist)
        way = self._ahead * twist + self._moved * (command + hand) / self._inertia
        slope = float(momentum @ way) + self._moved * float(twist @ command)
        damping = _least_root(square, -slope, given - available)
        if damping <= self._most:
            return np.asarray(command - damping * momentum)
        best = 0.5 * slope / square if square > 0.0 else 0.0
        damped = command - min(max(best, 0.0), self._most) * momentum
        return np.asarray(self._share(damped, twist, hand, available) * damped)

    def _share(self, command: Array, twist: Array, hand: Array, available: float) -> float:
        """Return the largest share of a command in [0, 1] that gives no more than available."""
        # Given by share · command: square share² + slope share.
        square = self._moved * float(command @ (command / self._inertia))
        slope = float(command @ (self._ahead * twist + self._moved * hand / self._inertia))
        if square <= 0.0 or square + slope <= available:
            return 1.0
        if available <= 0.0:
            # The share that gives least.
            return min(max(-0.5 * slope / square, 0.0), 1.0)
        root = (-slope + math.sqrt(slope * slope + 4.0 * square * available)) / (2.0 * square)
        return min(max(root, 0.0), 1.0)


def passivity_for(scene: Scene) -> PassivityController:
    """Return the passivity controller of a scene's device."""
    device = scene.device
    inertia = np.array([device.mass] * 3 + [device.inertia] * 3)
    limits = device.force_limit, device.torque_limit
    bounds, period = scene.controller.passivity, scene.simulation.period
    acts = np.array(device.acts)
    bandwidth = 2.0 * math.pi * device.actuator_bandwidth
    lag = 1.0 / bandwidth if bandwidth > 0.0 else 0.0
    filtered = device.position_resolution > 0.0 or device.angle_resolution > 0.0
    return PassivityController(bounds, inertia, period, limits, acts, filtered, lag)


def _least_root(square: float, slope: float, constant: float) -> float:
    """Return the least root above 0 of square λ² + slope λ + constant; infinite if there is none.

    ``constant`` is above 0.
    """
    discriminant = slope * slope - 4.0 * square * constant
    if square <= 0.0 or slope >= 0.0 or discriminant < 0.0:
        return math.inf
    # Without cancellation: slope is below 0.
    return 2.0 * constant / (-slope + math.sqrt(discriminant))
