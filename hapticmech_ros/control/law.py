# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A control law of one's own as a function: from what is measured to the wrenches of both sides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.clutch import Clutch, pose_error
from hapticmech_ros.control.measurements import (
    DeviceMeasurement,
    InFlight,
    OperationalModel,
    PointMeasurement,
    device_of,
    model_of,
    point_ahead,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.saturation import limited
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Controller


@dataclass(frozen=True, slots=True)
class LawInput:
    """What a control law sees of a sample, world axes.

    Attributes:
        time: s.
        device: pose, twist (6,) and F_h (6,) of the device.
        point: pose, twist (6,) and F_c (6,) of the operational point, at the device's time.
        model: X, P_c, Π (6, 6) and a_0 (6,) of the operational point.
        error: (6,) e, from the operational point to the device's pose as the clutch maps it, m and
            rad; zero out of the task space.
        rate: (6,) ė, twist of the device less that of the point, m/s and rad/s; zero likewise.
    """

    time: float
    device: DeviceMeasurement
    point: PointMeasurement
    model: OperationalModel
    error: Array
    rate: Array


class ControlLaw(Protocol):
    """A control law of one's own: a function of what is measured."""

    def __call__(self, seen: LawInput, /) -> tuple[Array, Array]:
        """Return the wrenches of a period.

        Args:
            seen: what is measured.

        Returns:
            (6,) on the hand by the device, and (6,) on the mechanism by the hand; N and N m, world
            axes.
        """
        ...


class LawControl(ControlArchitecture):
    """Controllers whose wrenches are those of a law; see :func:`control_for`."""

    def __init__(self, scene: Scene, law: ControlLaw) -> None:
        super().__init__(scene)
        self._law = law

    def apply_gains(self, gains: Controller, delay: float | None = None) -> None:
        """Take gains, none of which the device corrects by."""
        super().apply_gains(gains.closed_in_device(False), delay)

    def answer(
        self,
        time: float,
        clutch: Clutch,
        device: Array,
        operational_model: Array,
        ahead: float,
        in_flight: InFlight | None = None,
    ) -> Array:
        """Return the wrenches for measurements, (6, 6): rows and units of :class:`ControlOutput`.

        Args:
            time: s.
            clutch: that connects the two poses.
            device: (19,) the device's sample, in SI units; see ``layout.DEVICE_SAMPLE``.
            operational_model: (139,) in SI units; see ``layout.OPERATIONAL_MODEL``.
            ahead: s, from the time of ``operational_model`` to that of ``device``.
            in_flight: commands to the mechanism that have not acted yet.

        Raises:
            InvalidInputError: a wrench of the law that is none, or not finite.
        """
        own, point = device_of(device), point_ahead(operational_model, ahead, in_flight)
        error = self.task * pose_error(point.pose, clutch.mapped(own.pose))
        rate = self.task * (own.twist - point.twist)
        seen = LawInput(time, own, point, model_of(operational_model), error, rate)
        on_hand, on_mechanism = (clutch.ramp(time) * one for one in _checked(self._law(seen)))
        wrenches = np.zeros((6, 6))
        wrenches[0] = self.joined(time, clutch, limited(self.task * on_hand, *self.limits))
        wrenches[1] = limited(self.task * on_mechanism, *self.limits)
        wrenches[5] = error
        return wrenches


def control_for(scene: Scene, law: ControlLaw) -> ControlArchitecture:
    """Return controllers with a law of one's own in place of the scene's three.

    ``Session(scene, control=control_for(scene, law))``. Wrenches of the law are kept within the
    device's limits and the task space, and grow over the ramp of each engagement. The device
    corrects none of them. Passivity control, energies, the connection and the safety envelope are
    the scene's.

    Args:
        scene: whose device, limits, ramps and task space are used.
        law: called once for each sample that the controllers get.
    """
    return LawControl(scene, law)


def _checked(wrenches: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return a law's wrenches.

    Raises:
        InvalidInputError: they are not two of (6,), or not finite.
    """
    found = np.asarray(wrenches, dtype=float)
    if found.shape != (2, 6) or not np.isfinite(found).all():
        rule = "must be two finite wrenches (6,): on the hand, and on the mechanism"
        raise InvalidInputError("wrenches of the control law", found.tolist(), rule)
    return found[0], found[1]
