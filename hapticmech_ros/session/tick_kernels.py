# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ticks of a session in one kernel: measure, analyse, answer, and move device and mechanism on.

All that a session's ticks read and write besides the mechanism: one array, allocated once.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hapticmech_ros.compilation import (
    Part,
    Size,
    Structure,
    gathering_kernel,
    inner,
    local_whole,
    put,
    structure,
)
from hapticmech_ros.compilation.structures import SIZES
from hapticmech_ros.contact.layout import HELD, NOW, UNSOLVED, Contacts
from hapticmech_ros.contact.step_kernels import WHOLE, advance_period, keep, restore
from hapticmech_ros.control.account_kernels import (
    account_for_hand,
    account_for_motion,
    conclude,
    give_answer,
)
from hapticmech_ros.control.device_side_kernels import act
from hapticmech_ros.control.kernels import receive, send
from hapticmech_ros.control.loop_layout import (
    ActingWrenches,
    Answer,
    ChannelState,
    ControllerAccount,
    ControllerSettings,
    DeviceAccount,
    HandMemory,
    HandsCorrection,
    Locality,
)
from hapticmech_ros.device.kernels import (
    MEASURED,
    DeviceModel,
    SimulatedState,
    command_device,
    compensate,
    move_device,
)
from hapticmech_ros.device.safety_kernels import Safety
from hapticmech_ros.mechanism.kernels.model import (
    BEGINS_WITH,
    CONTACT_WORK,
    ENERGY_LOST,
    ERROR,
    IMPLICIT,
    LOSSY,
    MOVED,
    OWED_LOSS,
    OWED_SURPLUS,
    OWED_WORK,
    PUSHES,
    RUN_PLAN,
    SAMPLE_EVERY,
    STAGES,
    STEPS,
    SURPLUS,
    TERMS_KNOWN,
    WORK_IN,
    Model,
    unpack,
)
from hapticmech_ros.mechanism.kernels.run_kernels import advance
from hapticmech_ros.mechanism.kernels.settle_kernels import SETTLED
from hapticmech_ros.mechanism.kernels.step_kernels import Work
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import (
    OPERATIONAL_MODEL,
    DeviceSample,
    Field,
    Layout,
    OperationalModelSample,
)
from hapticmech_ros.operational.observe_kernels import consistent_wrench, count_rigid, observe_point

_ONE = Field(1)
# Period, s; length of the mechanism, m; τ of the loop, s; and delay, s, jitter and loss of the
# connection.
TIMES = Layout(dict.fromkeys(("period", "length", "loop_delay", "delay", "jitter", "loss"), _ONE))
# Of the mechanism: time, s; work done on it, and energy lost, J; closure error, m or rad; number of
# joint constraints reported; energy lost in contacts, and held by them, J; and of its account
# ``surplus``, ``refined``, ``inaccurate``, ``latch_loss``, ``moved`` and ``contact_most``.
TOTALS = Layout(
    dict.fromkeys(
        (
            "time",
            "work_in",
            "damping_loss",
            "closure_error",
            "constraints",
            "contact_loss",
            "contact_energy",
            "surplus",
            "refined",
            "inaccurate",
            "latch_loss",
            "moved",
            "contact_most",
        ),
        _ONE,
    )
)


