# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated impedance-type device: a rigid body between hand and actuators, sampled and held.

    (Λ_d + Λ_a) ẍ = F_s + F_o + u + w - b ẋ - f

u follows the command, limited by the actuators and held over a sample period (zero-order hold),
with the actuators' lag; F_o, by others than the hand, is held as well. The hand's own law F_s acts
all through the period, and its own mass Λ_a while it holds. w is weight, f end stops and Coulomb
friction (:mod:`~oracles.device.friction`). F_h, between device and hand, is F_s - Λ_a ẍ.

Substeps are those of position Verlet: half a drift, the change of the twist, half a drift.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.device import NO_WRENCH, DeviceState, GraspSchedule, HandLaw
from hapticmech_ros.device.hand import ALWAYS
from hapticmech_ros.device.hand_kernels import OPEN
from hapticmech_ros.saturation import limited
from hapticmech_ros.scene.device import Device
from oracles.device.driver import DeviceDriver
from oracles.device.friction import Friction
from oracles.device.grasp_schedule import window_of
from oracles.device.hand import no_hand


class ReadableDevice:
    """Steps a device of the scene by one sample period at a time.

    Args:
        device: of the scene.
        period: s.
        planar: whether it moves in x, y and about z only.
        law: of the hand.
        schedule: when it holds.
    """

    def __init__(
        self,
        device: Device,
        period: float,
        planar: bool,
        law: HandLaw = no_hand,
        schedule: GraspSchedule = ALWAYS,
    ) -> None:
        self.device = device
        self.period = period
        self._law = law
        self._grip = schedule
        self._step = period / device.substeps
        self._damping = np.array([device.damping] * 3 + [device.angular_damping] * 3)
        task = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0]) if planar else np.ones(6)
        # Change of the twist per wrench and step, in the directions that the scene has.
        body = np.array([device.mass] * 3 + [device.inertia] * 3)
        self._arm = np.array([schedule.mass] * 3 + [schedule.inertia] * 3)
        self._gain = self._step * task / body
        self._held_gain = self._step * task / (body + self._arm)
        self._lag = _lag(device.actuator_bandwidth, self._step)
        self._resistance = Friction(device, 0.5 * self._step)
        self._driver = DeviceDriver(device, period, task)
        self._ideal = device.position_resolution == 0.0 and device.angle_resolution == 0.0
        cut_off = 2.0 * np.pi * device.velocity_filter * period
        self._filter_gain = cut_off / (1.0 + cut_off)

    def at_rest(
        self, pose: pin.SE3, held: bool = False, home: pin.SE3 | None = None
    ) -> DeviceState:
        """Return the device standing still.

        Args:
            pose: where.
            held: whether the hand can take hold now.
            home: pose about which the workspace is; ``pose`` if left out.
        """
        window = window_of(self._grip, 0.0) if held else OPEN
        own = self._hand_wrench(0.0, pose, NO_WRENCH, pose, window)
        reported = NO_WRENCH if self._driver.senses_itself else own
        still, measured = np.zeros(6), self._quantised(pose)
        home = pose if home is None else home
        return DeviceState.resting(pose).replaced(
            twist=still,
            measured_pose=measured,
            measured_twist=still,
            hand_wrench=own,
            reported=reported,
            home=home,
            window=window,
        )

    def compensation(self, state: DeviceState) -> Array:
        """Return what the driver adds to a command over the next period (6,)."""
        return self._driver.added(state)

    def sensed(self, push: Array) -> Array:
        """Return what a force sensor, if any, reads of others' ``push`` (6,) besides the hand's.

        An estimate has it in it already, later.
        """
        return NO_WRENCH if self._driver.senses_itself else push

    def step(
        self,
        state: DeviceState,
        command: Array | None,
        held: DeviceState | None,
        ticks: int,
        push: Array = NO_WRENCH,
    ) -> DeviceState:
        """Advance one period.

        Args:
            state: where to start.
            command: (6,) servo_cf, on the hand by the device, held over the period; None for
                actuators off, compensation included.
            held: state in which the hand could take hold; None if nobody is there.
            ticks: whole periods since then, until ``state``.
            push: (6,) by others than the hand, on the device, world axes.
        """
        asked = self._driver.asked(state, command)
        actuators = limited(asked, self.device.force_limit, self.device.torque_limit)
        step, push = self._step, self._weighed(push)
        pose, twist, applied = state.pose, state.twist, state.applied
        window, anchor = self._taken(ticks * self.period, pose, held, state.window, state.anchor)
        own = self._hand_wrench(ticks * self.period, pose, twist, anchor, window)
        before, middle, carried = twist, own, False
        for index in range(self.device.substeps):
            given, applied = self._given(applied, actuators)
            carried = window != OPEN
            gain = self._held_gain if carried else self._gain
            before, rest = twist, push + given
            pose = self._drifted(pose, before)
            seen = before + 0.5 * gain * (rest + own - self._damping * before)
            elapsed = ticks * self.period + (index + 0.5) * step
            middle = self._hand_wrench(elapsed, pose, seen, anchor, window)
            # v⁺ - v = g (F - b (v + v⁺) / 2), solved for v⁺.
            lost = 0.5 * gain * self._damping
            twist = (before + gain * (rest + middle) - lost * before) / (1.0 + lost)
            twist = self._resistance.resisted(state.home, pose, twist, gain)
            pose, elapsed = self._drifted(pose, twist), ticks * self.period + (index + 1) * step
            if index + 1 == self.device.substeps:
                elapsed = (ticks + 1) * self.period
            window, anchor = self._taken(elapsed, pose, held, window, anchor)
            own = NO_WRENCH if window == OPEN else middle
        own = self._hand_wrench((ticks + 1) * self.period, pose, twist, anchor, window)
        if self._arm.any() and carried and window != OPEN:
            rate = (twist - before) / step + self._held_gain / step * (own - middle)
            own = own - self._arm * rate
        measured = self._quantised(pose)
        estimated = twist if self._ideal else self._estimated(state, measured)
        reported = own
        if self._driver.senses_itself:
            reported = self._driver.reported(state, estimated, asked)
        return state.replaced(
            pose=pose,
            twist=twist,
            measured_pose=measured,
            measured_twist=estimated,
            hand_wrench=own,
            applied=applied,
            reported=reported,
            anchor=anchor,
            window=window,
        )

    def _drifted(self, pose: pin.SE3, twist: Array) -> pin.SE3:
        """Return where a pose is after half a substep."""
        half = 0.5 * self._step
        turn = pin.exp3(half * twist[3:])
        return pin.SE3(turn @ pose.rotation, pose.translation + half * twist[:3])

    def _taken(
        self, elapsed: float, pose: pin.SE3, held: DeviceState | None, window: int, anchor: pin.SE3
    ) -> tuple[int, pin.SE3]:
        """Return the window of the grip at a time (s), and the pose in which it was taken."""
        if held is None:
            return OPEN, anchor
        now = window_of(self._grip, elapsed)
        if now == 0:
            return now, held.pose
        return now, pose if now not in (OPEN, window) else anchor

    def _hand_wrench(
        self, elapsed: float, pose: pin.SE3, twist: Array, anchor: pin.SE3, window: int
    ) -> Array:
        return NO_WRENCH if window == OPEN else self._law(elapsed, pose, twist, anchor)

    def _given(self, applied: Array, asked: Array) -> tuple[Array, Array]:
        """Return the actuators' wrench over a substep, its mean, and at the substep's end."""
        left, mean = self._lag
        if mean == 0.0:
            return asked, asked
        behind = applied - asked
        return asked + mean * behind, asked + left * behind

    def _weighed(self, push: Array) -> Array:
        weight = self._driver.weight
        return push if weight is None else push + weight

    def _quantised(self, pose: pin.SE3) -> pin.SE3:
        if self._ideal:
            return pose
        translation, rotation = pose.translation, pose.rotation
        if self.device.position_resolution > 0.0:
            step = self.device.position_resolution
            translation = step * np.round(translation / step)
        if self.device.angle_resolution > 0.0:
            step = self.device.angle_resolution
            rotation = pin.exp3(step * np.round(pin.log3(rotation) / step))
        return pin.SE3(rotation, translation)

    def _estimated(self, before: DeviceState, now: pin.SE3) -> Array:
        """Return the twist from encoder differences, low-passed."""
        old = before.measured_pose
        difference = np.concatenate(
            (now.translation - old.translation, pin.log3(now.rotation @ old.rotation.T))
        )
        change = difference / self.period - before.measured_twist
        return np.asarray(before.measured_twist + self._filter_gain * change)


def _lag(bandwidth: float, step: float) -> tuple[float, float]:
    """Return what is left of a lag's error after a step (s), and its mean over it; 0 for none."""
    if bandwidth == 0.0:
        return 0.0, 0.0
    rate = 2.0 * math.pi * bandwidth * step
    return math.exp(-rate), -math.expm1(-rate) / rate
