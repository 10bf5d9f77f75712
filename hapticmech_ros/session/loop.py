# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a session's tick consists of: a call of the kernel, or parts of it around what is Python."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.contact.step_kernels import MORE_WORKSPACE
from hapticmech_ros.control import Clutch
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.hand_lead_kernels import MEMORY_SIZE
from hapticmech_ros.control.loop_delay import compensated_loop_delay, periods_before
from hapticmech_ros.control.loop_layout import (
    ANSWER,
    FORCE_LOCAL,
    LOCALITY,
    ON_HAND,
    ON_MECHANISM,
    SETTINGS,
    TOLD,
)
from hapticmech_ros.control.other_hands import NO_OTHERS
from hapticmech_ros.control.passivity import DeviceSide
from hapticmech_ros.control.rendering_controller import RenderingController
from hapticmech_ros.device import (
    DeviceState,
    ImpedanceDevice,
    SimulatedDevice,
    device_for,
)
from hapticmech_ros.device.device_layout import DEVICE_MODEL
from hapticmech_ros.device.motion_check import MotionCheck
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL
from hapticmech_ros.mechanism.kernels.active_set import ActiveSet
from hapticmech_ros.mechanism.motion import NOTHING
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.contact_wrench import contact_wrench
from hapticmech_ros.operational.observation import ConstraintCounter
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.session.data import PARTS, TOTALS, SessionData, session_data
from hapticmech_ros.session.run import run_layout
from hapticmech_ros.session.sample import LeftState, Sample, totals_of
from hapticmech_ros.session.tick_kernels import (
    ALL,
    ANSWERED,
    AT,
    CLOCK_SIZE,
    CONTACTS,
    DEVICE,
    EVERY,
    HEAR,
    INPUTS,
    KERNEL_ARGUMENTS,
    KNOWN,
    MECHANISM,
    OBSERVATION_FAILED,
    OBSERVE,
    PHASES,
    RECORDED,
    RECORDS,
    RENDER,
    SENSE,
    TICK,
    TICKS,
    WHY,
    WORK,
    run_ticks,
)
from hapticmech_ros.simulation import MechanismState, Simulator
from hapticmech_ros.times import nanoseconds

if TYPE_CHECKING:
    from hapticmech_ros.contact.memory import Touching

_MODEL_SIZE = OPERATIONAL_MODEL.size
_FORCE, _WRENCHES = DEVICE_SAMPLE.slice("hand_wrench"), ANSWER.slice("wrenches")
_RATES = DEVICE_SAMPLE.slice("twist", "hand_wrench")
_NOBODY = np.zeros((0, 10))
_CONSTRAINTS = TOTALS.start("constraints")
# Before a tick: its time, and the states of mechanism and device as far as they are known as such.
Begun = tuple[float, MechanismState | tuple[MechanismState, "Touching | None"], DeviceState | None]
_NO_CONTACTS = np.zeros(0, dtype=np.int64), np.zeros(0)