@structure
class SessionData(Structure):
    """Data of a session; t rows of the task space, d periods of delay.

    Attributes:
        index: number of the operational point.
        steps: of the mechanism's integrator in a period.
        stages: of a step.
        implicit: 1 for an implicit rule.
        connected: 1 if a connection is between device and controller.
        period_ns: of a tick.
        received: 1 if a sample has reached the controller in this tick.
        rows: (t,) rows of a six-vector that the task space has.
        forth_state, back_state: channels of the connection, see ``control.kernels``.
        times: (6,) see ``TIMES``.
        metric: constants of the analysis, see ``metric_of``.
        observation: of the operational point, see ``observation_layout``.
        controller: its account, a ``ControllerAccount``.
        settings: of the controllers, ``ControllerSettings``.
        faded: (6,) what is carried on from another grasp, N and N m, world axes.
        commanded: (d, 6) the wrenches commanded on the mechanism that do not act yet.
        account: the device's, a ``DeviceAccount``.
        safety: its envelope.
        answers: (d + 2, ...) answers that do not act yet, the row after them, and the last one.
        sample: (19,) of the device.
        device: a ``device.kernels.DeviceModel``, and the plan of its hand.
        state: (107,) of the device, a ``SimulatedState``.
        later: (107,) its next one.
        counter: of joint constraints.
        wrenches: (18,) that act, ``ActingWrenches``.
        external: (6,) on the mechanism at the operational point, by others, N and N m, world axes.
        push: (6,) on the device, by others than the hand, likewise.
        contact: (6,) part of F_c by virtual objects, N and N m, world axes.
        locality: (3,) what the device closes, a ``Locality``.
        added: (6,) by the device's driver.
        others: (19,) what a command is corrected by for other hands, a ``HandsCorrection``.
        given: the last answer that was given, over a connection.
        q: (nq,) configuration at the tick's start.
        v: (nv,) rates there.
        totals: (13,) see ``TOTALS``.
        began_state, began_q, began_v, began_totals: of the device and the mechanism when the tick
            began.
        hand: (22,) its last wrenches, a ``HandMemory``.
        forth, back: messages on the way to the controller, and back.
        past: (n + 1, 1 + nv) rates of the last ticks, one row each by turns, or none: the tick's
            number + 1, and its rates.
        before: (1 + nv,) how long ago, s, and the rates that were, or 0. From ``forth`` on, no
            sample has these parts.
    """

    __slots__ = ()

    index, steps, stages, implicit = Size(0), Size(1), Size(2), Size(3)
    connected, period_ns, received = Size(4), Size(5), Size(6)
    rows = Part(0, 1, whole=True)
    forth_state, back_state = Part(1, 1, whole=True), Part(2, 1, whole=True)
    times, metric, observation = Part(3, 1), Part(4, 1), Part(5, 1)
    controller, settings, faded, commanded = Part(6, 1), Part(7, 1), Part(8, 1), Part(9, 2)
    account, safety, answers, sample = Part(10, 1), Part(11, 1), Part(12, 2), Part(13, 1)
    device, state, later, counter = Part(14, 1), Part(15, 1), Part(16, 1), Part(17, 1)
    wrenches, external, push, contact = Part(18, 1), Part(19, 1), Part(20, 1), Part(21, 1)
    locality, added, others, given = Part(22, 1), Part(23, 1), Part(24, 1), Part(25, 1)
    q, v, totals = Part(26, 1), Part(27, 1), Part(28, 1)
    began_state, began_q, began_v, began_totals = Part(29, 1), Part(30, 1), Part(31, 1), Part(32, 1)
    hand = Part(33, 1)
    forth, back, past, before = Part(34, 2), Part(35, 2), Part(36, 2), Part(37, 1)

    def sampled(self) -> Array:
        """Return (n,) the part of the data that a sample has: all but messages and past rates."""
        return self.data[: int(self.numbers[vars(SessionData)["forth"].at])]


# Names of its parts.
PARTS = tuple(name for name, part in vars(SessionData).items() if isinstance(part, Part))


