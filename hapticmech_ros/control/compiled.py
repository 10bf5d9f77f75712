"""The control that runs: :class:`ControlArchitecture` with a control period in one kernel."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pinocchio as pin

from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.engagement import Engagement
from hapticmech_ros.control.flat import flat_device, flat_rendered, model_of
from hapticmech_ros.control.kernels import ENGAGED, RAMP, SETTINGS_SIZE, control_wrenches
from hapticmech_ros.control.measurements import (
    ControlOutput,
    DeviceMeasurement,
    PointMeasurement,
    RenderingModel,
)
from hapticmech_ros.control.prediction import InFlight, foreseen
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.quaternions import quaternion_of
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.document import Scene

_TWIST, _CONTACT = OPERATIONAL_MODEL.slice("twist"), OPERATIONAL_MODEL.slice("contact")


class CompiledControl(ControlArchitecture):
    """The controllers of a scene; results equal the parent's to rounding, at a tenth of the time.

    Besides gains it holds the tie: one for each thread.
    """

    compiled: ClassVar[bool] = True

    def __init__(self, scene: Scene) -> None:
        self._settings = np.zeros(SETTINGS_SIZE)
        super().__init__(scene)
        self._tie = self._settings[ENGAGED:]
        self._tied: Engagement | None = None

    def adopt(self, gains: Controller, delay: float | None = None) -> None:
        """Take gains at once; see :meth:`ControlArchitecture.adopt`."""
        super().adopt(gains, delay)
        joint, force, position = gains.joint_constraint, gains.force_channel, gains.position_channel
        scalars = (
            *(joint.feedforward, joint.stiffness, joint.damping),
            *(joint.force_limit, joint.torque_limit),
            *(position.to_mechanism, force.contact, force.hand, position.to_device),
            *(force.mechanism_feedback, force.device_feedback),
        )
        inertia, channels = np.diag(self.device_inertia), self.channels
        self._settings[:RAMP] = np.concatenate(
            (
                *(self._task, inertia, channels.stiffness, channels.damping),
                *(channels.held_stiffness, channels.held_damping, scalars),
            )
        )
        self._settings[RAMP + 1 : ENGAGED] = self.limits

    def compute(
        self,
        time: float,
        engagement: Engagement,
        device: DeviceMeasurement,
        point: PointMeasurement,
        model: RenderingModel,
        in_flight: InFlight | None = None,
    ) -> ControlOutput:
        """Return the wrenches for measurements; see :meth:`ControlArchitecture.compute`."""
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
        """Return the wrenches for flat measurements; see :meth:`ControlArchitecture.answer`.

        Raises:
            InvalidInputError: an array of another size.
        """
        self.pass_on_to(time)
        if engagement is not self._tied:
            self._tie_to(engagement)
        if in_flight is not None and rendered.size == OPERATIONAL_MODEL.size:
            rendered, model = rendered.copy(), model_of(rendered)
            free, contact = model.free_acceleration, rendered[_CONTACT]
            twist = foreseen(rendered[_TWIST], model.inverse_inertia, free, contact, in_flight)
            rendered[_TWIST] = twist
            ahead += in_flight.duration
        out = np.empty((6, 6))
        if not control_wrenches(self._settings, device, rendered, time, ahead, out):
            sizes = device.size, rendered.size
            rule = f"must be {DEVICE_SAMPLE.size} and {OPERATIONAL_MODEL.size}"
            raise InvalidInputError("numbers of device and rendering", sizes, rule)
        if engagement.carried is not None:
            out[0] = self.joined(time, engagement, out[0])
        return out

    def _tie_to(self, engagement: Engagement) -> None:
        self._settings[RAMP] = self.ramp_of(engagement)
        self._tie[0] = engagement.time
        self._tie[1:4] = engagement.displacement
        turn = pin.Quaternion(quaternion_of(engagement.turn))
        # So that no turn is exactly none.
        turn.normalize()
        self._tie[4:] = turn.coeffs()
        self._tied = engagement
