"""Device, mechanism, analysis and control in one process, one tick at a time, without ROS.

The reference for the graph of nodes: same core objects, same order, no clock. Bitwise repeatable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.control import (
    ControlOutput,
    DeviceMeasurement,
    Engagement,
    PointMeasurement,
    RenderingModel,
    control_for,
)
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.energy_ledger import LedgerEntry
from hapticmech_ros.control.lateness import loop_lateness
from hapticmech_ros.control.passivity import PassivityController
from hapticmech_ros.control.rendering_loop import RenderingLoop
from hapticmech_ros.control.rendering_model import rendering_model
from hapticmech_ros.device import NO_WRENCH, DeviceState, device_for
from hapticmech_ros.device.impedance_device import ImpedanceDevice
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import MechanismState, PointKinematics, Simulator
from hapticmech_ros.mechanism.grasp import grasped
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.contact_wrench import touching_wrench
from hapticmech_ros.operational.counter import CountState, first_count, next_count
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.mechanism import Origin


@dataclass(frozen=True, slots=True)
class Sample:
    """All that was measured and commanded in one tick, at its start.

    Attributes:
        time: s since the session's start; the device is engaged at time 0.
        device, mechanism: states at ``time``.
        point: the operational point's kinematics.
        hand_wrench: (6,) F_h on the device, by the hand and by others, as the device reports it.
        external_wrench: (6,) on the mechanism at the operational point, by others.
        contact_wrench: (6,) F_c of virtual objects there, of the step that led here; zero without.
        analysis: Λ_h⁻¹ and what follows.
        count: joint constraints reported.
        output: the controllers' wrenches computed from these measurements.
        model: what of the analysis they were computed with: X and a_0 as late as the loop is.
    """

    time: float
    device: DeviceState
    mechanism: MechanismState
    point: PointKinematics
    hand_wrench: Array
    external_wrench: Array
    contact_wrench: Array
    analysis: OperationalAnalysis
    count: int
    output: ControlOutput
    model: RenderingModel


class Session:
    """A scene, running.

    Args:
        scene: what to run.
        point: operational point that the device holds; the scene's first one if empty.
        command_delay: whole periods between measuring and acting. One is what the graph of nodes
            has: a command computed from this tick's measurements acts from the next tick on.
        control: controllers other than the scene's; None for the scene's.
        device: a device other than the scene's; None for the scene's.
    """

    def __init__(
        self,
        scene: Scene,
        point: str = "",
        command_delay: int = 1,
        control: ControlArchitecture | None = None,
        device: ImpedanceDevice | None = None,
    ) -> None:
        if command_delay < 0:
            raise InvalidInputError("command_delay", command_delay, "must be 0 or more periods")
        self.scene = scene
        self.simulator = Simulator(scene)
        self.period = self.simulator.period
        self._lateness = loop_lateness(scene, command_delay)
        self._analyser = Analyser(self.simulator.mechanism, point, self._lateness)
        self._index = self._analyser.index
        self._points = len(self.simulator.mechanism.point_names)
        self._control = control_for(scene) if control is None else control
        self._device = device_for(scene) if device is None else device
        self._mechanism_state = self.simulator.initial_state()
        start = self.simulator.evaluate(self._mechanism_state).points[self._index].pose
        self._device_state = self._held = self._device.at_rest(start, held=True)
        self._engagement: Engagement | None = None
        self._loop = RenderingLoop(scene, self._control, command_delay)
        self._count: CountState | None = None
        self._carried: Array | None = None
        self._sent = np.zeros(6)
        self._tick = 0

    @property
    def time(self) -> float:
        """Time of the next tick, s."""
        return self._tick * self.period

    @property
    def energies(self) -> LedgerEntry:
        """The controllers' account; see :mod:`~hapticmech_ros.control.energy_ledger`."""
        return self._loop.side.ledger.entry

    @property
    def passivity(self) -> PassivityController:
        """The device's account."""
        return self._loop.passivity

    @property
    def compensation(self) -> Array:
        """What the device's driver adds to the command of the next tick (6,)."""
        return self._device.compensation(self._device_state)

    def tune(self, gains: Controller) -> None:
        """Pass to other gains, without a bump, over their ``gain_ramp``."""
        self._control.tune(self.time, gains)

    def tick(
        self, external_wrench: Array | None = None, hand_wrench: Array | None = None
    ) -> Sample:
        """Measure, analyse, control, and advance mechanism and device by one period.

        Args:
            external_wrench: (6,) wrench on the mechanism at the operational point, world axes, held
                over the period; none if left out.
            hand_wrench: (6,) on the device at the point held, world axes, beside the hand's own and
                held over the period; none if left out.

        Raises:
            ClosureError: a closed loop came apart.
            InvalidInputError: the state is no longer finite.
        """
        time = self.time
        external = np.zeros(6) if external_wrench is None else np.asarray(external_wrench, float)
        push = NO_WRENCH if hand_wrench is None else np.asarray(hand_wrench, float)
        device, mechanism = self._device_state, self._mechanism_state
        held = device.reported + self._device.sensed(push)
        terms = self.simulator.evaluate(mechanism)
        point = terms.points[self._index]
        analysis = self._analyser.analyse(terms)
        self._count = self._next_count(analysis.spectrum.s, time)
        contact = touching_wrench(terms, analysis, mechanism.touching, self._index)
        measured = DeviceMeasurement(device.measured_pose, device.measured_twist, held)
        late = self._analyser.late(terms, mechanism.q, mechanism.v, mechanism.active, analysis)
        model = rendering_model(analysis, late)
        seen = PointMeasurement(point.pose, point.twist, external + contact)
        engagement = self._tie(time, measured, seen, model)
        numbers = np.concatenate((device.published[:13], held))
        added = self._device.compensation(device)
        applied = device.applied
        acting = self._loop.tick(time, engagement, numbers, applied, seen, model, added)
        output = self._loop.output
        sample = Sample(
            time,
            device,
            mechanism,
            point,
            held,
            external,
            contact,
            analysis,
            self._count.count,
            output,
            model,
        )
        self._sent = output.device
        wrenches = np.zeros((self._points, 6))
        wrenches[self._index] = acting.mechanism + external
        self._mechanism_state = self.simulator.step(mechanism, wrenches)
        self._device_state = self._device.step(device, acting.device, self._held, self._tick, push)
        self._tick += 1
        return sample

    def switch_closure(self, name: str, closed: bool) -> None:
        """Open or close a loop between two ticks.

        Raises:
            InvalidInputError: unknown closure, or one too far open to be closed.
        """
        self._mechanism_state = self.simulator.switch(self._mechanism_state, {name: closed})

    def grasp(self, frame: str, origin: Origin | None = None) -> None:
        """Hold the mechanism elsewhere from the next tick on, without a bump.

        The device's wrench is carried on and fades over the scene's ``engagement_ramp``, in which
        the new grasp closes; see :mod:`~hapticmech_ros.control.engagement`. What the hand did to
        the mechanism at the old place ends at once.

        Args:
            frame: a link, or an operational point of the scene.
            origin: where in it; its own origin if left out.

        Raises:
            InvalidInputError: as :func:`~hapticmech_ros.mechanism.grasp.grasped`.
        """
        point = grasped(self.simulator.scene, self._analyser.point.name, frame, origin)
        self.simulator.grasp(point)
        self._analyser = Analyser(self.simulator.mechanism, point.name, self._lateness)
        self._loop.side.held_elsewhere()
        self._carried = self._sent
        self._count = None

    def _tie(
        self,
        time: float,
        device: DeviceMeasurement,
        point: PointMeasurement,
        model: RenderingModel,
    ) -> Engagement:
        """Return the tie, made anew at the start and if the mechanism is held elsewhere."""
        tie = self._engagement
        if tie is None or self._carried is not None:
            tie = self._control.engage(time, device, point, model, self._carried)
            self._carried = None
        self._engagement = self._control.slipped(time, tie, device, point.twist)
        return self._engagement

    def _next_count(self, s: Array, time: float) -> CountState:
        perception = self.scene.perception
        if self._count is None:
            return first_count(s, perception)
        return next_count(self._count, s, time, perception)