def session_data(sizes: Mapping[str, int], parts: Mapping[str, Array]) -> SessionData:
    """Return session data with these sizes, and parts that begin with these numbers.

    Args:
        sizes: by name; all of them.
        parts: name -> (n,) or (n, m) array; all of them. They are copied.
    """
    kinds = vars(SessionData)
    numbers = np.zeros(SIZES, dtype=np.int64)
    for name, size in sizes.items():
        numbers[kinds[name].index] = size
    ordered = sorted(parts, key=lambda name: int(kinds[name].at))
    whole = [name for name in ordered if kinds[name].whole]
    real = [name for name in ordered if not kinds[name].whole]
    places = np.zeros(3 * len(parts), dtype=np.int64)
    for names, first in ((whole, SIZES + places.size), (real, 0)):
        start = first
        for name in names:
            shape = parts[name].shape
            columns = shape[1] if len(shape) == 2 else 1
            at = kinds[name].at - SIZES
            places[at : at + 3] = start, shape[0], columns
            start += parts[name].size
    integers = [np.asarray(parts[name], dtype=np.int64).ravel() for name in whole]
    floats = [np.asarray(parts[name], dtype=float).ravel() for name in real]
    return SessionData(np.concatenate((numbers, places, *integers)), np.concatenate(floats))


# What a tick consists of, in this order; a call does all of it or some.
SENSE, OBSERVE, RECEIVE, RENDER, DEVICE, MECHANISM = 1, 2, 4, 8, 16, 32
ALL = SENSE | OBSERVE | RECEIVE | RENDER | DEVICE | MECHANISM
# Of a run: number of ticks; what they do; number of the next tick; 1 if terms at its start are
# known; why the mechanism's step failed; from one record to the next, 0 for none; records written;
# 1 if the answer's wrenches are there already; and which of the arrays of terms is the start's.
TICKS, PHASES, TICK, KNOWN, WHY, EVERY, RECORDED, ANSWERED, AT = range(9)
CLOCK_SIZE = 9
# What ended a run before its end: the analysis, or the mechanism's step; that is left to do.
OBSERVATION_FAILED, STEP_FAILED = 1, 2
# Number of the kernel's arguments, and which are the step's work, the inputs, the records, and the
# first one of the contacts.
KERNEL_ARGUMENTS, WORK, INPUTS, RECORDS, CONTACTS = 13, 3, 7, 8, 10
MODEL_SIZE = OPERATIONAL_MODEL.size
RUN_PLAN_SIZE = RUN_PLAN.size
# Among the whole numbers of a session.
RECEIVED = vars(SessionData)["received"].index
PERIOD_S, LENGTH, LOOP_DELAY, DELAY, JITTER, LOSS = TIMES.starts(*TIMES)
TIME, TOTAL_WORK, TOTAL_LOSS, CLOSURE_ERROR, CONSTRAINTS = TOTALS.starts(
    "time", "work_in", "damping_loss", "closure_error", "constraints"
)
CONTACT_LOSS, CONTACT_ENERGY, CONTACT_MOST = TOTALS.starts(
    "contact_loss", "contact_energy", "contact_most"
)
TOTAL_SURPLUS, INACCURATE_STEPS = TOTALS.starts("surplus", "inaccurate")
LATCH_LOSS, MOST_MOVED = TOTALS.starts("latch_loss", "moved")


@inner
def sense(data: SessionData) -> None:
    """Fill the device's sample, and what its driver adds to the next command."""
    device, measured, sample = DeviceModel(data.device), DeviceSample(data.state), data.sample
    put(sample, measured.values)
    if device.senses_itself == MEASURED:
        for i in range(6):
            DeviceSample(sample).hand_wrench[i] += data.push[i]
    compensate(device, measured.twist, data.added)


@inner
def recall(past: Array, tick: int, period: float, before: Array) -> None:
    """Fill (1 + nv,) how long ago, s, and the rates that were: those of the longest ago, or 0."""
    before[:] = 0.0
    count = past.shape[0]
    if count > 1:
        row = past[(tick + 1) % count]
        # The tick's number + 1: 0 is of no tick.
        if row[0] > 0.0 and row[0] == tick - count + 2:
            put(before, row)
            before[0] = (count - 1) * period


@inner
def remember_rates(past: Array, tick: int, rates: Array) -> None:
    """Remember the rates of a tick."""
    if past.shape[0] > 1:
        row = past[tick % past.shape[0]]
        row[0] = tick + 1
        put(row[1:], rates)


