"""Fig. 3: the three controllers joined, from measurements to the wrenches of both sides."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.engagement import Engagement, engage
from hapticmech_ros.control.flat import device_of, flat_device, flat_rendered, model_of
from hapticmech_ros.control.four_channel import FourChannel
from hapticmech_ros.control.gain_passage import Passage
from hapticmech_ros.control.kernels import control_wrenches
from hapticmech_ros.control.loop_layout import SETTINGS
from hapticmech_ros.control.measurements import (
    ControlOutput,
    DeviceMeasurement,
    PointMeasurement,
    RenderingModel,
)
from hapticmech_ros.control.prediction import InFlight, foreseen, point_ahead
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL
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
_TWIST, _CONTACT = OPERATIONAL_MODEL.slice("twist"), OPERATIONAL_MODEL.slice("contact")
_NOTHING = np.zeros(6)


class ControlArchitecture:
    """The controllers of a scene, a control period of which is one kernel.

    Holds gains only; state is the :class:`Engagement`. Gains can be changed while it renders: they
    pass to the new ones, see :meth:`tune`. Measurements are flat arrays, see
    :mod:`~hapticmech_ros.control.flat`.

    A control law of one's own is a subclass that overrides :meth:`answer`; ``super().answer`` is
    the scene's. Who has a control (:class:`~hapticmech_ros.session.session.Session`,
    :class:`~hapticmech_ros.control.controller_side.ControllerSide`) then calls it in Python for
    each sample that the controllers get, and does the rest as always: account, passivity,
    connection, and the loops that the device closes, which correct the answer by the scene's gains
    unless these say that nothing is local. Such a law

    - takes arrays that it does not change, and returns wrenches (6, 6), rows as in
      :class:`ControlOutput`: the first acts on the hand, the second on the mechanism, the account
      reads the error in the last one;
    - keeps the limits (:func:`~hapticmech_ros.saturation.limited`) and the ramp of a new engagement
      (:meth:`Engagement.ramp` over :meth:`ramp_of`), and adds what is carried on from another grasp
      (:meth:`joined`);
    - calls :meth:`pass_on_to` before it looks at ``gains``, which :meth:`tune` changes.

    docs/feel.md has an example.

    Attributes:
        answers_in_python: whether :meth:`answer` is overridden: a law of one's own, and no
            kernel's.
        task: (6,) 1 for rows of a six-vector that the task space has, else 0.
        limits: N and N m, of the device.
        device_inertia: (6, 6) Λ_d.
        gains: those of now.
        channels: the four channels with them.
        delay: one-way delay (s) that the gains are for.
    """

    answers_in_python: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "answer" in vars(cls):
            cls.answers_in_python = True

    def __init__(self, scene: Scene) -> None:
        self.limits = (scene.device.force_limit, scene.device.torque_limit)
        self.device_inertia = device_inertia(scene.device)
        self.substeps = scene.device.substeps
        self.acts = np.array(scene.device.acts)
        self.delay = scene.connection.designed
        self._period = scene.simulation.period
        self.task = np.ones(6)
        if scene.task_space == "planar":
            self.task[2:5] = 0.0
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
        sixes = (self.task, inertia, channels.stiffness, channels.damping)
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

    @property
    def is_passing(self) -> bool:
        """Whether gains are on their way to others."""
        return self._passage is not None

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
        device: Array,
        rendered: Array,
        ahead: float,
        carried: Array | None = None,
    ) -> Engagement:
        """Start rendering: tie the device's present pose to the point's.

        Two that move apart so fast that the dampers would give a twentieth of the device's force or
        torque are tied like a grasp that changes, with nothing carried on: else what is felt is
        that velocity times the springs' stiffness and the time of the ramp. A hand that pushes all
        the while, as after a gap of some milliseconds, gets the sooner a hold at once.

        Args:
            time: s.
            device: (19,) the device's measurement.
            rendered: (139,) analysis and measurement of the operational point.
            ahead: as in :meth:`answer`.
            carried: (6,) the device's wrench until now, if it held the mechanism elsewhere.
        """
        own, point = device_of(device), point_ahead(rendered, ahead)
        if carried is None and self._part_fast(own, point, model_of(rendered)):
            carried = np.zeros(6)
        return engage(time, own.pose, point.pose, carried)

    def _part_fast(
        self, device: DeviceMeasurement, point: PointMeasurement, model: RenderingModel
    ) -> bool:
        rate = self.task * (device.twist - point.twist)
        held = self.gains.joint_constraint.damping * (model.constraint_projector @ rate)
        held += self.channels.damping * rate
        force, torque = np.sqrt(held[:3] @ held[:3]), np.sqrt(held[3:] @ held[3:])
        most_force, most_torque = self.limits
        return bool(force > SLIPS_FROM * most_force or torque > SLIPS_FROM * most_torque)

    def slipped(
        self, time: float, engagement: Engagement, device: Array, rendered: Array
    ) -> Engagement:
        """Return the tie to use at ``time`` (s); see :meth:`Engagement.slipped`.

        Args:
            time: s.
            engagement: the tie until now.
            device: (19,) the device's measurement.
            rendered: (139,) analysis and measurement of the operational point.
        """
        if engagement.carried is None:
            return engagement
        own, duration = device_of(device), self.ramp_of(engagement)
        return engagement.slipped(time, duration, own.pose, own.twist, rendered[_TWIST])

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
        """Return the wrenches for measurements at ``time`` (s); see :meth:`answer`.

        Args:
            time: s.
            engagement: the tie of the two poses.
            device: its measurement.
            point: that of the operational point.
            model: what the analysis reports.
            in_flight: what of earlier commands to the mechanism has not acted yet.
        """
        own, rendered = flat_device(device), flat_rendered(model, point)
        return ControlOutput(*self.answer(time, engagement, own, rendered, 0.0, in_flight))

    def answer(
        self,
        time: float,
        engagement: Engagement,
        device: Array,
        rendered: Array,
        ahead: float,
        in_flight: InFlight | None = None,
    ) -> Array:
        """Return the wrenches for measurements, (6, 6): rows as in :class:`ControlOutput`.

        Args:
            time: s.
            engagement: the tie of the two poses.
            device: (19,) the device's measurement.
            rendered: (139,) analysis and measurement of the operational point.
            ahead: s, from the time of ``rendered`` to that of ``device``; the point's pose is
                carried on by its twist for as long.
            in_flight: what of earlier commands to the mechanism has not acted yet, for a device
                that corrects commands by itself; see
                :func:`~hapticmech_ros.control.prediction.point_ahead`.

        Raises:
            InvalidInputError: an array of another size.
        """
        settings = self.settings_at(time, engagement)
        if in_flight is not None and rendered.size == OPERATIONAL_MODEL.size:
            rendered, model = rendered.copy(), model_of(rendered)
            free, contact = model.free_acceleration, rendered[_CONTACT]
            twist = foreseen(rendered[_TWIST], model.inverse_inertia, free, contact, in_flight)
            rendered[_TWIST] = twist
            ahead += in_flight.duration
        out = np.empty((6, 6))
        if not control_wrenches(settings, device, rendered, time, ahead, out):
            sizes = device.size, rendered.size
            rule = f"must be {DEVICE_SAMPLE.size} and {OPERATIONAL_MODEL.size}"
            raise InvalidInputError("numbers of device and rendering", sizes, rule)
        if engagement.carried is not None:
            out[0] = self.joined(time, engagement, out[0])
        return out

    def joined(self, time: float, engagement: Engagement, wrench: Array) -> Array:
        """Return the device's wrench (6,) with what it still carries on from another grasp."""
        faded = engagement.faded(time, self.ramp_of(engagement))
        return wrench if faded is None else limited(wrench + faded, *self.limits)


def device_inertia(device: Device) -> Array:
    """Return Λ_d (6, 6) of a device with isotropic mass and inertia at the point held."""
    return np.diag([device.mass] * 3 + [device.inertia] * 3)
