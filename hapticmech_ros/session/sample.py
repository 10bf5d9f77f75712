"""What a session measured and commanded in one tick."""

from __future__ import annotations

from dataclasses import dataclass

from hapticmech_ros.control import ControlOutput, RenderingModel
from hapticmech_ros.control.flat import model_of
from hapticmech_ros.device import DeviceState
from hapticmech_ros.mechanism import MechanismState, PointKinematics
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.observation import Observation


@dataclass(frozen=True, slots=True)
class Sample:
    """All that was measured and commanded in one tick, at its start.

    Attributes:
        time: s since the session's start; the device is engaged at time 0.
        device, mechanism: states at ``time``.
        seen: the operational point there: its motion, Λ_h⁻¹ and what follows.
        hand_wrench: (6,) F_h on the device, by the hand and by others, as the device reports it.
        external_wrench: (6,) on the mechanism at the operational point, by others.
        contact_wrench: (6,) F_c of virtual objects there, of the step that led here; zero without.
        count: joint constraints reported.
        wrenches: (6, 6) of the controllers, from these measurements; rows as in ``output``.
        acting: (2, 6) over the period that begins: on the hand by the device, and on the mechanism
            by the hand.
    """

    time: float
    device: DeviceState
    mechanism: MechanismState
    seen: Observation
    hand_wrench: Array
    external_wrench: Array
    contact_wrench: Array
    count: int
    wrenches: Array
    acting: Array

    @property
    def point(self) -> PointKinematics:
        """The operational point's kinematics."""
        return self.seen.point

    @property
    def analysis(self) -> OperationalAnalysis:
        """Λ_h⁻¹ and what follows from it."""
        return self.seen.analysis

    @property
    def output(self) -> ControlOutput:
        """The controllers' wrenches."""
        return ControlOutput(*self.wrenches)

    @property
    def model(self) -> RenderingModel:
        """What of the analysis they were computed with: X and a_0 as late as the loop is."""
        return model_of(self.seen.model)