@inner
def look(numbers: Array, values: Array, data: SessionData, packed: Array, clock: Array) -> bool:
    """Analyse the operational point, and count joint constraints; return whether it succeeded."""
    times, rows, observation = data.times, data.rows, data.observation
    put(data.began_state, data.state)
    put(data.began_q, data.q)
    put(data.began_v, data.v)
    put(data.began_totals, data.totals)
    at, tick, past, before = clock[AT], clock[TICK], data.past, data.before
    recall(past, tick, times[PERIOD_S], before)
    code = observe_point(
        numbers,
        values,
        packed[at],
        clock[KNOWN],
        data.q,
        data.v,
        data.index,
        data.metric,
        rows,
        times[LENGTH],
        times[LOOP_DELAY],
        before,
        packed[2],
        observation,
    )
    clock[KNOWN] = int(code == 0)
    remember_rates(past, tick, data.v)
    return code == 0


@inner
def feel_contacts(
    numbers: Array, values: Array, data: SessionData, packed: Array, contacts: Contacts
) -> None:
    """Fill F_c of the contacts in the step that led here."""
    force, felt = contacts.joint_force, False
    for c in range(force.size):
        felt = felt or force[c] != 0.0
    if not felt:
        data.contact[:] = 0.0
    else:
        consistent_wrench(numbers, values, packed, data.observation, data.rows, force, data.contact)


@inner
def receive_sample(data: SessionData, time: float, stamp_ns: int) -> None:
    """Count joint constraints, add up F_c, and send the sample over the connection."""
    observation, counted = data.observation, data.rows.size
    data.totals[CONSTRAINTS] = count_rigid(data.counter, observation[:counted], time)
    for i in range(6):
        OperationalModelSample(observation).contact[i] = data.external[i] + data.contact[i]
    received = 1
    if data.connected != 0:
        times, state, rows = data.times, data.forth_state, data.forth
        send(state, rows, times[DELAY], times[JITTER], times[LOSS], stamp_ns, stamp_ns, data.sample)
        received = int(receive(state, rows, stamp_ns))
    data.numbers[RECEIVED] = received


@inner
def render(data: SessionData, time: float, stamp_ns: int, answered: bool) -> None:
    """Answer what was heard, and fill what acts on device and mechanism."""
    controller, connected = ControllerAccount(data.controller), data.connected != 0
    model, answers = OperationalModelSample(data.observation), data.answers
    last = answers[answers.shape[0] - 1]
    account_for_motion(controller, model.twist, controller.period)
    received = DeviceSample(data.forth[data.forth.shape[0] - 1] if connected else data.sample)
    given = Answer(data.given if connected else last)
    if data.received != 0:
        settings, locality = ControllerSettings(data.settings), Locality(data.locality)
        account_for_hand(controller, received)
        if not answered:
            commanded, faded = data.commanded, data.faded
            give_answer(
                controller,
                settings,
                faded,
                commanded,
                received,
                model,
                time,
                0.0,
                locality,
                given,
            )
        conclude(controller, settings, received, model, time, locality, given)
        if connected:
            times, tag = data.times, ChannelState(data.forth_state).tag
            law = times[DELAY], times[JITTER], times[LOSS]
            send(data.back_state, data.back, law[0], law[1], law[2], stamp_ns, tag, given.values)
    if connected and receive(data.back_state, data.back, stamp_ns):
        put(last, data.back[data.back.shape[0] - 1])
    act(
        controller,
        given,
        data.commanded,
        DeviceAccount(data.account),
        Safety(data.safety),
        answers,
        DeviceSample(data.sample),
        HandMemory(data.hand),
        SimulatedState(data.state).applied,
        data.added,
        HandsCorrection(data.others),
        ActingWrenches(data.wrenches),
    )


@inner
def move_hand(data: SessionData, tick: int) -> None:
    """Move the device, and the hand that holds it, on by a period."""
    device, state = DeviceModel(data.device), SimulatedState(data.state)
    put(device.push, data.push)
    command_device(device, state, ActingWrenches(data.wrenches).on_hand)
    move_device(data.device, state, tick, SimulatedState(data.later))
    put(data.state, data.later)


