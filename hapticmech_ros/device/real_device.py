# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of real devices: it sends a wrench and receives a sample.

It also estimates the hand's wrench at a device that another program drives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.device import kernels
from hapticmech_ros.device.impedance_device import ImpedanceDevice, device_for
from hapticmech_ros.device.kernels import DeviceModel, SimulatedState
from hapticmech_ros.device.state import NO_WRENCH, DeviceState
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import turned
from hapticmech_ros.numerics.saturation import limited
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.device import Device

# Samples that are further apart are not compared, s.
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
        self._model = DeviceModel(ImpedanceDevice(device, 1.0 / self._rate, planar).data)
        # The actuators' wrench is known.
        self._model.actuator_share, self._model.weight[:] = 0.0, 0.0
        self._before, self._now = SimulatedState(), SimulatedState()
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
        model, now = self._model, self._now
        now.twist[:] = twist
        if self._time is None or not 0.0 < time - self._time <= LONGEST_PERIOD_S:
            now.hand_wrench[:] = 0.0
        else:
            period = time - self._time
            model.period, model.observer_share = period, -math.expm1(-self._rate * period)
            model.command[:] = applied
            kernels.estimate_hand(model, self._before, now)
        self._time = time
        self._before.values[:] = now.values
        return now.hand_wrench.copy()


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


# Of a handle; messages with more are not from a handle.
MOST_BUTTONS = 32


class Measured(NamedTuple):
    """A sample, along the axes of the device's base.

    Attributes:
        position: (3,) of the point held, m, from the base's origin.
        velocity: (3,) m/s.
        rotation: (3, 3) of the handle; None if the device does not report its orientation.
    """

    position: Array
    velocity: Array
    rotation: Array | None


class RealDevice:
    """Turns wrenches and samples between the world and a device's base.

    A kind of device has :meth:`look`, :meth:`exchange` and :meth:`let_go`. It has no force sensor:
    the hand's wrench is estimated, or reported as zero, as the scene sets.

    Args:
        scene: to render; its ``device`` describes the device.
        mounting: (3, 3) axes of the base in the world.
        silence: s without a sample after which the device counts as lost.
        clock: monotonic, s.
        has_torques: whether the device has actuators of rotation.

    Raises:
        InvalidInputError: a scene with another device.

    Attributes:
        silence: s, as above.
        fresh: whether the last step brought a sample.
        problem: why it cannot be driven; empty if it can.
        buttons: of its handle, whether each is pressed, by the last report; empty without buttons.
        late: periods without a sample.
    """

    def __init__(
        self,
        scene: Scene,
        mounting: Array,
        silence: float,
        clock: Callable[[], float],
        has_torques: bool = False,
    ) -> None:
        device, planar = scene.device, scene.task_space == "planar"
        _check(scene, has_torques)
        self._mounting, self._clock = mounting, clock
        self.silence = silence
        self._limits = device.force_limit, device.torque_limit
        self._driver = device_for(scene, with_hand=False)
        self._observer = HandObserver(device, planar)
        self._turning = TwistEstimate(device.velocity_filter)
        self._last: Measured | None = None
        self._given: Array = NO_WRENCH
        self._acts = np.array(device.acts)
        self.fresh = False
        self.problem = ""
        self.buttons: tuple[bool, ...] = ()
        self.late = 0

    def look(self) -> bool:
        """Look for the device; return whether it is there. Called once a period."""
        raise NotImplementedError

    def exchange(self, wrench: Array, now: float) -> tuple[bool, Measured | None]:
        """Send a wrench and take a sample.

        Args:
            wrench: (6,) on the hand, N and N m, axes of the base.
            now: by the clock, s.

        Returns:
            Whether the wrench was sent, and the measurement; None without a sample.
        """
        raise NotImplementedError

    def let_go(self) -> None:
        """Command no wrench now, not with the next period."""
        raise NotImplementedError

    def figures(self) -> Mapping[str, str]:
        """Return its entries for diagnostics."""
        return {"periods_without_sample": str(self.late)}

    def close(self) -> None:
        """Release its connection and its actuators; it cannot be driven any more."""

    def at_rest(
        self, pose: pin.SE3, held: bool = False, home: pin.SE3 | None = None
    ) -> DeviceState:
        """Return the device where it was measured last, without a wrench.

        Args:
            pose: taken before the first measurement; its orientation is used for a device that does
                not report its own.
            held: unused: the device does not know whether a hand holds it.
            home: unused: the workspace is about its present place.
        """
        self._observer.forget()
        self._turning.forget()
        self._given = NO_WRENCH
        return DeviceState.resting(pose if self._last is None else self._pose(self._last, pose))

    def step(
        self,
        state: DeviceState,
        command: Array | None,
        held: DeviceState | None,
        ticks: int,
        push: Array = NO_WRENCH,
    ) -> DeviceState:
        """Send a command and return the state that was measured; without a sample, ``state``.

        Args:
            state: at the last sample.
            command: (6,) servo_cf, N and N m, on the hand, world axes; None for no wrench.
            held: unused.
            ticks: unused.
            push: (6,) unused.

        Returns:
            The state; F_h in it is estimated, or zero, as the scene sets.
        """
        now, before = self._clock(), self._given
        asked = NO_WRENCH
        if command is not None:
            asked = self._acts * limited(command + self.compensation(state), *self._limits)
        sent, measured = self.exchange(turned(asked, self._mounting.T), now)
        if sent:
            self._given = asked
        self.fresh = measured is not None
        if measured is None:
            self.late += 1
            return state
        self._last = measured
        pose = self._pose(measured, state.measured_pose)
        spin = np.zeros(3) if measured.rotation is None else self._turning.at(now, pose)[3:]
        twist = np.concatenate((self._mounting @ measured.velocity, spin))
        return state.replaced(
            pose=pose,
            twist=twist,
            measured_pose=pose,
            measured_twist=twist,
            # The command of the previous sample has acted since.
            reported=self._observer.at(now, twist, before),
            applied=before,
        )

    def compensation(self, state: DeviceState) -> Array:
        """Return the wrench (6,) that the driver adds to a command, N and N m, world axes."""
        return self._driver.compensation(state)

    def sensed(self, push: Array) -> Array:
        """Return nothing (6,): it has no force sensor.

        Args:
            push: (6,) unused.
        """
        return NO_WRENCH

    def forget(self) -> None:
        """Forget its last sample, when it was disconnected."""
        self._last, self._given, self.fresh = None, NO_WRENCH, False

    def _pose(self, measured: Measured, before: pin.SE3) -> pin.SE3:
        """Return a pose in the world, its origin that of the device's base."""
        rotation = before.rotation
        if measured.rotation is not None:
            rotation = self._mounting @ measured.rotation
        return pin.SE3(rotation, self._mounting @ measured.position)


def _check(scene: Scene, has_torques: bool) -> None:
    """Refuse a scene whose device is another one.

    Raises:
        InvalidInputError: it has torques that this one has not, or a force sensor.
    """
    device = scene.device
    if device.actuated != "translation" and not has_torques:
        rule = "must be translation for a device without torques, such as {preset: inverse3}"
        raise InvalidInputError("device.actuated", device.actuated, rule)
    if device.force_sensor == "measured":
        rule = "must be estimated or absent for a device without a force sensor"
        raise InvalidInputError("device.force_sensor", device.force_sensor, rule)
