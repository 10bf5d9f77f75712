# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controller's side of the rendering loop in kernels: energies, commands to the mechanism.

    E_m   = ∫ f · v dt                       given to the mechanism at its operational point
    S     = ½ k eᵀ P_c e + ½ eᵀ C_k e        held in the springs of joint constraint and C
    E_inj = Σ ½ eᵀ (Δ(k P_c) + ΔC_k) e       that came by directions and gains that changed
    E_b   = ∫ ėᵀ (b P_c + C_b) ė dt          lost in the dampers
    E_h   = Σ ½ (F_h + F_h') · ξ             that the hand has put in, over samples that arrive

Passivity at the mechanism's port: it gets no more than the hand has put in, E_m <= E_h + slack.
While E_m is above, the part of a wrench that would give more is taken away along the twist, as a
damper -λ Λ_d v would that leaves f · v = 0.

Accounts and answers are records of :mod:`~hapticmech_ros.control.loop_layout`.

Predicts a hand's wrench over the coming period, and the device's correction of a command for it.

A command is held over a period T and answers the sample F at its start, but the hand's mean wrench
F̄ over the period acts on the device. By the last three samples, which are h_1 and h_2 apart, and
their divided differences,

    F̄ - F = F' + F'',      F' = T/2 F[0,1],      F'' = (T²/3 + T h_1/2) F[0,1,2]

which for even spacing is ½ ∇F + 5/12 ∇²F, as of Adams and Bashforth. The device adds

    G F' + Σ H_j F'_j + W (G F'' + Σ H_j F''_j)
    W = (1 + 2 R²)⁻¹ (1 - 8/5 R²),      R = (K + 1) (1 + G)

with G of :mod:`~hapticmech_ros.control.loop_stability`, and H_j and F_j of any K other hands
(:mod:`~hapticmech_ros.control.other_hands`). Half a period of delay in the force channel would be
an error of ω T/2 (m / m_d - 1) of a mass m that is felt on a device's m_d, 1 / (1 + G) along a
direction. Where m is large, W is 1, and what is left is of third order in ω T. Where it is small, G
amplifies: also the reaction -r u of the hand's own mass to a command u. The whole parabola would
make that loop unstable at half the sample rate. There W tends to -4/5, which attenuates that rate,
and leaves an error of second order, 5/12 (1 - W) (ω T)² (m / m_d - 1). With masses that are rigidly
fixed to K + 1 devices on one body, equal or not, no loop that is stable without F' and F'' is
unstable with them (``test/control/test_hand_lead.py``).
"""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.control.kernels import (
    MODEL_SIZE,
    answer_measurements,
    brake,
    displacement,
    force_let_through,
    hand_on_mechanism,
    let_through,
    limit_wrench,
)
from hapticmech_ros.control.loop_layout import (
    Answer,
    ControllerAccount,
    ControllerSettings,
    HandMemory,
    HandsCorrection,
    Locality,
    MeanChange,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample, OperationalModelSample
from hapticmech_ros.numerics.small_matrices import add_scaled, dot, is_zero, largest, solve_in_place

# Samples that a memory has at most.
MOST = 3
# Longest time between operational model and sample over which the point's pose is extrapolated by
# its twist: beyond it the twist is no good estimate.
PREDICTION_LIMIT_S = 0.005
# W is below 1: a larger growth is rounding of a G that no mechanism has.
_MOST_GROWTH = 1e6


@kernel("void(HandMemory, float64, float64[::1])")
def remember(memory: HandMemory, spacing: float, wrench: Array) -> None:
    """Remember a sample of a hand's wrench.

    Args:
        memory: changed; zeros at first.
        spacing: s since the sample before; of no meaning for the first one.
        wrench: (6,) F_h, N and N m, world axes.
    """
    put(memory.third.values, memory.second.values)
    put(memory.second.values, memory.newest.values)
    memory.newest.spacing = spacing
    put(memory.newest.wrench, wrench)
    memory.known = min(memory.known + 1.0, MOST)


@kernel("void(HandMemory, float64, float64, MeanChange)")
def change_of_mean(memory: HandMemory, start: float, period: float, change: MeanChange) -> None:
    """Fill how the mean of a wrench over a period differs from its newest sample, F' and F''.

    Args:
        memory: of its samples.
        start: s, from the newest sample to the period's start.
        period: T, s.
        change: to fill; zero where fewer samples are known.
    """
    change.values[:] = 0.0
    if memory.known < 2.0:
        return
    newest, second, third = memory.newest, memory.second, memory.third
    # Samples that are closer than a period would amplify their noise.
    first, before = max(newest.spacing, period), max(second.spacing, period)
    end = start + period
    middle = 0.5 * (start + end)
    square = (start * start + start * end + end * end) / 3.0
    for i in range(6):
        slope = (newest.wrench[i] - second.wrench[i]) / first
        change.line[i] = middle * slope
        if memory.known > 2.0:
            turn = slope - (second.wrench[i] - third.wrench[i]) / before
            change.bend[i] = (square + first * middle) * (turn / (first + before))


@inner
def weigh(gain: Array, hands: float, bend: Array) -> bool:
    """Replace ``bend`` (6,) by W bend; return whether that is regular.

    ``gain`` (6, 6) is G, SI units, and ``hands`` K + 1.
    """
    ratio, factor, solved = shaped(local(36), (6, 6)), shaped(local(36), (6, 6)), local(6)
    for i in range(6):
        solved[i] = bend[i]
        for j in range(6):
            ratio[i, j] = hands * gain[i, j]
        ratio[i, i] += hands
    for i in range(6):
        for j in range(6):
            factor[i, j] = 0.0
            for k in range(6):
                factor[i, j] += ratio[i, k] * ratio[k, j]
            factor[i, j] *= 2.0
        factor[i, i] += 1.0
    if not solve_in_place(factor, solved, 6):
        return False
    if largest(solved) > _MOST_GROWTH * largest(bend):
        return False
    for i in range(6):
        bend[i] = 1.8 * solved[i] - 0.8 * bend[i]
    return True


@inner
def lead(
    memory: HandMemory, period: float, gain: Array, others: HandsCorrection, command: Array
) -> None:
    """Add the module's lead to a command (6,), or nothing where it is singular.

    ``gain`` (6, 6) is G, SI units.
    """
    change, line, bend, moves = MeanChange(), local(6), local(6), False
    change_of_mean(memory, 0.0, period, change)
    for i in range(6):
        line[i], bend[i] = others.line[i], others.bend[i]
        for j in range(6):
            line[i] += gain[i, j] * change.line[j]
            bend[i] += gain[i, j] * change.bend[j]
        moves = moves or line[i] != 0.0 or bend[i] != 0.0
    if moves and weigh(gain, 1.0 + others.hands, bend):
        for i in range(6):
            command[i] += line[i] + bend[i]


@inner
def account_for_motion(account: ControllerAccount, twist: Array, duration: float) -> None:
    """Add to E_m the work of the acting wrench until now.

    Args:
        account: of the controller, changed.
        twist: (6,) of the operational point now, m/s and rad/s, world axes.
        duration: s, since the twist before.
    """
    if account.twist_known != 0.0:
        total = 0.0
        for i in range(6):
            total += account.acting[i] * (account.twist[i] + twist[i])
        account.energies.to_mechanism += duration * (0.5 * total)
    account.twist_known = 1.0
    put(account.twist, twist)


@inner
def account_for_hand(account: ControllerAccount, sample: DeviceSample) -> None:
    """Add to E_h the hand's work until a sample of the device."""
    before = account.sample
    if account.sample_known != 0.0:
        way, total = local(6), 0.0
        displacement(before, sample, way)
        for i in range(6):
            total += 0.5 * (before.hand_wrench[i] + sample.hand_wrench[i]) * way[i]
        account.from_hand += total
    account.sample_known = 1.0
    put(before.values, sample.values)


@inner
def spring_energy(error: Array, gain: float, projector: Array, channel: Array) -> float:
    """Return ½ eᵀ (gain P_c + C) e, with P_c (6, 6) and the diagonal (6,) of C; J."""
    held = 0.0
    for i in range(6):
        held += error[i] * (gain * dot(projector[i], error) + channel[i] * error[i])
    return 0.5 * held


@inner
def account_for_springs(
    account: ControllerAccount, settings: ControllerSettings, error: Array, projector: Array
) -> None:
    """Account for the springs and dampers of an answer, a period after the last one.

    Args:
        account: of the controller, changed.
        settings: with springs and dampers of joint constraint and C.
        error: (6,) e of the answer, m and rad, world axes.
        projector: (6, 6) P_c.
    """
    spring, energies = settings.joint_stiffness, account.energies
    stored = spring_energy(error, spring, projector, settings.stiffness)
    if account.error_known != 0.0:
        energies.injected += stored - spring_energy(
            error, account.spring, account.projector, account.channel
        )
        way = local(6)
        for i in range(6):
            way[i] = error[i] - account.error[i]
        damped = spring_energy(way, settings.joint_damping, projector, settings.damping)
        energies.dissipated += 2.0 * damped / account.period
    energies.stored, account.error_known, account.spring = stored, 1.0, spring
    put(account.error, error)
    for row in range(6):
        put(account.projector[row], projector[row])
    put(account.channel, settings.stiffness)


@inner
def lateness(apart_ns: int, period: float) -> float:
    """Return by how many whole periods (s) the mechanism's state is older than a sample.

    Device and mechanism are thus compared after equally many periods under equal wrenches. A
    difference below a period is no delay: the mechanism ticks half a period after the device.

    Args:
        apart_ns: time of the sample minus that of the state, ns.
        period: s.
    """
    late = apart_ns // round(1e9 * period) * period
    return float(min(max(late, -PREDICTION_LIMIT_S), PREDICTION_LIMIT_S))


@inner
def number_in_flight(delay: int, ahead: float, period: float, closes: bool) -> tuple[int, float]:
    """Return how many commands have not moved the mechanism's state yet, and the rest of ``ahead``.

    A state that is late by n periods lacks n commands more than others do.

    Args:
        delay: of commands, periods.
        ahead: s, as of :func:`lateness`.
        period: s.
        closes: whether the device closes the force channel; it matters only then.
    """
    if ahead == 0.0 or not closes:
        return delay, ahead
    number = delay + round(ahead / period)
    return max(number, 0), min(number, 0) * period


@inner
def impulse_in_flight(
    account: ControllerAccount,
    settings: ControllerSettings,
    flying: Array,
    device: DeviceSample,
    model: OperationalModelSample,
    time: float,
    impulse: Array,
) -> float:
    """Fill what commands in flight will have done, and half a period of the one that is made now.

    The mechanism gets sampled F_h, held over a period, while the device gets it continuously, on
    average half a period earlier.

    Args:
        account: of the controller.
        settings: of the controllers.
        flying: (n, 6) commands to the mechanism that have not moved its state yet, N and N m.
        device: the sample.
        model: now.
        time: s.
        impulse: (6,) to fill, N s and N m s, world axes.

    Returns:
        How long that takes, s.
    """
    period = account.period
    hand_on_mechanism(settings, device, model, time, impulse)
    for i in range(6):
        total = 0.5 * impulse[i]
        for row in range(flying.shape[0]):
            total += flying[row, i]
        impulse[i] = period * total
    return float((flying.shape[0] + 0.5) * period)


@inner
def predict(
    account: ControllerAccount,
    settings: ControllerSettings,
    flying: Array,
    device: DeviceSample,
    model: OperationalModelSample,
    time: float,
    predicted: OperationalModelSample,
) -> float:
    """Fill an operational model as it is when commands in flight have acted.

    The pose is not extrapolated; F_c is taken as constant, so that equilibrium is kept. Other
    arguments and what is returned: as of :func:`impulse_in_flight`.
    """
    put(predicted.values, model.values)
    impulse = local(6)
    duration = impulse_in_flight(account, settings, flying, device, model, time, impulse)
    for i in range(6):
        impulse[i] += duration * model.contact[i]
    x = model.inverse_inertia
    for i in range(6):
        change = dot(x[i], impulse) + duration * model.free_acceleration[i]
        predicted.twist[i] = model.twist[i] + change
    return duration


@kernel("void(ControllerSettings, OperationalModelSample, float64, float64[:,::1])")
def respond(
    settings: ControllerSettings, model: OperationalModelSample, time: float, out: Array
) -> None:
    """Fill how a command answers a wrench that moves both sides: s Λ_d X + r (1 - β) Π (6, 6).

    s = 1 at a start, else r; share r as :meth:`Clutch.ramp`. In rows and columns of the task space.

    Args:
        settings: of the controllers.
        model: the operational model.
        time: s.
        out: (6, 6) to fill; SI, world axes.
    """
    task, through = settings.task, force_let_through(settings, time)
    kept = let_through(settings, time) * (1.0 - settings.feedforward)
    for i in range(6):
        for j in range(6):
            moved = through * (settings.inertia[i] * model.inverse_inertia[i, j])
            out[i, j] = task[i] * task[j] * (moved + kept * model.wrench_projector[i, j])


@inner
def model_answer(
    settings: ControllerSettings,
    model: OperationalModelSample,
    time: float,
    locality: Locality,
    answer: Answer,
) -> None:
    """Fill how an answer depends on the device: G, K and B, as far as the device closes them.

    G = s ((1 + C6) Λ_d X - 1) + r (1 - β) Π, K = r k P_c, B = r_b b P_c; s = 1 at a start, else r;
    shares r and r_b as :meth:`Clutch.ramp` and :meth:`Clutch.brake`.

    Args:
        settings: of the controllers.
        model: the operational model.
        time: s.
        locality: what the device closes.
        answer: to fill.
    """
    task, inertia, found = settings.task, settings.inertia, answer.model
    through, damper = force_let_through(settings, time), settings.joint_damping
    spring = let_through(settings, time) * settings.joint_stiffness
    damper *= brake(settings, time, inertia[0], damper)
    respond(settings, model, time, found.force)
    again = through * settings.c6
    for i in range(6):
        for j in range(6):
            within = task[i] * task[j]
            moved = again * (inertia[i] * model.inverse_inertia[i, j])
            gain = found.force[i, j] + within * moved
            if i == j:
                gain -= within * through
            projector = within * model.constraint_projector[i, j]
            found.force[i, j] = gain * locality.force_channel
            found.stiffness[i, j] = spring * projector * locality.joint_constraint
            found.damping[i, j] = damper * projector * locality.joint_constraint
    answer.modelled = 1.0


@inner
def conclude(
    account: ControllerAccount,
    settings: ControllerSettings,
    device: DeviceSample,
    model: OperationalModelSample,
    time: float,
    locality: Locality,
    answer: Answer,
) -> None:
    """Complete an answer that has its wrenches."""
    account_for_springs(account, settings, answer.wrenches.error, model.constraint_projector)
    answer.given, answer.modelled, answer.to_mechanism = 1.0, 0.0, account.energies.to_mechanism
    closes = locality.force_channel != 0.0 or locality.joint_constraint != 0.0
    if closes and locality.with_model != 0.0:
        model_answer(settings, model, time, locality, answer)
    put(answer.sample.values, device.values)


@inner
def give_answer(
    account: ControllerAccount,
    settings: ControllerSettings,
    faded: Array,
    flying: Array,
    device: DeviceSample,
    model: OperationalModelSample,
    time: float,
    ahead: float,
    locality: Locality,
    answer: Answer,
) -> None:
    """Fill an answer's wrenches; for arguments see :func:`control_sample` and :func:`predict`."""
    seen, out = model, answer.wrenches
    if locality.force_channel != 0.0:
        seen = OperationalModelSample(local(MODEL_SIZE))
        ahead += predict(account, settings, flying, device, model, time, seen)
    answer_measurements(settings, device, seen, time, ahead, out)
    if not is_zero(faded):
        add_scaled(out.on_hand, 1.0, faded)
        limit_wrench(out.on_hand, settings.force_limit, settings.torque_limit)


@inner
def passive_wrench(account: ControllerAccount, answer: Answer, commanded: Array) -> None:
    """Fill the command to the mechanism (6,): the last answer, as far as the hand paid for it."""
    if answer.given == 0.0:
        commanded[:] = 0.0
        return
    put(commanded, answer.wrenches.on_mechanism)
    unpaid = account.energies.to_mechanism - account.from_hand - account.slack
    if account.passive == 0.0 or unpaid <= 0.0:
        return
    twist, inertia = account.twist, account.inertia
    given = dot(commanded, twist)
    if given <= 0.0:
        return
    account.changed += 1.0
    square = 0.0
    for i in range(6):
        square += inertia[i] * twist[i] * twist[i]
    for i in range(6):
        commanded[i] -= given / square * (inertia[i] * twist[i])


@inner
def queue_wrench(account: ControllerAccount, queue: Array, commanded: Array, acting: Array) -> None:
    """Put a wrench into the queue, and take out which acts from now on."""
    delay = queue.shape[0]
    if delay == 0:
        put(acting, commanded)
    else:
        at = int(account.queue_at)
        put(acting, queue[at])
        put(queue[at], commanded)
        account.queue_at = (at + 1) % delay
    put(account.acting, acting)


@inner
def remember_commanded(past: Array, commanded: Array) -> None:
    """Put the wrench commanded on the mechanism (6,) before what was (n, 6); n may be 0."""
    for row in range(past.shape[0] - 1, 0, -1):
        put(past[row], past[row - 1])
    if past.shape[0] > 0:
        put(past[0], commanded)


@kernel(
    "void(ControllerAccount, ControllerSettings, float64[::1], float64[:,::1], float64[:,::1],"
    " DeviceSample, OperationalModelSample, float64, int64, int64, Locality, boolean, boolean,"
    " Answer, float64[::1])"
)
def control_sample(
    account: ControllerAccount,
    settings: ControllerSettings,
    faded: Array,
    queue: Array,
    past: Array,
    device: DeviceSample,
    model: OperationalModelSample,
    time: float,
    apart_ns: int,
    elapsed_ns: int,
    locality: Locality,
    received: bool,
    answered: bool,
    answer: Answer,
    commanded: Array,
) -> None:
    """Answer a sample, account for it, and limit the command to the mechanism.

    What the controller does at a sample; :func:`command_mechanism` does the rest.

    Args:
        account: of the controller, changed.
        settings: of the controllers.
        faded: (6,) rest of the wrench carried on from another grasp, N and N m, world axes.
        queue: (delay, 6) commands to the mechanism that do not act yet, N and N m.
        past: (n, 6) those until now, newest first, likewise.
        device: the sample.
        model: the operational model.
        time: s.
        apart_ns: time of the sample minus that of the mechanism's state, ns; see :func:`lateness`.
        elapsed_ns: since the last operational model, ns; counted in whole periods.
        locality: what the device closes.
        received: whether the sample is a new one; else nothing is answered.
        answered: whether the answer's wrenches are there already, from a law in Python.
        answer: to fill; else the last one.
        commanded: (6,) to fill: what is sent to the mechanism, N and N m, world axes.
    """
    period = account.period
    account_for_motion(account, model.twist, max(round(elapsed_ns / 1e9 / period), 0) * period)
    if received:
        account_for_hand(account, device)
        if not answered:
            ahead, flying = lateness(apart_ns, period), queue
            closes = locality.force_channel != 0.0
            number, ahead = number_in_flight(queue.shape[0], ahead, period, closes)
            if number != queue.shape[0]:
                flying = past[: min(number, past.shape[0])]
            give_answer(
                account, settings, faded, flying, device, model, time, ahead, locality, answer
            )
        conclude(account, settings, device, model, time, locality, answer)
    passive_wrench(account, answer, commanded)


@kernel("void(ControllerAccount, float64[:,::1], float64[:,::1], float64[::1], float64[::1])")
def command_mechanism(
    account: ControllerAccount, queue: Array, past: Array, commanded: Array, acting: Array
) -> None:
    """Command the mechanism, once the command is sound.

    Args:
        account: of the controller, changed.
        queue: (delay, 6) commands that do not act yet, N and N m; changed.
        past: (n, 6) those until now, newest first, likewise; changed.
        commanded: (6,) what is sent, N and N m, world axes.
        acting: (6,) to fill: what acts from now on, likewise.
    """
    queue_wrench(account, queue, commanded, acting)
    remember_commanded(past, commanded)
