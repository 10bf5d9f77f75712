"""Fig. 3: the three controllers joined, from measurements to the wrenches of both sides."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.engagement import Engagement, engage, pose_error
from hapticmech_ros.control.flat import device_of, model_of, point_of
from hapticmech_ros.control.force_gain import force_gain
from hapticmech_ros.control.four_channel import FourChannel
from hapticmech_ros.control.gain_passage import Passage
from hapticmech_ros.control.impedance import impedance_wrench
from hapticmech_ros.control.joint_constraint import joint_constraint_wrench
from hapticmech_ros.control.local_model import NO_MODEL, LocalModel
from hapticmech_ros.control.loop_layout import SETTINGS
from hapticmech_ros.control.measurements import (
    ControlOutput,
    DeviceMeasurement,
    PointMeasurement,
    RenderingModel,
)
from hapticmech_ros.control.prediction import InFlight, carried_on, foreseen
from hapticmech_ros.quaternions import quaternion_of
from hapticmech_ros.saturation import limited
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.document import Scene

# Share of the device's limits from which the dampers' wrench makes a new tie slip.
SLIPS_FROM = 0.05
_GAINS, _RAMP = SETTINGS.slice("task", "c6"), SETTINGS.start("ramp")
_LIMITS = SETTINGS.slice("force_limit", "torque_limit")
_ENGAGED = SETTINGS.slice("engaged_at", "turn")
_NOTHING = np.zeros(6)


class ControlArchitecture:
    """The controllers of a scene. Holds gains only; state is the :class:`Engagement`.

    Gains can be changed while it renders: they pass to the new ones, see :meth:`tune`.

    Measurements come as objects, or as flat arrays with the time that lies between them; see
    :mod:`~hapticmech_ros.control.flat`.

    Attributes:
        compiled: whether a kernel computes; see :func:`~hapticmech_ros.control.build.control_for`.
        delay: one-way delay (s) that the gains are for.
    """

    compiled: ClassVar[bool] = False

    def __init__(self, scene: Scene) -> None:
        self.limits = (scene.device.force_limit, scene.device.torque_limit)
        self.device_inertia = device_inertia(scene.device)
        self.substeps = scene.device.substeps
        self.acts = np.array(scene.device.acts)
        self.delay = scene.connection.designed
        self._period = scene.simulation.period
        self._task = np.ones(6)
        if scene.task_space == "planar":
            self._task[2:5] = 0.0
        self._through = np.outer(self._task, self._task)
        self._passage: Passage | None = None
        self._settings = np.zeros(SETTINGS.size)
        self._settings[_LIMITS] = self.limits
        self._tied: Engagement | None = None
        self.adopt(scene.controller)

    def adopt(self, gains: Controller, delay: float | None = None) -> None:
        """Take gains at once, and the one-way delay (s) they are for; a bump, if it renders."""
        self.delay = self.delay if delay is None else delay
        self.gains = gains
        lag = 2.0 * self.delay + 1.5 * self._period
        joint, force, position = gains.joint_constraint, gains.force_channel, gains.position_channel
        inertia = np.diag(self.device_inertia)
        self.channels = channels = FourChannel(position, force, inertia, lag)
        sixes = (self._task, inertia, channels.stiffness, channels.damping)
        scalars = (
            *(joint.feedforward, joint.stiffness, joint.damping),
            *(joint.force_limit, joint.torque_limit),
            *(position.to_mechanism, force.contact, force.hand, position.to_device),
            *(force.mechanism_feedback, force.device_feedback),
        )
        held = (channels.held_stiffness, channels.held_damping)
        self._settings[_GAINS] = np.concatenate((*sixes, *held, scalars))

    def settings_at(self, time: float, engagement: Engagement) -> Array:
        """Return what fixes the controllers at ``time`` (s) as an array (58,) for kernels.

        It is the same one each time, laid out as
        :data:`~hapticmech_ros.control.loop_layout.SETTINGS`.
        """
        self.pass_on_to(time)
        if engagement is not self._tied:
            self._tied = engagement
            turn = pin.Quaternion(quaternion_of(engagement.turn))
            # So that no turn is exactly none.
            turn.normalize()
            self._settings[_RAMP] = self.ramp_of(engagement)
            place = (engagement.time,), engagement.displacement, turn.coeffs()
            self._settings[_ENGAGED] = np.concatenate(place)
        return self._settings

    def carried_at(self, time: float, engagement: Engagement) -> Array:
        """Return what is left (6,) of a wrench that is carried on, at ``time`` (s)."""
        faded = engagement.faded(time, self.ramp_of(engagement))
        return _NOTHING if faded is None else faded

    def tune(self, time: float, gains: Controller, delay: float | None = None) -> None:
        """Pass to other gains from ``time`` (s) on, in a straight line over their ``gain_ramp``.

        Args:
            time: s.
            gains: the other ones.
            delay: one-way delay (s) that they are for; as before if left out.
        """
        delay = self.aim[1] if delay is None else delay
        self._passage = Passage(time, self.gains, gains, self.delay, delay)

    @property
    def aim(self) -> tuple[Controller, float]:
        """The gains that it has, or is passing to, and the one-way delay (s) they are for."""
        passage = self._passage
        return (self.gains, self.delay) if passage is None else (passage.new, passage.new_delay)

    def pass_on_to(self, time: float) -> None:
        """Take the gains of ``time`` (s), if they are passing to others."""
        if self._passage is not None:
            gains, arrived = self._passage.at(time)
            self.adopt(gains, self._passage.delay_at(time))
            if arrived:
                self._passage = None

    def engage(
        self,
        time: float,
        device: DeviceMeasurement,
        point: PointMeasurement,
        model: RenderingModel,
        carried: Array | None = None,
    ) -> Engagement:
        """Start rendering: tie the device's present pose to the point's; see :func:`engage`.

        Two that move apart so fast that the dampers would give a twentieth of the device's force or
        torque are tied like a grasp that changes, with nothing carried on: else what is felt is
        that velocity times the springs' stiffness and the time of the ramp. A hand that pushes all
        the while, as after a gap of some milliseconds, gets the sooner a hold at once.
        """
        if carried is None and self._part_fast(device, point, model):
            carried = np.zeros(6)
        return engage(time, device.pose, point.pose, carried)

    def _part_fast(
        self, device: DeviceMeasurement, point: PointMeasurement, model: RenderingModel
    ) -> bool:
        rate = self._task * (device.twist - point.twist)
        held = self.gains.joint_constraint.damping * (model.constraint_projector @ rate)
        held += self.channels.damping * rate
        force, torque = np.sqrt(held[:3] @ held[:3]), np.sqrt(held[3:] @ held[3:])
        most_force, most_torque = self.limits
        return bool(force > SLIPS_FROM * most_force or torque > SLIPS_FROM * most_torque)

    def slipped(
        self, time: float, engagement: Engagement, device: DeviceMeasurement, twist: Array
    ) -> Engagement:
        """Return the tie to use at ``time`` (s); see :meth:`Engagement.slipped`."""
        duration = self.ramp_of(engagement)
        return engagement.slipped(time, duration, device.pose, device.twist, twist)

    def ramp_of(self, engagement: Engagement) -> float:
        """Return how long (s) the wrench takes to come in."""
        started = engagement.carried is None
        return self.gains.engagement_ramp if started else self.gains.grasp_ramp

    def compute(
        self,
        time: float,
        engagement: Engagement,
        device: DeviceMeasurement,
        point: PointMeasurement,
        model: RenderingModel,
        in_flight: InFlight | None = None,
    ) -> ControlOutput:
        """Return the wrenches for the measurements at ``time`` (s).

        Args:
            time: s.
            engagement: the tie of the two poses.
            device: its measurement.
            point: that of the operational point.
            model: what the analysis reports.
            in_flight: what of earlier commands to the mechanism has not acted yet.
        """
        self.pass_on_to(time)
        if in_flight is not None:
            point = _foreseen(point, model, in_flight)
        gains = self.gains
        task = self._task
        error = task * pose_error(point.pose, engagement.mapped(device.pose))
        error_rate = task * (device.twist - point.twist)
        hand = task * device.hand_wrench
        contact = task * point.contact_wrench
        force = gains.force_channel
        impedance = task * impedance_wrench(
            self.device_inertia,
            model.inverse_inertia,
            model.balanced_share,
            model.free_acceleration,
            hand + force.contact * contact,
            gains.joint_constraint.feedforward,
            np.zeros(6),
            force.device_feedback * hand,
        )
        constraint = joint_constraint_wrench(
            gains.joint_constraint, model.constraint_projector, error, error_rate
        )
        channels = self.channels.wrenches(model.balanced_share, error, error_rate, hand, contact)
        ramp = engagement.ramp(time, self.ramp_of(engagement))
        total = ramp * (impedance + constraint + channels.device)
        return ControlOutput(
            device=self.joined(time, engagement, limited(total, *self.limits)),
            mechanism=limited(ramp * channels.mechanism, *self.limits),
            impedance=ramp * impedance,
            joint_constraint=ramp * constraint,
            four_channel=ramp * channels.device,
            error=error,
        )

    def joined(self, time: float, engagement: Engagement, wrench: Array) -> Array:
        """Return the device's wrench (6,) with what it still carries on from another grasp."""
        faded = engagement.faded(time, self.ramp_of(engagement))
        return wrench if faded is None else limited(wrench + faded, *self.limits)

    def local_model(self, time: float, engagement: Engagement, model: RenderingModel) -> LocalModel:
        """Return how the answer depends on the device, as let through at ``time`` (s)."""
        joint, force = self.gains.joint_constraint, self.gains.force_channel
        ramp = engagement.ramp(time, self.ramp_of(engagement))
        through = ramp * self._through
        gain = spring = damper = NO_MODEL.force
        if force.local:
            x, share = model.inverse_inertia, model.balanced_share
            feedback = force.device_feedback
            gain = force_gain(self.device_inertia, x, share, joint.feedforward, feedback)
            gain = through * gain
        if joint.local:
            projector = through * model.constraint_projector
            spring, damper = joint.stiffness * projector, joint.damping * projector
        return LocalModel(gain, spring, damper)

    def engage_flat(
        self,
        time: float,
        device: Array,
        rendered: Array,
        ahead: float,
        carried: Array | None = None,
    ) -> Engagement:
        """Start rendering with flat measurements; arguments as in :meth:`answer`."""
        point, model = _point_at(rendered, ahead), model_of(rendered)
        return self.engage(time, device_of(device), point, model, carried)

    def slipped_flat(
        self, time: float, engagement: Engagement, device: Array, rendered: Array
    ) -> Engagement:
        """Return the tie to use with flat measurements; see :meth:`slipped`."""
        if engagement.carried is None:
            return engagement
        return self.slipped(time, engagement, device_of(device), point_of(rendered).twist)

    def answer(
        self,
        time: float,
        engagement: Engagement,
        device: Array,
        rendered: Array,
        ahead: float,
        in_flight: InFlight | None = None,
    ) -> Array:
        """Return the wrenches for flat measurements, (6, 6): rows as in :class:`ControlOutput`.

        Args:
            time: s.
            engagement: the tie of the two poses.
            device: (19,) the device's measurement.
            rendered: (139,) analysis and measurement of the operational point.
            ahead: s, from the time of ``rendered`` to that of ``device``; the point's pose is
                carried on by its twist for as long.
            in_flight: as in :meth:`compute`.
        """
        model = model_of(rendered)
        if in_flight is None:
            point = _point_at(rendered, ahead)
        else:
            point = _foreseen(point_of(rendered), model, in_flight, ahead)
        return self.compute(time, engagement, device_of(device), point, model).rows()


def _foreseen(
    point: PointMeasurement, model: RenderingModel, in_flight: InFlight, ahead: float = 0.0
) -> PointMeasurement:
    """Return the point's measurement once what is in flight has acted, ``ahead`` (s) from now."""
    contact = point.contact_wrench
    twist = foreseen(
        point.twist, model.inverse_inertia, model.free_acceleration, contact, in_flight
    )
    pose = carried_on(point.pose, twist, ahead + in_flight.duration)
    return PointMeasurement(pose, twist, contact)


def _point_at(rendered: Array, ahead: float) -> PointMeasurement:
    """Return the point's measurement, its pose carried on for ``ahead`` (s)."""
    seen = point_of(rendered)
    pose = carried_on(seen.pose, seen.twist, ahead)
    return PointMeasurement(pose, seen.twist, seen.contact_wrench)


def device_inertia(device: Device) -> Array:
    """Return Λ_d (6, 6) of a device with isotropic mass and inertia at the point held."""
    return np.diag([device.mass] * 3 + [device.inertia] * 3)
