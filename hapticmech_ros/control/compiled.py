"""The control that runs: :class:`ControlArchitecture` with a control period in one kernel."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.engagement import Engagement
from hapticmech_ros.control.flat import flat_device, flat_rendered, model_of
from hapticmech_ros.control.kernels import control_wrenches
from hapticmech_ros.control.measurements import (
    ControlOutput,
    DeviceMeasurement,
    PointMeasurement,
    RenderingModel,
)
from hapticmech_ros.control.prediction import InFlight, foreseen
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL

_TWIST, _CONTACT = OPERATIONAL_MODEL.slice("twist"), OPERATIONAL_MODEL.slice("contact")


class CompiledControl(ControlArchitecture):
    """The controllers; results equal the parent's to rounding, in a tenth of the time."""

    compiled: ClassVar[bool] = True

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
