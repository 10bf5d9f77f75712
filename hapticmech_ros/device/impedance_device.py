# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated impedance-type device: a rigid body between hand and actuators, sampled and held.

:mod:`~hapticmech_ros.device.kernels` integrates its motion.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin

from hapticmech_ros.device import kernels
from hapticmech_ros.device.hand import (
    ALWAYS,
    GraspSchedule,
    HandLaw,
    grasp_schedule_of,
    hand_numbers,
)
from hapticmech_ros.device.hand_kernels import OPEN
from hapticmech_ros.device.kernels import DeviceModel, SimulatedState, Substep
from hapticmech_ros.device.state import NO_WRENCH, DeviceState
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.device import Device, ForceSensor
from hapticmech_ros.scene.hand import Hand

# Where the reported wrench of the hand is from.
_SENSORS: dict[ForceSensor, float] = {
    "measured": kernels.MEASURED,
    "estimated": kernels.ESTIMATED,
    "absent": kernels.ABSENT,
}


class ImpedanceDevice:
    """Steps a device of the scene by one sample period at a time.

    Besides constants it holds the acting wrenches: use one for each thread.

    Args:
        device: of the scene.
        period: s.
        planar: whether it moves in x, y and about z only.
        hand: of the scene; None if there is none.
        law: of a user's own hand, in place of that one's; called at the start of periods, in the
            middle of every substep in which it holds, and at the ends of periods.
        schedule: when the hand holds, and its mass; of ``hand``, or always and none, if left out.

    Attributes:
        device: as given.
        period: s.
        data: a :class:`~hapticmech_ros.device.kernels.DeviceModel`, and the plan of its hand.
        held: the device when the hand could take hold; None before.
    """

    def __init__(
        self,
        device: Device,
        period: float,
        planar: bool,
        hand: Hand | None = None,
        law: HandLaw | None = None,
        schedule: GraspSchedule | None = None,
    ) -> None:
        if schedule is None:
            schedule = ALWAYS if hand is None else grasp_schedule_of(hand)
        self.device, self.period = device, period
        self._law = law
        numbers = hand_numbers(None if law is not None else hand, schedule)
        self.data: Array = np.concatenate((np.zeros(DeviceModel.layout.start("hand")), numbers))
        self._model, self._plan = DeviceModel(self.data), self.data[kernels.MODEL_SIZE :]
        self._model.fill(**_constants(device, period, planar, schedule))
        self.held: DeviceState | None = None

    @property
    def plain(self) -> bool:
        """Whether kernels alone move it: not a subclass, and without a law in Python."""
        return type(self) is ImpedanceDevice and self._law is None

    def at_rest(
        self, pose: pin.SE3, held: bool = False, home: pin.SE3 | None = None
    ) -> DeviceState:
        """Return the device standing still.

        Args:
            pose: where.
            held: whether the hand can take hold now.
            home: pose about which the workspace is; ``pose`` if left out.
        """
        state = DeviceState.resting(pose).replaced(home=pose if home is None else home)
        kernels.stand(self._model, self._plan, held, SimulatedState(state.flat))
        if self._law is not None and state.window != OPEN:
            self._push(self._law, 0.0, state)
            if self._senses:
                state.reported[:] = state.hand_wrench
        return state

    def compensation(self, state: DeviceState) -> Array:
        """Return the wrench (6,) that the driver adds over the next period, N, N m, world axes."""
        added = np.empty(6)
        kernels.compensate(self._model, state.measured_twist, added)
        return added

    def sensed(self, push: Array) -> Array:
        """Return the part (6,) of others' ``push`` that a force sensor, if any, adds to the hand's.

        An estimated wrench contains it already, with the estimate's lag.

        Args:
            push: (6,) by others on the device, N and N m, world axes at the point held.
        """
        return push if self._senses else NO_WRENCH

    def step(
        self,
        state: DeviceState,
        command: Array | None,
        held: DeviceState | None,
        ticks: int,
        push: Array = NO_WRENCH,
    ) -> DeviceState:
        """Return the state one period later.

        Args:
            state: where to start.
            command: (6,) servo_cf, N and N m, on the hand by the device, world axes, held over the
                period; None for actuators off, compensation included.
            held: state in which the hand could take hold; None without a hand.
            ticks: whole periods since then, until ``state``.
            push: (6,) by others than the hand, on the device, N and N m, world axes.

        Raises:
            InvalidInputError: a user's own hand returned no wrench (6,).
        """
        if held is None:
            ticks = -1
        elif held is not self.held:
            self.take_hold(held)
        start, end, model = SimulatedState(state.flat), SimulatedState(), self._model
        model.push[:] = push
        if command is None:
            model.command[:] = 0.0
        else:
            kernels.command_device(model, start, np.ascontiguousarray(command, dtype=float))
        if self._law is None:
            kernels.move_device(self.data, start, ticks, end)
        else:
            self._advance_by(self._law, start, ticks, end)
        return DeviceState(end.values)

    def take_hold(self, held: DeviceState) -> None:
        """Store the device's state of when the hand could take hold."""
        place, pose = self._model.held, held.pose
        place.position[:], place.rotation[:] = pose.translation, pose.rotation
        self.held = held

    @property
    def _senses(self) -> bool:
        return self.device.force_sensor == "measured"

    def _advance_by(
        self, law: HandLaw, start: SimulatedState, ticks: int, end: SimulatedState
    ) -> None:
        """Fill the state a period after ``start``, with the hand's wrench by a law in Python."""
        before, now, held = Substep(), DeviceState(end.values), False
        model, plan, substeps = self._model, self._plan, self.device.substeps
        kernels.begin(model, plan, start, ticks, end)
        self._push(law, kernels.time_of(model, ticks, 0), now)
        for index in range(substeps):
            kernels.half_substep(model, end, before)
            self._push(law, kernels.middle_of(model, ticks, index), now)
            held = kernels.end_substep(model, plan, ticks, index, end, before)
        self._push(law, kernels.time_of(model, ticks, substeps), now)
        kernels.finish(model, start, held, before, end)

    def _push(self, law: HandLaw, elapsed: float, state: DeviceState) -> None:
        """Put the hand's wrench by its law into a state, zero unless it holds."""
        if state.window == OPEN:
            state.hand_wrench[:] = 0.0
            return
        # A copy of the twist: the law may keep its arguments, and the state's array is overwritten.
        wrench = np.asarray(law(elapsed, state.pose, state.twist.copy(), state.anchor), dtype=float)
        if wrench.shape != (6,):
            raise InvalidInputError("shape of the hand's wrench", wrench.shape, "must be (6,)")
        state.hand_wrench[:] = wrench


