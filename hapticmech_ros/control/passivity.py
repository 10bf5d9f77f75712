# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Time-domain passivity at the device: it gives back no more than it has got.

After Hannaford and Ryu (2002), for a device whose commands are held over a sample. The actuators
have taken

    W = Σ -u · ξ                            ξ the displacement over each sample: exact

from the device, the hand has put E_h = W + ½ vᵀ Λ_d v (and what friction took) into it, and the
controller sends E_m, the energy that the mechanism has got at its point, late by the connection's
delay. With an allowance ε and a slack s, W is kept above

    max(min(0, E_m) - ε, E_m - s)

The first bound is passivity at the hand: E_h never falls below -ε, or below what the mechanism gave
of its own (gravity, drives, others that push it). It holds however late E_m is. The second keeps an
unstable loop from using energy that the hand once put in and the mechanism has since dissipated.

The least damping that suffices, -λ Λ_d v, is added to a command that would violate it; where even
the most damping does not suffice, as at rest, the command is scaled down.

The device applies safety limits and passivity to a command before its actuators get it.
"""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.control.device_side_kernels import (
    allow_command,
    correct,
    energy_available,
)
from hapticmech_ros.control.loop_layout import DeviceAccount, HandMemory, HandsCorrection
from hapticmech_ros.control.other_hands import NO_OTHERS
from hapticmech_ros.device import NO_WRENCH
from hapticmech_ros.device.safety import SafetyEnvelope, SafetyLimits, safety_limits
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample, LocalModel
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Passivity

# Most damping, as a share of that which stops the device within a sample.
MOST_DAMPING = 0.4


class PassivityController:
    """Accounts for a device's energies, and limits commands by them.

    Args:
        bounds: limits of the energy given.
        inertia: (6,) diagonal of Λ_d, kg and kg m².
        period: s, over which a command is held.
        limits: force and torque that the actuators have, N and N m.
        acts: (6,) 1 where there are actuators; everywhere if left out.
        filtered: whether the twist of samples lags: then the last period's mean twist, extrapolated
            to its end by the wrenches that acted, is used where it predicts that more energy is
            given.
        lag: s, of the actuators, of first order: they still give a part of the last wrench, and
            keep giving a part of the commanded one afterwards.

    Attributes:
        account: all that it knows.
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
        self.account, ahead = DeviceAccount(), period + lag
        self.account.fill(
            inertia=inertia,
            acts=np.ones(6) if acts is None else acts,
            force_limit=limits[0],
            torque_limit=limits[1],
            period=period,
            most_damping=MOST_DAMPING / period,
            kept=lag / period * -math.expm1(-period / lag) if lag > 0.0 else 0.0,
            ahead=ahead,
            moved=0.5 * ahead**2,
            filtered=filtered,
            passive=bounds.control,
            allowance=bounds.allowance,
            slack=bounds.slack,
        )

    def begin(self) -> None:
        """Start anew: the hand takes hold, or no hand holds."""
        account = self.account
        account.actuators = account.mechanism = account.received = 0.0
        account.dissipated = account.pose_known = 0.0
        for part in (account.pose.values, account.added, account.rate, account.applied):
            part[:] = 0.0

    @property
    def actuators(self) -> float:
        """W, J, since E_m was received first; before that, since the last :meth:`begin`."""
        return self.account.actuators

    @property
    def mechanism(self) -> float | None:
        """E_m as it was received last, J; None until it is, and nothing is held back."""
        return self.account.mechanism if self.account.received != 0.0 else None

    @property
    def dissipated(self) -> float:
        """J that the controller's damping has taken in excess of the commands."""
        return self.account.dissipated

    @property
    def changed(self) -> int:
        """Samples in which a command was changed."""
        return int(self.account.changed)

    def hand(self, sample: Array) -> float:
        """Return E_h at a sample (19,), J, without what friction took.

        Args:
            sample: (19,) of the device, in SI units; see ``layout.DeviceSample``.
        """
        twist = DeviceSample(sample).twist
        return self.actuators + 0.5 * float(twist @ (self.account.inertia * twist))

    @property
    def available(self) -> float:
        """J that the actuators may give now; infinite while E_m is not known."""
        return energy_available(self.account)


def corrected(
    command: Array,
    model: Array,
    answered: Array,
    now: Array,
    hand: Array,
    period: float,
    others: Array = NO_OTHERS,
) -> Array:
    """Return a command (6,) for the device as it is now; see ``device_side_kernels``.

    Args:
        command: (6,) of the controller, N and N m, world axes.
        model: (108,) G, K and B row by row, SI units: wrench per F_h, ξ and v.
        answered: (19,) the device's sample that the command answers, in SI units.
        now: (19,) its newest sample, likewise.
        hand: (22,) the hand's last wrenches, a ``HandMemory``.
        period: T, s, over which the command is held.
        others: (19,) the correction for other hands; see ``other_hands``.
    """
    found = np.empty(6)
    correct(
        command,
        LocalModel(model),
        DeviceSample(answered),
        DeviceSample(now),
        HandMemory(hand),
        period,
        HandsCorrection(others),
        found,
    )
    return found


def passivity_for(scene: Scene) -> PassivityController:
    """Return the passivity controller of a scene's device."""
    device = scene.device
    limits = device.force_limit, device.torque_limit
    bounds, period = scene.controller.passivity, scene.simulation.period
    acts = np.array(device.acts)
    bandwidth = 2.0 * math.pi * device.actuator_bandwidth
    lag = 1.0 / bandwidth if bandwidth > 0.0 else 0.0
    filtered = device.position_resolution > 0.0 or device.angle_resolution > 0.0
    return PassivityController(
        bounds, np.array(device.inertias), period, limits, acts, filtered, lag
    )


class DeviceSide:
    """The device's side of the rendering loop, in a session and in the device's node.

    Args:
        scene: whose device.
        limits: of the wrench sent; the scene's if left out.

    Attributes:
        passivity: the account of its energies.
        envelope: the last before a force leaves.
    """

    def __init__(self, scene: Scene, limits: SafetyLimits | None = None) -> None:
        self.passivity: PassivityController = passivity_for(scene)
        if limits is None:
            limits = safety_limits(scene.device)
        self.envelope = SafetyEnvelope(scene.simulation.period, limits)

    def begin(self) -> None:
        """Start anew: the hand takes hold, or no hand holds."""
        self.passivity.begin()
        self.envelope.stop()

    def allow(
        self,
        command: Array,
        sample: Array,
        applied: Array,
        to_mechanism: float | None,
        added: Array = NO_WRENCH,
    ) -> Array:
        """Account for the last period, and return the limited command (6,) for the next one.

        Args:
            command: (6,) on the hand, by the device, at the point held, N and N m, world axes.
            sample: (19,) of the device now, in SI units; see ``layout.DeviceSample``.
            applied: (6,) by the actuators, taken as held over the period; N and N m, world axes.
            to_mechanism: E_m, J, as received; None while no controller sends it.
            added: (6,) by the device's driver, for weight and friction, N and N m, world axes.
        """
        found = np.array(command, dtype=float)
        given = math.nan if to_mechanism is None else to_mechanism
        account, safety = self.passivity.account, self.envelope.numbers
        allow_command(account, safety, found, DeviceSample(sample), applied, added, given)
        return found
