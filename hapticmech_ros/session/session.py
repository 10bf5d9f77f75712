# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Device, mechanism, analysis and control in one process, one tick at a time, without ROS.

The reference for the graph of nodes: same core objects, same order, no clock. Bitwise repeatable.

One call of a kernel does a tick, or many. A device, a hand or a control law in Python is called in
its place, and the kernel does the rest of the tick around it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from hapticmech_ros.compilation import arrays_of
from hapticmech_ros.contact.step_kernels import MORE_WORKSPACE
from hapticmech_ros.control import Clutch
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.loop_delay import compensated_loop_delay, periods_before
from hapticmech_ros.control.loop_layout import (
    ActingWrenches,
    Answer,
    ControllerAccount,
    ControllerSettings,
    DeviceAccount,
    HandMemory,
    Locality,
)
from hapticmech_ros.control.other_hands import NO_OTHERS, coupling_gain
from hapticmech_ros.control.passivity import DeviceSide, PassivityController
from hapticmech_ros.control.rendering_controller import RenderingController
from hapticmech_ros.device import (
    NO_WRENCH,
    DeviceState,
    ImpedanceDevice,
    SimulatedDevice,
    device_for,
)
from hapticmech_ros.device.kernels import DeviceModel
from hapticmech_ros.device.safety import MotionCheck, SafetyEnvelope
from hapticmech_ros.device.safety_kernels import Safety
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.closures import grasped
from hapticmech_ros.mechanism.kernels.layout import ActiveSet
from hapticmech_ros.mechanism.motion import NOTHING
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import ControllerEnergies, DeviceSample, OperationalModelSample
from hapticmech_ros.numerics.times import nanoseconds
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.analysis import contact_wrench
from hapticmech_ros.operational.observation import ConstraintCounter, Observation
from hapticmech_ros.operational.results import OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.scene.mechanism import Origin
from hapticmech_ros.session.sample import Run, Sample, begin_totals, run_layout, state_of
from hapticmech_ros.session.tick_kernels import (
    ALL,
    ANSWERED,
    AT,
    CLOCK_SIZE,
    CONTACTS,
    DEVICE,
    EVERY,
    INPUTS,
    KERNEL_ARGUMENTS,
    KNOWN,
    MECHANISM,
    OBSERVATION_FAILED,
    OBSERVE,
    PHASES,
    RECEIVE,
    RECORDED,
    RECORDS,
    RENDER,
    SENSE,
    TICK,
    TICKS,
    WHY,
    WORK,
    SessionData,
    SessionTotals,
    run_ticks,
)
from hapticmech_ros.simulation import MechanismState, Simulator

if TYPE_CHECKING:
    from hapticmech_ros.contact.memory import Touching

_MODEL_SIZE = OperationalModelSample.layout.size
# Before a tick: its time, and the states of mechanism and device as far as they are known as such.
Begun = tuple[float, MechanismState | tuple[MechanismState, "Touching | None"], DeviceState | None]
_NO_CONTACTS = np.zeros(0, dtype=np.int64), np.zeros(0)
NO_RECORDS = np.zeros((0, 0))
# Wrenches by others in a tick without any.
_NOTHING = np.zeros((1, 12))
_NOTHING.flags.writeable = False