def _constants(
    device: Device, period: float, planar: bool, schedule: GraspSchedule
) -> dict[str, Any]:
    """Return a device's constants, by fields of :class:`DeviceModel`."""
    task = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0]) if planar else np.ones(6)
    step = period / device.substeps
    body = np.array(device.inertias)
    arm = np.array([schedule.mass] * 3 + [schedule.inertia] * 3)
    left, mean = _lag(device.actuator_bandwidth, step)
    cut_off = 2.0 * np.pi * device.velocity_filter * period
    weight = task * np.array((*device.gravity_load, 0.0, 0.0, 0.0))
    space, known = device.workspace, device.compensation
    return {
        "step": step,
        "period": period,
        "substeps": device.substeps,
        "filter_gain": cut_off / (1.0 + cut_off),
        "force_limit": device.force_limit,
        "torque_limit": device.torque_limit,
        "position_step": device.position_resolution,
        "angle_step": device.angle_resolution,
        "lag": left,
        "lag_mean": mean,
        "friction": device.coulomb_friction,
        "angular_friction": device.angular_coulomb_friction,
        "stop": (space.radius, space.stiffness, space.damping),
        "angular_stop": (space.angle, space.angular_stiffness, space.angular_damping),
        "damping": [device.damping] * 3 + [device.angular_damping] * 3,
        "gain": step * task / body,
        "held_gain": step * task / (body + arm),
        "arm": arm,
        "weight": weight,
        "task": task,
        "acts": device.acts,
        "compensated": known.friction,
        "dead_zone": known.dead_zone,
        "angular_dead_zone": known.angular_dead_zone,
        "lifts": known.gravity and weight.any(),
        "senses_itself": _SENSORS[device.force_sensor],
        "observer_share": -math.expm1(-2.0 * math.pi * device.observer_bandwidth * period),
        "actuator_share": _lag(device.actuator_bandwidth, period)[1],
        "inertia": body,
    }


def _lag(bandwidth: float, step: float) -> tuple[float, float]:
    """Return what is left of a lag's error after a step (s), and its mean over it; 0 for none."""
    if bandwidth == 0.0:
        return 0.0, 0.0
    rate = 2.0 * math.pi * bandwidth * step
    return math.exp(-rate), -math.expm1(-rate) / rate


def device_for(scene: Scene, with_hand: bool = True, law: HandLaw | None = None) -> ImpedanceDevice:
    """Return the device of a scene.

    Args:
        scene: what to build.
        with_hand: whether the scene's hand may hold it; without, its own wrench is zero.
        law: of a user's own hand, which holds when the scene's would, with its mass.
    """
    period, planar = scene.simulation.period, scene.task_space == "planar"
    return ImpedanceDevice(scene.device, period, planar, scene.hand if with_hand else None, law)