class SessionLoop:
    """Ticks of a session; arguments as of :class:`~hapticmech_ros.session.session.Session`."""

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
        # Of a device of one's own, whose samples may be anything.
        self._motion = None if device is None else MotionCheck(scene.device, self.period)
        state = self.simulator.initial_state()
        start = self.simulator.evaluate(state).points[self._analyser.index].pose
        self._held: DeviceState = self._device.at_rest(start, held=True)
        self._device_state: DeviceState | None = self._held
        self._clutch: Clutch | None = None
        # What the controllers' settings are of, if they need not be found anew.
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
        self._parts = SimpleNamespace(**{name: getattr(self._data, name) for name in PARTS})
        mechanism = self.simulator.mechanism
        self.layout = run_layout(mechanism.nq, mechanism.nv)
        self._chosen: ActiveSet | None = None
        self._constants: tuple[Array, Array] = np.zeros(0, dtype=np.int64), np.zeros(0)
        self._packed = np.zeros((4, 0))
        self._may_latch = False
        # Of the kernel, in its order; those that never change.
        self._arguments = np.empty(KERNEL_ARGUMENTS, dtype=object)
        contacts = _NO_CONTACTS if self._contacts is None else self._contacts.arrays
        own = self._stepper.work, self._stepper.springs, self._data.numbers, self._data.data
        self._give(WORK, (*own, None, None, _NOBODY, *contacts, counted))
        # The mechanism's state now, if it is known as such; and the last one that was.
        self._mechanism_state: MechanismState | None = state
        self._known = state
        self._begin(state)

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
            self._mechanism_state = self._left().state()
        return self._mechanism_state

    @property
    def _given(self) -> Array:
        """The last answer that was given, whether it has arrived or not."""
        answers: Array = self._parts.answers[-1] if self._side.is_ideal else self._parts.given
        return answers

    def _allocated(self) -> SessionData:
        """Return the data of all parts in one array, of which these parts are views from now on."""
        side, device, envelope = self._side, self._device_side, self._device_side.envelope
        analysis, mechanism = self._analyser, self.simulator.mechanism
        channels, passivity = side.channels, device.passivity
        nothing, nowhere = np.zeros(0, dtype=np.int64), np.zeros((0, 0))
        body = np.zeros(DEVICE_MODEL.size)
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
            "heard": 1,
        }
        parts = {
            "rows": self._analyser.rows,
            "forth_state": nothing if channels is None else channels[0].state,
            "back_state": nothing if channels is None else channels[1].state,
            "times": np.array((self.period, mechanism.length, self._compensated_delay, *law)),
            "metric": analysis.constants,
            "observation": np.zeros(analysis.layout.size),
            "controller": side.account,
            "settings": np.zeros(SETTINGS.size),
            "faded": np.zeros(6),
            "told": side.queue,
            "account": passivity.account,
            "safety": envelope.numbers,
            # Those on the way, the row after them, and the one that has arrived last.
            "answers": np.zeros((len(side.queue) + 2, ANSWER.size)),
            "sample": np.zeros(DEVICE_SAMPLE.size),
            "device": body,
            "state": state,
            "later": state,
            "counter": self._counter.numbers,
            "wrenches": np.zeros((TOLD + 1, 6)),
            **dict.fromkeys(("external", "push", "contact", "added"), np.zeros(6)),
            "others": NO_OTHERS.copy(),
            "locality": np.zeros(LOCALITY.size),
            "forth": nowhere if channels is None else channels[0].rows,
            "back": nowhere if channels is None else channels[1].rows,
            "given": np.zeros(ANSWER.size),
            "q": np.zeros(mechanism.nq),
            "v": np.zeros(mechanism.nv),
            "totals": np.zeros(TOTALS.size),
            "began_state": state,
            "began_q": np.zeros(mechanism.nq),
            "began_v": np.zeros(mechanism.nv),
            "began_totals": np.zeros(TOTALS.size),
            "hand": np.zeros(MEMORY_SIZE),
            "past": np.zeros((self._periods_before + 1, 1 + mechanism.nv)),
            "before": np.zeros(1 + mechanism.nv),
        }
        data = session_data(sizes, parts)
        side.account, side.queue = data.controller, data.told
        passivity.account, envelope.numbers = data.account, data.safety
        self._counter.numbers = data.counter
        if channels is not None:
            forth, back = channels
            forth.state, forth.rows = data.forth_state, data.forth
            back.state, back.rows = data.back_state, data.back
        return data

    def go_on(self, state: MechanismState) -> None:
        """End a tick that :meth:`answer` began: the mechanism is at ``state`` at the next one."""
        self._begin(state)
        self._clock[TICK] += 1

    def begun(self) -> Begun:
        """Return what is known as such before a tick."""
        state = self._mechanism_state
        touching = None if self._contacts is None else self._contacts.touching()
        return self.time, (self._known, touching) if state is None else state, self._device_state

    def sample(self, begun: Begun) -> Sample:
        """Return the sample of a tick that has been done."""
        time, known, device = begun
        values = self._sampled.copy()
        return Sample(time, self._data.numbers, values, self._analyser, known, device)

    def _left(self) -> LeftState:
        """Return how the kernel left the mechanism."""
        totals, q, v = (one.copy() for one in (self._parts.totals, self._parts.q, self._parts.v))
        touching = None if self._contacts is None else self._contacts.touching()
        return LeftState(self._known, totals, q, v, touching)

    def _begin(self, state: MechanismState) -> None:
        """Go on from a state of the mechanism."""
        mechanism, data, clock = self.simulator.mechanism, self._parts, self._clock
        active_set = mechanism.active_set(state.active)
        if active_set is not self._chosen:
            self._chosen, self._constants = active_set, active_set.constants
            self._packed = np.zeros((4, active_set.size))
            self._give(0, (*self._constants, self._packed))
        if state.active != self._known.active:
            # Closing or opening changes rates in no time.
            data.past[:] = 0.0
        self._may_latch = self.simulator.may_latch(state)
        data.q[:] = state.q
        data.v[:] = state.v
        data.totals[:] = totals_of(state, data.totals[_CONSTRAINTS])
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
                self._observe_otherwise()
                code = self._call(ALL & ~(SENSE | OBSERVE), given, rows)
            if code:
                self._step_otherwise()
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
        return run_ticks(arguments)  # type: ignore[no-any-return]

    def _tick_in_parts(self, inputs: Array, rows: Array) -> None:
        """Do a tick in which something is done in Python."""
        self._all_but_mechanism(inputs, rows)
        if self._call(MECHANISM, inputs, rows):
            self._step_otherwise()
        elif self._may_latch:
            self._latch()

    def _tick_pushed(self, inputs: Array, rows: Array, on_links: Mapping[str, Array]) -> None:
        """Do a tick in which links are pushed, which the kernel does not know."""
        self._clock[EVERY] = 0
        self._all_but_mechanism(inputs, rows)
        self._step_in_python(on_links)

    def _all_but_mechanism(self, inputs: Array, rows: Array) -> None:
        """Do the phases of a tick up to the mechanism's step."""
        if not self._simulated:
            self._sense_otherwise(inputs[0])
        self._answer_sample(inputs, rows, (SENSE if self._simulated else 0) | OBSERVE)

    def _answer_sample(self, inputs: Array, rows: Array, first: int) -> None:
        """Do the phases of a tick up to the mechanism's step, ``first`` those that come first."""
        control, simulated = self._control, self._simulated
        if self._call(first, inputs, rows):
            self._observe_otherwise()
        self._call(HEAR, inputs, rows)
        clutch = self._engaged_clutch(self.time)
        self._set(clutch)
        faulty = self._motion is not None and bool(self._motion.fault)
        if faulty:
            self._given[:] = 0.0
        elif control.answers_in_python and self._data.heard:
            self._answer_otherwise(self.time, clutch)
        self._clock[ANSWERED] = control.answers_in_python or faulty
        self._call(RENDER | (DEVICE if simulated else 0), inputs, rows)
        self._clock[ANSWERED] = 0
        if not simulated:
            self._move_otherwise()

    def _set(self, clutch: Clutch) -> None:
        """Give the kernel what fixes the controllers now."""
        control, known = self._control, self._settled
        if known is not None and not control.is_ramping:
            # Other gains are another object, and so is another clutch.
            same = known[0] is clutch and known[1] is control.gains and known[2] is control.delay
            if same:
                return
        self._settled, data, time = None, self._parts, self.time
        data.settings[:] = control.settings_at(time, clutch)
        data.faded[:] = control.carried_at(time, clutch)
        data.locality[:] = self._side.locality(corrects=True, with_model=True)
        if not (clutch.is_closing or control.is_ramping):
            self._settled = clutch, control.gains, control.delay

    def _sense_otherwise(self, given: Array) -> None:
        """Take the sample of a device that is written in Python."""
        data, device, state = self._parts, self._device, self.device
        data.external[:] = given[:6]
        data.push[:] = given[6:]
        data.sample[:] = state.published[: DEVICE_SAMPLE.size]
        data.sample[_FORCE] = state.reported + device.sensed(data.push)
        data.added[:] = device.compensation(state)
        data.state[:] = state.flat
        if self._motion is not None:
            self._look_at_motion(self._motion)

    def _look_at_motion(self, motion: MotionCheck) -> None:
        """Hold a sample against the one before; engage anew where it is no motion of a device."""
        before = motion.faults
        motion.look(self._parts.sample, self._clock[TICK] * nanoseconds(self.period))
        if motion.faults > before:
            warnings.warn(f"disengaged: {motion.fault}", RuntimeWarning, stacklevel=2)
            self._parts.answers[:] = self._parts.told[:] = 0.0
            self._device_side.begin()
        if motion.fault:
            self._clutch = None
            # In the accounts of energy it stands still: nobody moves it so.
            self._parts.sample[_RATES] = 0.0

    def _observe_otherwise(self) -> None:
        """Analyse where the kernel could not, or raise what is wrong."""
        state, data = self.mechanism, self._parts
        closing = self.simulator.closing(state)
        found = self._analyser.observe(state.q, state.v, state.active, closing, data.before)
        data.observation[:] = found.numbers
        data.contact[:] = 0.0
        if state.touching is not None and state.touching.joint_force.any():
            terms, force = self.simulator.evaluate(state), state.touching.joint_force
            data.contact[:] = contact_wrench(self._analyser, terms, force)

    def _answer_otherwise(self, time: float, clutch: Clutch) -> None:
        """Let a control law that is written in Python answer what was heard."""
        data, side = self._parts, self._side
        heard = data.sample if side.is_ideal else data.forth[-1]
        operational_model, flying = data.observation[:_MODEL_SIZE], None
        if data.locality[FORCE_LOCAL] != 0.0:
            flying = side.in_flight(data.settings, heard, operational_model, time)
        found = self._control.answer(
            time, clutch, heard.copy(), operational_model.copy(), 0.0, flying
        )
        self._given[_WRENCHES] = found.ravel()

    def _move_otherwise(self) -> None:
        """Move a device that is written in Python on by a period."""
        command, push = self._parts.wrenches[ON_HAND].copy(), self._parts.push.copy()
        tick = self._clock[TICK]
        self._device_state = self._device.step(self.device, command, self._held, tick, push)

    def _latch(self) -> None:
        """Close the closures that latch at the state to which a step has led."""
        state = self.mechanism
        latched = self.simulator.latch(state)
        if latched is not state:
            self._begin(latched)

    def _step_otherwise(self) -> None:
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
        wrenches[self._analyser.index] = data.wrenches[ON_MECHANISM] + data.external
        self.go_on(self.simulator.step(state, wrenches, on_links))

    def _engaged_clutch(self, time: float) -> Clutch:
        """Return the clutch, engaged anew at the start and if the mechanism is held elsewhere."""
        clutch, control, data = self._clutch, self._control, self._parts
        device, operational_model = data.sample.copy(), data.observation[:_MODEL_SIZE].copy()
        if clutch is None or self._carried is not None:
            clutch = control.engage(time, device, operational_model, 0.0, self._carried)
            self._carried = None
        self._clutch = control.with_slip(time, clutch, device, operational_model)
        return self._clutch
