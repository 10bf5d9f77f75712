"""Device, mechanism, analysis and control in one process, one tick at a time, without ROS.

The reference for the graph of nodes: same core objects, same order, no clock. Bitwise repeatable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control import ControlOutput, Engagement, RenderingModel, control_for
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.controller_side import LedgerEntry
from hapticmech_ros.control.flat import model_of
from hapticmech_ros.control.lateness import loop_lateness
from hapticmech_ros.control.passivity import PassivityController
from hapticmech_ros.control.rendering_loop import RenderingLoop
from hapticmech_ros.device import NO_WRENCH, DeviceState, device_for
from hapticmech_ros.device.impedance_device import ImpedanceDevice
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.layout import OPERATIONAL_MODEL
from hapticmech_ros.mechanism import PointKinematics
from hapticmech_ros.mechanism.grasp import grasped
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.contact_wrench import touching_wrench
from hapticmech_ros.operational.counter import CountState, first_count, next_count
from hapticmech_ros.operational.observation import Observation
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.mechanism import Origin
from hapticmech_ros.simulation import MechanismState, Simulator

_CONTACT = OPERATIONAL_MODEL.slice("contact")


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
        """The controllers' account; see :mod:`~hapticmech_ros.control.account_kernels`."""
        return self._loop.side.entry

    @property
    def passivity(self) -> PassivityController:
        """The device's account."""
        return self._loop.device.passivity

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
        time, index = self.time, self._index
        external = np.zeros(6) if external_wrench is None else np.asarray(external_wrench, float)
        push = NO_WRENCH if hand_wrench is None else np.asarray(hand_wrench, float)
        device, mechanism = self._device_state, self._mechanism_state
        held = device.reported + self._device.sensed(push)
        closing = self.simulator.closing(mechanism)
        seen = self._analyser.observe(mechanism.q, mechanism.v, mechanism.active, closing)
        self._count = self._next_count(seen.s, time)
        contact = self._touching(mechanism, seen)
        model = seen.model
        model[_CONTACT] = external + contact
        measured = np.concatenate((device.published[:13], held))
        engagement = self._tie(time, measured, model)
        added = self._device.compensation(device)
        acting = self._loop.tick(time, engagement, measured, device.applied, model, added)
        rows = self._loop.wrenches
        sample = Sample(
            time, device, mechanism, seen, held, external, contact, self._count.count, rows
        )
        self._sent = rows[0]
        wrenches = np.zeros((self._points, 6))
        wrenches[index] = acting.mechanism + external
        self._mechanism_state = self.simulator.step(mechanism, wrenches)
        self._device_state = self._device.step(device, acting.device, self._held, self._tick, push)
        self._tick += 1
        return sample

    def _touching(self, state: MechanismState, seen: Observation) -> Array:
        """Return F_c (6,) of what touches; zero where nothing does."""
        if state.touching is None or not state.touching.pairs.size:
            return np.zeros(6)
        terms = self.simulator.evaluate(state)
        return touching_wrench(terms, seen.analysis, state.touching, self._index)

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

    def _tie(self, time: float, device: Array, model: Array) -> Engagement:
        """Return the tie, made anew at the start and if the mechanism is held elsewhere.

        Args:
            time: s.
            device: (19,) its sample.
            model: (139,) operational model.
        """
        tie, control = self._engagement, self._control
        if tie is None or self._carried is not None:
            tie = control.engage_flat(time, device, model, 0.0, self._carried)
            self._carried = None
        self._engagement = control.slipped_flat(time, tie, device, model)
        return self._engagement

    def _next_count(self, s: Array, time: float) -> CountState:
        perception = self.scene.perception
        if self._count is None:
            return first_count(s, perception)
        return next_count(self._count, s, time, perception)
