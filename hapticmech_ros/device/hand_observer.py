# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is known of the hand at a device that somebody else drives."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import kernels
from hapticmech_ros.device.device_layout import DEVICE_MODEL, DEVICE_STATE
from hapticmech_ros.device.impedance_device import ImpedanceDevice
from hapticmech_ros.scene.device import Device

_PERIOD, _SHARE, _LAG = DEVICE_MODEL.starts("period", "observer_share", "actuator_share")
_COMMAND, _WEIGHT = DEVICE_MODEL.slice("command"), DEVICE_MODEL.slice("weight")
_TWIST, _HAND = DEVICE_STATE.slice("twist"), DEVICE_STATE.slice("hand_wrench")
# Samples that are further apart say nothing of each other, s.
LONGEST_PERIOD_S = 0.1


class HandObserver:
    """Estimates F_h as :mod:`~hapticmech_ros.device.kernels` does, at any period.

    The driver is taken to lift the device's weight.

    Args:
        device: of the scene.
        planar: whether it moves in x, y and about z only.
    """

    def __init__(self, device: Device, planar: bool) -> None:
        self._rate = 2.0 * math.pi * device.observer_bandwidth
        self._data = ImpedanceDevice(device, 1.0 / self._rate, planar).data
        # What actuators did is known.
        self._data[_LAG], self._data[_WEIGHT] = 0.0, 0.0
        self._before, self._now = np.zeros(DEVICE_STATE.size), np.zeros(DEVICE_STATE.size)
        self._time: float | None = None

    def forget(self) -> None:
        """Begin anew, without a hand."""
        self._time = None

    def at(self, time: float, twist: Array, applied: Array) -> Array:
        """Return F_h at a sample.

        Args:
            time: of the sample, s.
            twist: (6,) measured, m/s and rad/s, world axes at the point held.
            applied: (6,) by the actuators on the hand since the sample before, N and N m, likewise.

        Returns:
            (6,) by the hand on the device, N and N m, world axes at the point held.
        """
        self._now[_TWIST] = twist
        if self._time is None or not 0.0 < time - self._time <= LONGEST_PERIOD_S:
            self._now[_HAND] = 0.0
        else:
            period = time - self._time
            self._data[_PERIOD], self._data[_SHARE] = period, -math.expm1(-self._rate * period)
            self._data[_COMMAND] = applied
            kernels.observe(self._data, self._before, self._now)
        self._time = time
        self._before[:] = self._now
        return self._now[_HAND].copy()


class TwistEstimate:
    """A twist from poses, through a low-pass.

    Args:
        cut_off: Hz.
    """

    def __init__(self, cut_off: float) -> None:
        self._rate = 2.0 * math.pi * cut_off
        self.forget()

    def forget(self) -> None:
        """Begin anew, at rest."""
        self._pose: pin.SE3 | None = None
        self._time, self._twist = 0.0, np.zeros(6)

    def at(self, time: float, pose: pin.SE3) -> Array:
        """Return the twist at a sample.

        Args:
            time: of the sample, s.
            pose: of the point held.

        Returns:
            (6,) m/s and rad/s, world axes at the point held.
        """
        period = time - self._time
        if self._pose is None or not 0.0 < period <= LONGEST_PERIOD_S:
            self._twist = np.zeros(6)
        else:
            moved = pose.translation - self._pose.translation
            turned = pin.log3(pose.rotation @ self._pose.rotation.T)
            rate = np.concatenate((moved, turned)) / period
            share = self._rate * period / (1.0 + self._rate * period)
            self._twist = self._twist + share * (rate - self._twist)
        self._pose, self._time = pose, time
        return self._twist
