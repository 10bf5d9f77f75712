# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ticks of a session in one kernel: measure, analyse, answer, and move device and mechanism on.

All that a session's ticks read and write besides the mechanism: one array, allocated once.
"""

from __future__ import annotations

from hapticmech_ros.compilation import (
    Part,
    RecordPart,
    Size,
    Structure,
    inner,
    kernel,
    put,
    shaped,
)
from hapticmech_ros.compilation.records import Number, Record
from hapticmech_ros.contact.layout import Contacts
from hapticmech_ros.contact.step_kernels import WHOLE, advance_period, keep, restore
from hapticmech_ros.control.account_kernels import command_mechanism, control_sample
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
from hapticmech_ros.mechanism.kernels.model import Data, Model, RunPlan, Work
from hapticmech_ros.mechanism.kernels.run_kernels import advance
from hapticmech_ros.mechanism.kernels.settle_kernels import SETTLED
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample, OperationalModelSample
from hapticmech_ros.numerics.small_matrices import add_scaled, is_zero
from hapticmech_ros.operational.observe_kernels import (
    MODEL_SIZE,
    ConstraintTrigger,
    Observed,
    consistent_wrench,
    count_rigid,
    observe_point,
)


class SessionTimes(Record):
    """Times and related constants of a session.

    Attributes:
        period: of a tick, s.
        length: of the mechanism, m.
        loop_delay: τ of the loop, s.
        delay: of the connection, s.
        jitter: of the connection, s.
        loss: share of the connection's messages that are lost.
    """

    period = Number()
    length = Number()
    loop_delay = Number()
    delay = Number()
    jitter = Number()
    loss = Number()


class SessionTotals(Record):
    """The mechanism's state besides q and v, for kernels.

    Attributes:
        time: s.
        work_in: work done on the mechanism, J.
        damping_loss: energy lost in damping, friction and stops, J.
        closure_error: largest residual of the closures, m or rad.
        constraints: number of joint constraints reported.
        contact_loss: energy lost in contacts, J.
        contact_energy: energy held by contacts, J.
        surplus, refined, inaccurate, latch_loss, moved, contact_most: as of the mechanism's
            ``EnergyAccount``.
    """

    time = Number()
    work_in = Number()
    damping_loss = Number()
    closure_error = Number()
    constraints = Number()
    contact_loss = Number()
    contact_energy = Number()
    surplus = Number()
    refined = Number()
    inaccurate = Number()
    latch_loss = Number()
    moved = Number()
    contact_most = Number()


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
        times: constants.
        metric: constants of the analysis, see ``metric_of``.
        observation: of the operational point, see ``observe_point``.
        controller: its account, a ``ControllerAccount``.
        settings: of the controllers, ``ControllerSettings``.
        faded: (6,) wrench carried on from another grasp, N and N m, world axes.
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
        locality: (3,) the loops that the device closes, a ``Locality``.
        added: (6,) by the device's driver.
        others: (19,) the correction of a command for other hands, a ``HandsCorrection``.
        given: the last answer that was computed, with a connection.
        q: (nq,) configuration at the tick's start.
        v: (nv,) rates there.
        totals: of the mechanism.
        began_state, began_q, began_v, began_totals: of the device and the mechanism when the tick
            began.
        hand: (22,) its last wrenches, a ``HandMemory``.
        forth, back: messages in flight to the controller, and back.
        past: (n + 1, 1 + nv) rates of the last ticks, one row each by turns, or none: the tick's
            number + 1, and its rates.
        before: (1 + nv,) a time ago, s, and the rates then, or 0. From ``forth`` on, no sample has
            these parts.
    """

    __slots__ = ()

    index, steps, stages, implicit = Size(), Size(), Size(), Size()
    connected, period_ns, received = Size(), Size(), Size()
    rows = Part(1, whole=True)
    forth_state, back_state = Part(1, whole=True), Part(1, whole=True)
    times, metric, observation = RecordPart(SessionTimes), Part(1), Part(1)
    controller, settings, faded, commanded = Part(1), Part(1), Part(1), Part(2)
    account, safety, answers, sample = Part(1), Part(1), Part(2), Part(1)
    device, state, later, counter = Part(1), Part(1), Part(1), RecordPart(ConstraintTrigger)
    wrenches, external, push, contact = Part(1), Part(1), Part(1), Part(1)
    locality, added, others, given = Part(1), Part(1), Part(1), Part(1)
    q, v, totals = Part(1), Part(1), RecordPart(SessionTotals)
    began_state, began_q, began_v = Part(1), Part(1), Part(1)
    began_totals = RecordPart(SessionTotals)
    hand = Part(1)
    forth, back, past, before = Part(2), Part(2), Part(2), Part(1)

    def sampled(self) -> Array:
        """Return (n,) the part of the data that a sample has: all but messages and past rates."""
        return self.data[: int(self.numbers[SessionData.parts["forth"].at])]