@inner
def move_mechanism(
    numbers: Array,
    values: Array,
    data: SessionData,
    packed: Array,
    work: Array,
    springs: Array,
    nobody: Array,
    contact_numbers: Array,
    contact_values: Array,
    clock: Array,
) -> bool:
    """Move the mechanism on by a period; return whether it could be done, else nothing is changed.

    ``nobody`` is a matrix (0, 10): of wrenches on links, and of samples of the steps.
    """
    parts, index, acting = Work(numbers, work), data.index, ActingWrenches(data.wrenches)
    pushed, account, totals = parts.wrenches, parts.account, data.totals
    put(parts.q0, data.q)
    put(parts.v0, data.v)
    pushed[:] = 0.0
    for i in range(6):
        pushed[index, i] = acting.on_mechanism[i] + data.external[i]
    parts.held[:] = 0.0
    account[:] = 0.0
    account[OWED_SURPLUS], account[OWED_WORK] = totals[TOTAL_SURPLUS], totals[TOTAL_WORK]
    account[MOVED] = totals[MOST_MOVED]
    account[OWED_LOSS] = totals[TOTAL_LOSS] + totals[LATCH_LOSS] + abs(totals[CONTACT_LOSS])
    at, plan = clock[AT], local_whole(RUN_PLAN_SIZE)
    first, last, stages, touches = packed[at], packed[1 - at], packed[3], contact_numbers.size > 0
    contacts = Contacts(contact_numbers, contact_values)
    plan[STEPS], plan[STAGES], plan[IMPLICIT] = data.steps, data.stages, data.implicit
    plan[TERMS_KNOWN], plan[SAMPLE_EVERY], plan[PUSHES] = clock[KNOWN], 0, 0
    if touches:
        keep(contacts)
        plan[BEGINS_WITH] = WHOLE
        code = advance_period(
            numbers,
            values,
            first,
            last,
            stages,
            work,
            springs,
            contact_numbers,
            contact_values,
            plan,
        )
    else:
        code = advance(numbers, values, first, last, stages, work, springs, nobody, nobody, plan)
    clock[WHY] = code
    if code != SETTLED:
        clock[KNOWN] = 0
        if touches:
            restore(contacts)
        return False
    clock[AT], clock[KNOWN] = 1 - at, 1
    put(data.q, parts.q)
    put(data.v, parts.v)
    totals[TIME] += data.times[PERIOD_S]
    totals[TOTAL_WORK] += account[WORK_IN] - account[CONTACT_WORK]
    totals[TOTAL_LOSS] += account[ENERGY_LOST]
    totals[TOTAL_SURPLUS] += account[SURPLUS]
    totals[INACCURATE_STEPS] += account[LOSSY]
    totals[MOST_MOVED] = account[MOVED]
    totals[CLOSURE_ERROR] = unpack(packed[1 - at], Model(numbers, values)).tail[ERROR]
    if touches:
        held = contacts.report[HELD] if contacts.counts[NOW] > 0 else 0.0
        totals[CONTACT_LOSS] += totals[CONTACT_ENERGY] - held - account[CONTACT_WORK]
        totals[CONTACT_ENERGY] = held
        totals[CONTACT_MOST] = max(totals[CONTACT_MOST], totals[CONTACT_LOSS])
        totals[INACCURATE_STEPS] += contacts.counts[UNSOLVED]
    return True


@inner
def append(row: Array, at: int, part: Array) -> int:
    """Put a part into a row from ``at`` on; return where the next one goes."""
    put(row[at : at + part.size], part)
    return int(at + part.size)