class Session:
    """A scene, running.

    Args:
        scene: what to run.
        point: operational point that the device holds; the first that is held if empty. Device,
            hand, gains and connection are its own where the scene has several ``hands``; those at
            other points are ignored, see :class:`.SharedSession`.
        command_delay: whole periods between measuring and acting. One is what the graph of nodes
            has: a command computed from this tick's measurements acts from the next tick on.
        control: controllers other than the scene's; None for the scene's.
        device: a device other than the scene's; None for the scene's.
        simulator: of the mechanism, where several sessions share one; made anew if None.

    Raises:
        InvalidInputError: a delay below 0, or no such operational point.
    """

    def __init__(
        self,
        scene: Scene,
        point: str = "",
        command_delay: int = 1,
        control: ControlArchitecture | None = None,
        device: SimulatedDevice | None = None,
        simulator: Simulator | None = None,
    ) -> None:
        if command_delay < 0:
            raise InvalidInputError("command_delay", command_delay, "must be 0 or more periods")
        point = scene.operational_point(point or scene.held_points[0]).name
        self.scene = scene = scene.held_at(point)
        self.simulator = Simulator(scene) if simulator is None else simulator
        self.period = self.simulator.period
        self._compensated_delay = compensated_loop_delay(scene, command_delay)
        self._periods_before = periods_before(scene, command_delay)
        self._analyser = Analyser(self.simulator.mechanism, point, self._compensated_delay)
        self._control = ControlArchitecture(scene) if control is None else control
        self._device: SimulatedDevice = device_for(scene) if device is None else device
        self._simulated = isinstance(self._device, ImpedanceDevice) and self._device.plain
        # For a user's own device, whose samples may be anything.
        self._motion = None if device is None else MotionCheck(scene.device, self.period)
        state = self.simulator.initial_state()
        start = self.simulator.evaluate(state).points[self._analyser.index].pose
        self._held: DeviceState = self._device.at_rest(start, held=True)
        self._device_state: DeviceState | None = self._held
        self._clutch: Clutch | None = None
        # Clutch, gains and delay of the controllers' settings, if these are up to date.
        self._settled: tuple[Clutch, Controller, float] | None = None
        self._side = RenderingController(
            self._control, self.period, scene.connection, command_delay
        )
        self._device_side = DeviceSide(scene)
        self._device_side.envelope.place(self._held.published[:3])
        self._counter = ConstraintCounter(scene.perception)
        self._carried: Array | None = None
        counted = np.zeros(CLOCK_SIZE, dtype=np.int64)
        # One of its numbers is read and written here many times a tick: NumPy takes twice as long.
        self._clock = counted.data
        self._stepper = self.simulator.stepper
        self._contacts = self.simulator.contact_memory()
        self._data = self._allocated()
        self._sampled = self._data.sampled()
        # Found once: each look at the data makes a view.
        self._parts = SimpleNamespace(
            **{name: getattr(self._data, name) for name in SessionData.parts}
        )
        mechanism = self.simulator.mechanism
        self.layout = run_layout(mechanism.nq, mechanism.nv)
        self._chosen: ActiveSet | None = None
        self._packed = np.zeros((4, 0))
        self._may_latch = False
        # Of the kernel, in its order; those that never change.
        self._arguments = np.empty(KERNEL_ARGUMENTS, dtype=object)
        contacts = _NO_CONTACTS if self._contacts is None else self._contacts.arrays
        own = self._stepper.work, self._data.numbers, self._data.data
        self._give(WORK, (*own, None, None, *contacts, counted))
        # The mechanism's state now, if it is known as such; and the last one that was.
        self._mechanism_state: MechanismState | None = state
        self._known = state
        self.put(state)

    def __repr__(self) -> str:
        return f"Session of {self.scene.name} at {self.time:g} s"

    @property
    def time(self) -> float:
        """Time of the next tick, s."""
        return self._clock[TICK] * self.period

    @property
    def device(self) -> DeviceState:
        """State of the device at the next tick."""
        if self._device_state is None:
            self._device_state = DeviceState(self._parts.state.copy())
        return self._device_state

    @property
    def mechanism(self) -> MechanismState:
        """State of the mechanism at the next tick."""
        if self._mechanism_state is None:
            parts = self._parts
            moved = parts.totals, parts.q.copy(), parts.v.copy()
            self._mechanism_state = state_of(self._known, *moved, self._touching())
        return self._mechanism_state

    def go_on(self, state: MechanismState) -> None:
        """End a tick that :meth:`answer` began: the mechanism is at ``state`` at the next one."""
        self.put(state)
        self._clock[TICK] += 1

    def begun(self) -> Begun:
        """Return the time and the known states before a tick."""
        known = self._mechanism_state or (self._known, self._touching())
        return self.time, known, self._device_state

    def sample(self, begun: Begun) -> Sample:
        """Return the sample of a tick that has been done."""
        time, known, device = begun
        values = self._sampled.copy()
        return Sample(time, self._data.numbers, values, self._analyser, known, device)

    @property
    def clutch(self) -> Clutch | None:
        """The clutch; None before the first tick."""
        return self._clutch

    @property
    def energies(self) -> ControllerEnergies:
        """The controllers' account; see :mod:`~hapticmech_ros.control.account_kernels`."""
        return ControllerEnergies(self._side.account.energies.values.copy())

    @property
    def passivity(self) -> PassivityController:
        """The device's account."""
        return self._device_side.passivity

    @property
    def envelope(self) -> SafetyEnvelope:
        """The device's safety envelope."""
        return self._device_side.envelope

    @property
    def motion(self) -> MotionCheck | None:
        """The check of samples of a user's own device; None for others."""
        return self._motion

    @property
    def controller(self) -> RenderingController:
        """The controllers' side of the loop."""
        return self._side

    @property
    def compensation(self) -> Array:
        """(6,) the driver's addition to the next tick's command, N and N m, world axes."""
        return self._device.compensation(self.device)

    def tune(self, gains: Controller) -> None:
        """Change to other gains gradually, over their ``gain_ramp``."""
        self._control.tune(self.time, gains)

    def tick(
        self,
        external_wrench: Array | None = None,
        hand_wrench: Array | None = None,
        on_links: Mapping[str, Array] | None = None,
    ) -> Sample:
        """Advance mechanism and device by one period; return measurements and commands.

        Args:
            external_wrench: (6,) on the mechanism at the operational point, N and N m, world axes,
                held over the period; none if left out.
            hand_wrench: (6,) on the device at the point held, N and N m, world axes, beside the
                hand's own and held over the period; none if left out.
            on_links: (6,) by name of the link, on the mechanism at its frame's origin, N and N m,
                world axes, held over the period; none if left out. F_c has no part of them.

        Raises:
            ClosureError: a closed loop came apart.
            InaccurateStepError: a step's energy account is off by a tenth of the energy exchanged.
            InvalidInputError: the state is no longer finite, an unknown link, or a wrench of
                another shape, not finite or beyond ``limits``; nothing has moved then.
        """
        pushed = checked_pushes(self.simulator, on_links or NOTHING)
        inputs, limits = _NOTHING, self.scene.limits
        if external_wrench is not None or hand_wrench is not None:
            inputs = np.zeros((1, 12))
        if external_wrench is not None:
            inputs[0, :6] = checked_wrench("external_wrench", external_wrench, limits)
        if hand_wrench is not None:
            inputs[0, 6:] = checked_wrench("hand_wrench", hand_wrench, limits)
        begun = self.begun()
        if pushed:
            # The kernel does not know wrenches on links.
            self._clock[EVERY] = 0
            self._all_but_mechanism(inputs, NO_RECORDS)
            self._step_in_python(pushed)
        else:
            self._go(1, inputs, NO_RECORDS, 0)
        return self.sample(begun)

    def run(
        self,
        ticks: int,
        external_wrench: Array | None = None,
        hand_wrench: Array | None = None,
        every: int = 1,
        into: Array | None = None,
        show: Callable[[Run], None] | None = None,
        chunk: int = 1000,
    ) -> Run:
        """Do many ticks, and return their samples; the same numbers as :meth:`tick`.

        Args:
            ticks: how many.
            external_wrench: as of :meth:`tick`: (6,) for all of them, or (ticks, 6).
            hand_wrench: (6,) or (ticks, 6), likewise.
            every: ticks from one row to the next; rows are of ticks whose number since the
                session's start is a multiple of it.
            into: (rows or more, width) float64 in C order to fill, such as a ``numpy.memmap``, with
                ``session.layout.size`` columns; made anew if left out.
            show: called with the rows that have come since the last call, every ``chunk`` ticks and
                at the end. If given, and ``into`` is not, rows are kept for one chunk only, and the
                last one is returned.
            chunk: ticks between calls of ``show``.

        Raises:
            ClosureError: a closed loop came apart.
            InaccurateStepError: a step's energy account is off by a tenth of the energy exchanged.
            InvalidInputError: as :func:`check_counts`; the state is no longer finite; or arrays of
                another shape, not finite or beyond ``limits``.
        """
        check_counts(ticks, every, chunk)
        inputs = _inputs(ticks, external_wrench, hand_wrench, self.scene.limits)
        first = self._clock[TICK]
        apart = ticks if show is None else chunk
        rows = self._rows(into, first, ticks, apart if into is None else ticks, every)
        done, filled, shown = 0, 0, 0
        while done < ticks:
            count = min(apart, ticks - done)
            if show is not None and into is None:
                filled = shown = 0
            self._go(count, inputs[done:] if len(inputs) > 1 else inputs, rows[filled:], every)
            done += count
            filled += self._clock[RECORDED]
            if show is not None:
                show(Run(rows[shown:filled], self.layout))
                shown = filled
        return Run(rows[:filled], self.layout)

    def switch_closure(self, name: str, closed: bool) -> None:
        """Open or close a loop between two ticks.

        Raises:
            InvalidInputError: unknown closure, or one too far open to be closed.
        """
        self.put(self.simulator.switch(self.mechanism, {name: closed}))

    def set_operational_point(self, frame: str, origin: Origin | None = None) -> None:
        """Hold the mechanism elsewhere from the next tick on, without a bump.

        The device's wrench is carried on and fades over the scene's ``grasp_ramp``, in which the
        new grasp closes; see :mod:`~hapticmech_ros.control.clutch`. The hand's wrench on the
        mechanism at the old place ends at once.

        Args:
            frame: a link, or an operational point of the scene.
            origin: where in it; its own origin if left out.

        Raises:
            InvalidInputError: as :func:`~hapticmech_ros.mechanism.closures.grasped`.
        """
        point = grasped(self.simulator.scene, self._analyser.point.name, frame, origin)
        state = self.mechanism
        self.simulator.set_operational_point(point)
        self._analyser = Analyser(self.simulator.mechanism, point.name, self._compensated_delay)
        self._parts.metric[:] = self._analyser.constants
        self._side.held_elsewhere()
        self._carried = self._given.wrenches.on_hand.copy()
        self._counter.begin()
        self.put(state)

    @property
    def answered(self) -> Array:
        """(6,) by the hand on the mechanism, of the last answer, which may not act yet."""
        return self._given.wrenches.on_mechanism

    def sense(self, inputs: Array) -> Array:
        """Begin a tick: sample the device; return (6,) F_h, N and N m, world axes.

        Args:
            inputs: (1, 12) by others, as of :meth:`answer`.
        """
        if self._simulated:
            self._call(SENSE, inputs, NO_RECORDS)
        else:
            self._sense_in_python(inputs[0])
        return DeviceSample(self._parts.sample).hand_wrench.copy()

    def answer(self, inputs: Array, rows: Array, correction: Array) -> Array:
        """Do a tick, begun by :meth:`sense`, up to the mechanism's step, which is another's to do.

        Args:
            inputs: (1, 12) by others on the mechanism at the operational point, which counts as
                F_c, and on the device at the point held; N and N m, world axes.
            rows: (1, width) to fill with the tick's record, or (0, 0) for none.
            correction: (19,) of the command that acts now, for other hands; see ``other_hands``.

        Returns:
            (6,) by the hand on the mechanism at the operational point, N and N m, world axes.
        """
        clock = self._clock
        clock[EVERY], clock[RECORDED] = len(rows), 0
        self._parts.others[:] = correction
        self._answer_sample(inputs, rows, OBSERVE)
        return ActingWrenches(self._parts.wrenches).on_mechanism.copy()

    def coupling_gain(self, transmitted: Array, share: float) -> Array:
        """Return H_j (6, 6) of this tick's answer; see :mod:`~hapticmech_ros.control.other_hands`.

        Args:
            transmitted: (6, 6) Y_ij, 1, m and 1/m.
            share: C3_j.
        """
        settings, model = self._parts.settings, self._parts.observation[:_MODEL_SIZE]
        return coupling_gain(settings, model, self.time, transmitted, share)

    @property
    def answers_in_python(self) -> bool:
        """Whether a user's own control law answers, whose dependence on F_c is not known."""
        return self._control.answers_in_python

    @property
    def analysis(self) -> OperationalAnalysis:
        """Analysis of the operational point at this tick, once it is answered."""
        found, nv = self._parts.observation.copy(), self.simulator.mechanism.nv
        return Observation(found, self._analyser.rows, nv).analysis

    @property
    def _given(self) -> Answer:
        """The last answer that was given, whether it has arrived or not."""
        return Answer(self._parts.answers[-1] if self._side.is_ideal else self._parts.given)

    def _allocated(self) -> SessionData:
        """Return the data of all parts in one array; the parts are views of it from now on."""
        side, device, envelope = self._side, self._device_side, self._device_side.envelope
        analysis, mechanism = self._analyser, self.simulator.mechanism
        channels, passivity = side.channels, device.passivity
        nothing, nowhere = np.zeros(0, dtype=np.int64), np.zeros((0, 0))
        body = DeviceModel().values
        if isinstance(self._device, ImpedanceDevice):
            self._device.take_hold(self._held)
            body = self._device.data
        state = self._held.flat
        law = (0.0, 0.0, 0.0) if channels is None else channels[0].law
        sizes = {
            "index": self._analyser.index,
            "steps": self.scene.simulation.substeps,
            "stages": self._stepper.stages,
            "implicit": self._stepper.implicit,
            "connected": int(channels is not None),
            "period_ns": nanoseconds(self.period),
            "received": 1,
        }
        parts = {
            "rows": self._analyser.rows,
            "forth_state": nothing if channels is None else channels[0].state,
            "back_state": nothing if channels is None else channels[1].state,
            "times": np.array((self.period, mechanism.length, self._compensated_delay, *law)),
            "metric": analysis.constants,
            "observation": np.zeros(analysis.observation_size),
            "controller": side.account.values,
            "settings": ControllerSettings().values,
            "faded": np.zeros(6),
            "commanded": side.queue,
            "account": passivity.account.values,
            "safety": envelope.numbers.values,
            # Those in flight, the row after them, and the one that has arrived last.
            "answers": np.zeros((len(side.queue) + 2, Answer.layout.size)),
            "sample": np.zeros(DeviceSample.layout.size),
            "device": body,
            "state": state,
            "later": state,
            "counter": self._counter.numbers.values,
            "wrenches": ActingWrenches().values,
            **dict.fromkeys(("external", "push", "contact", "added"), np.zeros(6)),
            "others": NO_OTHERS.copy(),
            "locality": Locality().values,
            "forth": nowhere if channels is None else channels[0].rows,
            "back": nowhere if channels is None else channels[1].rows,
            "given": Answer().values,
            "q": np.zeros(mechanism.nq),
            "v": np.zeros(mechanism.nv),
            "totals": SessionTotals().values,
            "began_state": state,
            "began_q": np.zeros(mechanism.nq),
            "began_v": np.zeros(mechanism.nv),
            "began_totals": SessionTotals().values,
            "hand": HandMemory().values,
            "past": np.zeros((self._periods_before + 1, 1 + mechanism.nv)),
            "before": np.zeros(1 + mechanism.nv),
        }
        data = SessionData(*arrays_of(SessionData, sizes, parts))
        side.account, side.queue = ControllerAccount(data.controller), data.commanded
        passivity.account, envelope.numbers = DeviceAccount(data.account), Safety(data.safety)
        self._counter.numbers = data.counter
        if channels is not None:
            forth, back = channels
            forth.state, forth.rows = data.forth_state, data.forth
            back.state, back.rows = data.back_state, data.back
        return data

    def _touching(self) -> Touching | None:
        return None if self._contacts is None else self._contacts.touching()

    def put(self, state: MechanismState) -> None:
        """Go on from another state of the mechanism at the next tick."""
        mechanism, data, clock = self.simulator.mechanism, self._parts, self._clock
        active_set = mechanism.active_set(state.active)
        if active_set is not self._chosen:
            self._chosen = active_set
            self._packed = np.zeros((4, active_set.size))
            self._give(0, (*active_set.constants, self._packed))
        if state.active != self._known.active:
            # Closing or opening changes rates in no time.
            data.past[:] = 0.0
        self._may_latch = self.simulator.may_latch(state)
        data.q[:] = state.q
        data.v[:] = state.v
        begin_totals(data.totals, state)
        if self._contacts is not None:
            self._contacts.begin_with(state.touching)
        closing = self.simulator.closing(state)
        clock[AT] = 0
        clock[KNOWN] = closing.active_set is active_set
        if clock[KNOWN]:
            self._packed[0] = closing.packed
        self._mechanism_state = self._known = state

    def _give(self, first: int, arguments: Sequence[Array | None]) -> None:
        """Give the kernel arguments from the first one on."""
        # One by one: NumPy would make one array of several.
        for index, argument in enumerate(arguments, first):
            self._arguments[index] = argument

    def _go(self, ticks: int, inputs: Array, rows: Array, every: int) -> None:
        """Do ticks, as many in a call of the kernel as nothing interrupts."""
        clock, control = self._clock, self._control
        clock[EVERY], clock[RECORDED] = every, 0
        plain = not control.answers_in_python and self._simulated
        done = 0
        while done < ticks:
            given = inputs[done:] if len(inputs) > 1 else inputs
            clutch = self._clutch
            waits = self._carried is not None or not plain
            if clutch is None or clutch.is_closing or waits:
                self._tick_in_parts(given[:1], rows)
                done += 1
                continue
            self._set(clutch)
            first, latching = clock[TICK], self._may_latch
            alone = latching or control.is_ramping
            code = self._call(ALL, given, rows, 1 if alone else ticks - done)
            if code == OBSERVATION_FAILED:
                self._observe_in_python()
                code = self._call(ALL & ~(SENSE | OBSERVE), given, rows)
            if code:
                self._finish_step()
            elif latching:
                self._latch()
            done += clock[TICK] - first

    def _call(self, phases: int, inputs: Array, rows: Array, ticks: int = 1) -> int:
        """Do phases of ticks by the kernel; return why it ended."""
        clock, arguments = self._clock, self._arguments
        clock[TICKS], clock[PHASES] = ticks, phases
        arguments[INPUTS], arguments[RECORDS] = inputs, rows
        self._stepper.prepare()
        if phases & DEVICE:
            self._device_state = None
        if phases & MECHANISM:
            self._mechanism_state = None
        return run_ticks(arguments)  # type: ignore[call-arg]

    def _tick_in_parts(self, inputs: Array, rows: Array) -> None:
        """Do a tick in which something is done in Python."""
        self._all_but_mechanism(inputs, rows)
        if self._call(MECHANISM, inputs, rows):
            self._finish_step()
        elif self._may_latch:
            self._latch()

    def _all_but_mechanism(self, inputs: Array, rows: Array) -> None:
        """Do the phases of a tick up to the mechanism's step."""
        if not self._simulated:
            self._sense_in_python(inputs[0])
        self._answer_sample(inputs, rows, (SENSE if self._simulated else 0) | OBSERVE)

    def _answer_sample(self, inputs: Array, rows: Array, first: int) -> None:
        """Do the phases of a tick up to the mechanism's step, ``first`` those that come first."""
        control, simulated = self._control, self._simulated
        if self._call(first, inputs, rows):
            self._observe_in_python()
        self._call(RECEIVE, inputs, rows)
        clutch = self._engaged_clutch()
        self._set(clutch)
        faulty = self._motion is not None and bool(self._motion.fault)
        if faulty:
            self._given.values[:] = 0.0
        elif control.answers_in_python and self._data.received:
            self._answer_in_python(clutch)
        self._clock[ANSWERED] = control.answers_in_python or faulty
        self._call(RENDER | (DEVICE if simulated else 0), inputs, rows)
        self._clock[ANSWERED] = 0
        if not simulated:
            self._move_device_in_python()

    def _set(self, clutch: Clutch) -> None:
        """Give the kernel the controllers' present settings."""
        control, known = self._control, self._settled
        if known is not None and not control.is_ramping:
            # Other gains are another object, and so is another clutch.
            same = known[0] is clutch and known[1] is control.gains and known[2] is control.delay
            if same:
                return
        self._settled, data, time = None, self._parts, self.time
        data.settings[:] = control.settings_at(time, clutch)
        data.faded[:] = clutch.faded(time)
        data.locality[:] = self._side.locality(corrects=True, with_model=True).values
        if not (clutch.is_closing or control.is_ramping):
            self._settled = clutch, control.gains, control.delay

    def _sense_in_python(self, given: Array) -> None:
        """Take the sample of a device that is written in Python."""
        data, device, state = self._parts, self._device, self.device
        data.external[:] = given[:6]
        data.push[:] = given[6:]
        data.sample[:] = state.published[: DeviceSample.layout.size]
        DeviceSample(data.sample).hand_wrench[:] = state.reported + device.sensed(data.push)
        data.added[:] = device.compensation(state)
        data.state[:] = state.flat
        if self._motion is not None:
            self._check_motion(self._motion)

    def _check_motion(self, motion: MotionCheck) -> None:
        """Compare a sample with the one before; disengage where they are no motion of a device."""
        before = motion.faults
        motion.check(self._parts.sample, self._clock[TICK] * nanoseconds(self.period))
        if motion.faults > before:
            warnings.warn(f"disengaged: {motion.fault}", RuntimeWarning, stacklevel=2)
            self._parts.answers[:] = self._parts.commanded[:] = 0.0
            self._device_side.begin()
        if motion.fault:
            self._clutch = None
            # For the energy accounts it stands still: the measured motion is not real.
            DeviceSample(self._parts.sample).fill(twist=NO_WRENCH, hand_wrench=NO_WRENCH)

    def _observe_in_python(self) -> None:
        """Analyse where the kernel could not, or raise the error."""
        state, data = self.mechanism, self._parts
        closing = self.simulator.closing(state)
        found = self._analyser.observe(state.q, state.v, state.active, closing, data.before)
        data.observation[:] = found.numbers
        data.contact[:] = 0.0
        if state.touching is not None and state.touching.joint_force.any():
            terms, force = self.simulator.evaluate(state), state.touching.joint_force
            data.contact[:] = contact_wrench(self._analyser, terms, force)

    def _answer_in_python(self, clutch: Clutch) -> None:
        """Answer the received sample by a control law in Python."""
        data, side, time = self._parts, self._side, self.time
        received = data.sample if side.is_ideal else data.forth[-1]
        operational_model, flying = data.observation[:_MODEL_SIZE], None
        if Locality(data.locality).force_channel != 0.0:
            flying = side.in_flight(side.queue, data.settings, received, operational_model, time)
        found = self._control.answer(
            time, clutch, received.copy(), operational_model.copy(), 0.0, flying
        )
        self._given.wrenches.values[:] = found.ravel()

    def _move_device_in_python(self) -> None:
        """Move a device that is written in Python on by a period."""
        command = ActingWrenches(self._parts.wrenches).on_hand.copy()
        push, tick = self._parts.push.copy(), self._clock[TICK]
        self._device_state = self._device.step(self.device, command, self._held, tick, push)

    def _latch(self) -> None:
        """Close the closures that latch at the state to which a step has led."""
        state = self.mechanism
        latched = self.simulator.latch(state)
        if latched is not state:
            self.put(latched)

    def _finish_step(self) -> None:
        """Move the mechanism on where the kernel cannot.

        That is at singular positions, and where nearest points of shapes are searched for.
        """
        if self._contacts is not None and self._clock[WHY] == MORE_WORKSPACE:
            self._contacts.enlarge()
            self._give(CONTACTS, self._contacts.arrays)
        self._step_in_python(NOTHING)

    def _step_in_python(self, on_links: Mapping[str, Array]) -> None:
        """Move the mechanism on, with wrenches (6,) on links at their frames' origins."""
        data, state = self._parts, self.mechanism
        wrenches = np.zeros((len(self.simulator.mechanism.point_names), 6))
        acting = ActingWrenches(data.wrenches)
        wrenches[self._analyser.index] = acting.on_mechanism + data.external
        self.go_on(self.simulator.step(state, wrenches, on_links))

    def _engaged_clutch(self) -> Clutch:
        """Return the clutch, engaged anew at the start and if the mechanism is held elsewhere."""
        clutch, control, data, time = self._clutch, self._control, self._parts, self.time
        device, operational_model = data.sample.copy(), data.observation[:_MODEL_SIZE].copy()
        if clutch is None or self._carried is not None:
            clutch = control.engage(time, device, operational_model, 0.0, self._carried)
            self._carried = None
        self._clutch = control.with_slip(time, clutch, device, operational_model)
        return self._clutch

    def _rows(self, into: Array | None, first: int, ticks: int, at_once: int, every: int) -> Array:
        """Return rows to fill.

        Raises:
            InvalidInputError: the array has another size or type.
        """
        width = self.layout.size
        if into is None:
            return np.empty((at_once // every + 1, width))
        needed = len(range(-first % every, ticks, every))
        fits = into.dtype == np.float64 and into.ndim == 2 and into.flags.c_contiguous
        if not (fits and into.shape[0] >= needed and into.shape[1] == width):
            rule = f"must be ({needed} or more, {width}) of float64 in C order"
            raise InvalidInputError("shape of into", into.shape, rule)
        return np.asarray(into)


def checked_wrench(name: str, given: Array, limits: Limits) -> Array:
    """Return a wrench (6,) as it was given.

    Args:
        name: of it, for errors.
        given: (6,) N and N m.
        limits: of the scene, as for messages.

    Raises:
        InvalidInputError: an array of another shape, NaN, infinity, or beyond the limits.
    """
    if np.shape(given) != (6,):
        raise InvalidInputError(f"shape of {name}", np.shape(given), "must be (6,)")
    return _bounded(name, given, limits)


def checked_pushes(simulator: Simulator, on_links: Mapping[str, Array]) -> dict[str, Array]:
    """Return wrenches (6,) on links as they were given, by link.

    Args:
        simulator: of the mechanism.
        on_links: (6,) by name of the link, N and N m.

    Raises:
        InvalidInputError: an unknown link; and as :func:`checked_wrench`.
    """
    for link, wrench in on_links.items():
        simulator.mechanism.link_place(link)
        checked_wrench(f"wrench on {link}", wrench, simulator.scene.limits)
    return dict(on_links)


def _bounded(name: str, given: Array, limits: Limits) -> Array:
    """Return wrenches (..., 6) as they were given.

    Raises:
        InvalidInputError: NaN, infinity, or beyond the limits.
    """
    most = (limits.force,) * 3 + (limits.torque,) * 3
    sound = np.abs(given) <= most
    if not sound.all():
        row = given if np.ndim(given) == 1 else given[int(np.argmin(sound.all(axis=-1)))]
        force, torque = f"{limits.force:g} N (limits.force)", f"{limits.torque:g} N m"
        rule = f"must be finite numbers, of at most {force} and {torque} (limits.torque)"
        raise InvalidInputError(name, np.asarray(row).tolist(), rule)
    return given


def check_counts(ticks: int, every: int, chunk: int = 1) -> None:
    """Raise for numbers of ticks that a run cannot have.

    Args:
        ticks: of the run.
        every: from one row to the next.
        chunk: between two calls of a run's ``show``.

    Raises:
        InvalidInputError: one that is not whole; fewer than 0 ticks, or another below 1.
    """
    for name, value, least in (("ticks", ticks, 0), ("every", every, 1), ("chunk", chunk, 1)):
        if not isinstance(value, Integral) or value < least:
            raise InvalidInputError(name, value, f"must be a whole number, {least} or more")


def _inputs(ticks: int, external: Array | None, push: Array | None, limits: Limits) -> Array:
    """Return (1 or ticks, 12) wrenches by others.

    Raises:
        InvalidInputError: an array of another shape, NaN, infinity, or beyond the limits.
    """
    given = [
        np.zeros(6) if one is None else np.asarray(one, dtype=float) for one in (external, push)
    ]
    for name, one in zip(("external_wrench", "hand_wrench"), given, strict=True):
        if one.shape not in ((6,), (ticks, 6)):
            raise InvalidInputError(f"shape of {name}", one.shape, f"must be (6,) or ({ticks}, 6)")
        _bounded(name, one, limits)
    rows = 1 if all(one.ndim == 1 for one in given) else ticks
    return np.hstack([np.broadcast_to(one, (rows, 6)) for one in given])