# Phases of a tick, in this order; a call does all or some.
SENSE, OBSERVE, RECEIVE, RENDER, DEVICE, MECHANISM = 1, 2, 4, 8, 16, 32
ALL = SENSE | OBSERVE | RECEIVE | RENDER | DEVICE | MECHANISM
# Of a run: number of ticks; their phases; number of the next tick; 1 if terms at its start are
# known; why the mechanism's step failed; ticks from one record to the next, 0 for none; records
# written; 1 if the answer's wrenches are there already; and which of the arrays of terms is the
# start's.
TICKS, PHASES, TICK, KNOWN, WHY, EVERY, RECORDED, ANSWERED, AT = range(9)
CLOCK_SIZE = 9
# Causes of a run's early end: the analysis, or the mechanism's step, which Python then does.
OBSERVATION_FAILED, STEP_FAILED = 1, 2
# Number of the kernel's arguments, and which are the step's work, the inputs, the records, and the
# first one of the contacts.
KERNEL_ARGUMENTS, WORK, INPUTS, RECORDS, CONTACTS = 11, 3, 6, 7, 8
# Among the whole numbers of a session.
RECEIVED = SessionData.sizes["received"].index


@inner
def sense(data: SessionData) -> None:
    """Fill the device's sample, and its driver's addition to the next command."""
    device, measured, sample = DeviceModel(data.device), DeviceSample(data.state), data.sample
    put(sample, measured.values)
    if device.senses_itself == MEASURED:
        add_scaled(DeviceSample(sample).hand_wrench, 1.0, data.push)
    compensate(device, measured.twist, data.added)


@inner
def recall(past: Array, tick: int, period: float, before: Array) -> None:
    """Fill (1 + nv,) with the age, s, of the oldest stored rates, and these; or 0."""
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
def observe(numbers: Array, values: Array, data: SessionData, packed: Array, clock: Array) -> bool:
    """Analyse the operational point, and count joint constraints; return whether it succeeded."""
    times, rows, observation = data.times, data.rows, data.observation
    put(data.began_state, data.state)
    put(data.began_q, data.q)
    put(data.began_v, data.v)
    put(data.began_totals.values, data.totals.values)
    at, tick, past, before = clock[AT], clock[TICK], data.past, data.before
    recall(past, tick, times.period, before)
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
        times.length,
        times.loop_delay,
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
    force = contacts.joint_force
    data.contact[:] = 0.0
    if not is_zero(force):
        model, terms = Model(numbers, values), Data(numbers, packed)
        consistent_wrench(model, terms, data.observation, data.rows, force, data.contact)


@inner
def receive_sample(data: SessionData, time: float, stamp_ns: int) -> None:
    """Count joint constraints, add up F_c, and send the sample over the connection."""
    found = Observed(data.observation)
    data.totals.constraints = count_rigid(data.counter, found.s[: data.rows.size], time)
    for i in range(6):
        found.contact[i] = data.external[i] + data.contact[i]
    received = 1
    if data.connected != 0:
        times, state, rows = data.times, data.forth_state, data.forth
        send(state, rows, times.delay, times.jitter, times.loss, stamp_ns, stamp_ns, data.sample)
        received = int(receive(state, rows, stamp_ns))
    data.numbers[RECEIVED] = received