@inner
def write_record(data: SessionData, time: float, row: Array) -> None:
    """Fill a row of a run; see :func:`~hapticmech_ros.session.sample.run_layout`."""
    given = Answer(data.given if data.connected != 0 else data.answers[data.answers.shape[0] - 1])
    acting, energies = ActingWrenches(data.wrenches), ControllerAccount(data.controller).energies
    state = SimulatedState(data.state)
    row[0] = time
    at = append(row, 1, data.q)
    at = append(row, at, data.v)
    at = append(row, at, data.sample)
    at = append(row, at, state.applied)
    at = append(row, at, data.added)
    at = append(row, at, state.body.values)
    at = append(row, at, data.observation[:MODEL_SIZE])
    at = append(row, at, given.wrenches.values)
    at = append(row, at, acting.on_hand)
    at = append(row, at, acting.on_mechanism)
    at = append(row, at, data.external)
    at = append(row, at, energies.values)
    row[at], row[at + 1] = DeviceAccount(data.account).actuators, data.totals[CONSTRAINTS]


@gathering_kernel(
    "int64(int64[::1], float64[::1], float64[:,::1], float64[::1], float64[::1], int64[::1],"
    " float64[::1], float64[:,::1], float64[:,::1], float64[:,::1], int64[::1], float64[::1],"
    " int64[::1])"
)
def run_ticks(
    numbers: Array,
    values: Array,
    packed: Array,
    work: Array,
    springs: Array,
    whole: Array,
    real: Array,
    inputs: Array,
    records: Array,
    nobody: Array,
    contact_numbers: Array,
    contact_values: Array,
    clock: Array,
) -> int:
    """Do ticks, or parts of one; called with an array (13,) of what follows.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        packed: (4, ...) terms at a tick's start and at its end, which change places; those that the
            delay compensation works in, and those of a step's stages.
        work: (work,) of the step; see ``step_kernels.Work``.
        springs: (numbers,) of implicit rules; see ``implicit_kernels.Springs``.
        whole: (integers,) numbers of the session's data.
        real: (numbers,) the data; see :class:`~hapticmech_ros.session.tick_kernels.SessionData`.
        inputs: (ticks or 1, 12) wrenches by others on the mechanism at the operational point, and
            on the device at the point held; N and N m, world axes.
        records: (records, ...) to fill; see ``run_layout``.
        nobody: (0, 10).
        contact_numbers: of the contacts, whole ones; (0,) in a scene without.
        contact_values: (numbers,) the others; see ``layout.Contacts``.
        clock: (9,) what to do, and what was done.

    Returns:
        0, OBSERVATION_FAILED or STEP_FAILED: what is left to do of the tick then.
    """
    data = SessionData(whole, real)
    phases, every = clock[PHASES], clock[EVERY]
    times, external, push = data.times, data.external, data.push
    for done in range(clock[TICKS]):
        tick = clock[TICK]
        time, stamp_ns = tick * times[PERIOD_S], tick * data.period_ns
        if phases & SENSE:
            row = inputs[min(done, inputs.shape[0] - 1)]
            put(external, row[:6])
            put(push, row[6:])
            sense(data)
        if phases & OBSERVE and not look(numbers, values, data, packed, clock):
            return OBSERVATION_FAILED
        if phases & RECEIVE:
            if contact_numbers.size > 0 and clock[KNOWN] != 0:
                contacts = Contacts(contact_numbers, contact_values)
                feel_contacts(numbers, values, data, packed[clock[AT]], contacts)
            receive_sample(data, time, stamp_ns)
        if phases & RENDER:
            render(data, time, stamp_ns, clock[ANSWERED] != 0)
            if every > 0 and tick % every == 0:
                write_record(data, time, records[clock[RECORDED]])
                clock[RECORDED] += 1
        if phases & DEVICE:
            move_hand(data, tick)
        if phases & MECHANISM:
            moved = move_mechanism(
                numbers,
                values,
                data,
                packed,
                work,
                springs,
                nobody,
                contact_numbers,
                contact_values,
                clock,
            )
            if not moved:
                return STEP_FAILED
            clock[TICK] += 1
    return 0