@inner
def render(data: SessionData, time: float, stamp_ns: int, answered: bool) -> None:
    """Answer a received sample, and fill the wrenches on device and mechanism."""
    controller, connected = ControllerAccount(data.controller), data.connected != 0
    model, answers = OperationalModelSample(data.observation), data.answers
    last, acting = answers[answers.shape[0] - 1], ActingWrenches(data.wrenches)
    sample = DeviceSample(data.forth[data.forth.shape[0] - 1] if connected else data.sample)
    given = Answer(data.given if connected else last)
    # The mechanism's state is never late.
    none = shaped(data.faded, (0, 6))
    control_sample(
        controller,
        ControllerSettings(data.settings),
        data.faded,
        data.commanded,
        none,
        sample,
        model,
        time,
        0,
        data.period_ns,
        Locality(data.locality),
        data.received != 0,
        answered,
        given,
        acting.commanded,
    )
    command_mechanism(controller, data.commanded, none, acting.commanded, acting.on_mechanism)
    if connected:
        if data.received != 0:
            times, tag = data.times, ChannelState(data.forth_state).tag
            law = times.delay, times.jitter, times.loss
            send(data.back_state, data.back, law[0], law[1], law[2], stamp_ns, tag, given.values)
        if receive(data.back_state, data.back, stamp_ns):
            put(last, data.back[data.back.shape[0] - 1])
    act(
        DeviceAccount(data.account),
        Safety(data.safety),
        answers,
        DeviceSample(data.sample),
        HandMemory(data.hand),
        SimulatedState(data.state).applied,
        data.added,
        HandsCorrection(data.others),
        acting.on_hand,
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
def push_point(numbers: Array, data: SessionData, work: Array) -> None:
    """Fill the wrenches on the mechanism over a period: that at its operational point alone."""
    pushed, acting = Work(numbers, work).wrenches, ActingWrenches(data.wrenches)
    pushed[:] = 0.0
    for i in range(6):
        pushed[data.index, i] = acting.on_mechanism[i] + data.external[i]


@inner
def move_mechanism(
    numbers: Array,
    values: Array,
    data: SessionData,
    packed: Array,
    work: Array,
    contact_numbers: Array,
    contact_values: Array,
    clock: Array,
) -> bool:
    """Move the mechanism on by a period, under the wrenches in ``work``.

    Returns:
        Whether it was done; else nothing is changed.
    """
    parts, totals = Work(numbers, work), data.totals
    account = parts.account
    put(parts.q0, data.q)
    put(parts.v0, data.v)
    parts.held[:] = 0.0
    account.values[:] = 0.0
    account.earlier_defect, account.earlier_work = totals.surplus, totals.work_in
    account.largest_kinetic = totals.moved
    account.earlier_loss = totals.damping_loss + totals.latch_loss + abs(totals.contact_loss)
    at, plan = clock[AT], RunPlan()
    first, last, stages, touches = packed[at], packed[1 - at], packed[3], contact_numbers.size > 0
    contacts = Contacts(contact_numbers, contact_values)
    plan.steps, plan.stages, plan.implicit = data.steps, data.stages, data.implicit
    plan.terms_known = clock[KNOWN]
    if touches:
        keep(contacts)
        plan.begins_with = WHOLE
        code = advance_period(
            numbers,
            values,
            first,
            last,
            stages,
            work,
            contact_numbers,
            contact_values,
            plan.values,
        )
    else:
        # Of wrenches on links, and of samples of the steps.
        none = shaped(values, (0, 10))
        code = advance(numbers, values, first, last, stages, work, none, none, plan.values)
    clock[WHY] = code
    if code != SETTLED:
        clock[KNOWN] = 0
        if touches:
            restore(contacts)
        return False
    clock[AT], clock[KNOWN] = 1 - at, 1
    put(data.q, parts.q)
    put(data.v, parts.v)
    totals.time += data.times.period
    totals.work_in += account.work_in - account.contact_work
    totals.damping_loss += account.energy_lost
    totals.surplus += account.energy_defect
    totals.inaccurate += account.lossy_steps
    totals.moved = account.largest_kinetic
    totals.closure_error = Data(numbers, packed[1 - at]).tail.largest_residual
    if touches:
        held = contacts.report.energy if contacts.counts.points > 0 else 0.0
        totals.contact_loss += totals.contact_energy - held - account.contact_work
        totals.contact_energy = held
        totals.contact_most = max(totals.contact_most, totals.contact_loss)
        totals.inaccurate += contacts.counts.unsolved
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
    row[at], row[at + 1] = DeviceAccount(data.account).actuators, data.totals.constraints


@kernel(
    "int64(int64[::1], float64[::1], float64[:,::1], float64[::1], int64[::1],"
    " float64[::1], float64[:,::1], float64[:,::1], int64[::1], float64[::1],"
    " int64[::1])",
    gathered=True,
)
def run_ticks(
    numbers: Array,
    values: Array,
    packed: Array,
    work: Array,
    whole: Array,
    real: Array,
    inputs: Array,
    records: Array,
    contact_numbers: Array,
    contact_values: Array,
    clock: Array,
) -> int:
    """Do ticks, or parts of one; called with an array (11,) of these arguments.

    Args:
        numbers: (integers,) constants of the mechanism, whole ones.
        values: (numbers,) the others; see ``model.pack``.
        packed: (4, ...) terms at a tick's start and at its end, which are swapped; those of the
            delay compensation, and those of a step's stages.
        work: (work,) of the step; see ``model.Work``.
        whole: (integers,) numbers of the session's data.
        real: (numbers,) the data; see :class:`~hapticmech_ros.session.tick_kernels.SessionData`.
        inputs: (ticks or 1, 12) wrenches by others on the mechanism at the operational point, and
            on the device at the point held; N and N m, world axes.
        records: (records, ...) to fill; see ``run_layout``.
        contact_numbers: of the contacts, whole ones; (0,) in a scene without.
        contact_values: (numbers,) the others; see ``layout.Contacts``.
        clock: (9,) phases to do, and progress.

    Returns:
        0, OBSERVATION_FAILED or STEP_FAILED: the phase that is left to do then.
    """
    data = SessionData(whole, real)
    phases, every = clock[PHASES], clock[EVERY]
    times, external, push = data.times, data.external, data.push
    for done in range(clock[TICKS]):
        tick = clock[TICK]
        time, stamp_ns = tick * times.period, tick * data.period_ns
        if phases & SENSE:
            row = inputs[min(done, inputs.shape[0] - 1)]
            put(external, row[:6])
            put(push, row[6:])
            sense(data)
        if phases & OBSERVE and not observe(numbers, values, data, packed, clock):
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
            push_point(numbers, data, work)
            moved = move_mechanism(
                numbers,
                values,
                data,
                packed,
                work,
                contact_numbers,
                contact_values,
                clock,
            )
            if not moved:
                return STEP_FAILED
            clock[TICK] += 1
    return 0
