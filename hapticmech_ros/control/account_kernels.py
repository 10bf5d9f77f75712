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

Arrays are laid out as :mod:`~hapticmech_ros.control.loop_layout` says.

A hand's wrench in the period to come, and what a device adds to a command for it.

A command is held over a period T and answers the sample F at its start, while what acts on the
device is the mean F̄ of the hand's wrench over the period. By the last three samples, which are h_1
and h_2 apart, and their divided differences,

    F̄ - F = F' + F'',      F' = T/2 F[0,1],      F'' = (T²/3 + T h_1/2) F[0,1,2]

which for even spacing is ½ ∇F + 5/12 ∇²F, as of Adams and Bashforth. The device adds

    G F' + Σ H_j F'_j + W (G F'' + Σ H_j F''_j)
    W = (1 + 2 R²)⁻¹ (1 - 8/5 R²),      R = (K + 1) (1 + G)

with G of :mod:`~hapticmech_ros.control.loop_stability`, and H_j and F_j of K other hands, if there
are any (:mod:`~hapticmech_ros.control.other_hands`). Half a period of delay in the force channel
would be an error of ω T/2 (m / m_d - 1) of a mass m that is felt on a device's m_d, 1 / (1 + G)
along a direction. Where m is large, W is 1, and what is left is of third order in ω T. Where it is
small, G amplifies, also what a mass of the hand's own exerts on the device, -r u of a command u,
and the whole parabola would make that loop unstable at half the sample rate. There W tends to -4/5,
which attenuates that rate, and leaves an error of second order, 5/12 (1 - W) (ω T)² (m / m_d - 1).
With masses that are rigidly fixed to K + 1 devices on one body, equal or not, no loop that is
stable without F' and F'' is unstable with them (``test/control/test_hand_lead.py``).

A memory is an array (22,): the number of samples it has, then three rows, newest first: time since
the sample before, s, and (6,) F_h.
"""

from __future__ import annotations

from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.control.kernels import (
    C2,
    C6,
    DAMPING,
    FEEDFORWARD,
    FORCE_LIMIT,
    HELD_STIFFNESS,
    JOINT_DAMPING,
    JOINT_STIFFNESS,
    STIFFNESS,
    TORQUE_LIMIT,
    answer_measurements,
    brake,
    displacement,
    force_let_through,
    hand_on_mechanism,
    let_through,
)
from hapticmech_ros.control.kernels import INERTIA as DEVICE_INERTIA
from hapticmech_ros.control.loop_layout import (
    ANSWER,
    CONTROLLER_ACCOUNT,
    FORCE_LOCAL,
    JOINT_LOCAL,
    ON_HAND,
    ON_MECHANISM,
    POSE_ERROR,
    WITH_MODEL,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL
from hapticmech_ros.numerics.saturation import limit
from hapticmech_ros.numerics.small_matrices import dot, solve_in_place

ROW, MOST = 7, 3
MEMORY_SIZE = 1 + MOST * ROW
_NEWEST, _SECOND, _THIRD = 1, 1 + ROW, 1 + 2 * ROW
# Beyond what a weight below 1 can do to numbers of several units: no gain of a mechanism.
_MOST_GROWTH = 1e6


@inner
def remember(memory: Array, spacing: float, wrench: Array) -> None:
    """Remember a wrench (6,), ``spacing`` (s) after the last one; see :func:`remember_wrench`."""
    for i in range(MEMORY_SIZE - 1, ROW, -1):
        memory[i] = memory[i - ROW]
    memory[_NEWEST] = spacing
    put(memory[_NEWEST + 1 : _SECOND], wrench)
    memory[0] = min(memory[0] + 1.0, MOST)


@inner
def change_of_mean(memory: Array, start: float, period: float, change: Array) -> None:
    """Fill (12,) how the mean over a period differs from F; see :func:`mean_change`."""
    change[:] = 0.0
    if memory[0] < 2.0:
        return
    # Samples that are closer than a period would amplify their noise.
    first, second = max(memory[_NEWEST], period), max(memory[_SECOND], period)
    end = start + period
    middle = 0.5 * (start + end)
    square = (start * start + start * end + end * end) / 3.0
    for i in range(6):
        newest, before = memory[_NEWEST + 1 + i], memory[_SECOND + 1 + i]
        slope = (newest - before) / first
        change[i] = middle * slope
        if memory[0] > 2.0:
            bend = (slope - (before - memory[_THIRD + 1 + i]) / second) / (first + second)
            change[6 + i] = (square + first * middle) * bend


@inner
def largest(vector: Array) -> float:
    """Return the largest size of six numbers."""
    most = 0.0
    for i in range(6):
        most = max(most, abs(vector[i]))
    return most


@inner
def weigh(gain: Array, hands: float, bend: Array) -> bool:
    """Replace ``bend`` (6,) by W bend; return whether that is regular.

    ``gain`` (36,) is G row by row, SI units, and ``hands`` K + 1.
    """
    ratio, factor, solved = shaped(local(36), (6, 6)), shaped(local(36), (6, 6)), local(6)
    for i in range(6):
        solved[i] = bend[i]
        for j in range(6):
            ratio[i, j] = hands * gain[6 * i + j]
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
def lead(memory: Array, period: float, gain: Array, others: Array, command: Array) -> None:
    """Add what the module says to a command (6,), or nothing where it is not regular.

    ``gain`` (36,) is G row by row, SI units; ``others`` (13,) are both sums over H_j, and K.
    """
    change, line, bend, moves = local(12), local(6), local(6), False
    change_of_mean(memory, 0.0, period, change)
    for i in range(6):
        line[i], bend[i] = others[i], others[6 + i]
        for j in range(6):
            line[i] += gain[6 * i + j] * change[j]
            bend[i] += gain[6 * i + j] * change[6 + j]
        moves = moves or line[i] != 0.0 or bend[i] != 0.0
    if moves and weigh(gain, 1.0 + others[12], bend):
        for i in range(6):
            command[i] += line[i] + bend[i]


@kernel("void(float64[::1], float64, float64[::1])")
def remember_wrench(memory: Array, spacing: float, wrench: Array) -> None:
    """Remember a sample of a hand's wrench.

    Args:
        memory: (22,) changed; see the module. Zeros at first.
        spacing: s since the sample before; of no meaning for the first one.
        wrench: (6,) F_h, N and N m, world axes.
    """
    remember(memory, spacing, wrench)


@kernel("void(float64[::1], float64, float64, float64[::1])")
def mean_change(memory: Array, start: float, period: float, change: Array) -> None:
    """Fill how the mean of a wrench over a period differs from its newest sample, F' and F''.

    Args:
        memory: (22,) of its samples; see the module.
        start: s, from the newest sample to the period's start.
        period: T, s.
        change: (12,) to fill, F' by the line through two samples, and what the parabola through
            three adds to it, N and N m, world axes; zero where fewer are known.
    """
    change_of_mean(memory, start, period, change)


PERIOD, PASSIVE, SLACK, INERTIA = CONTROLLER_ACCOUNT.starts("period", "passive", "slack", "inertia")
GIVEN, STORED, INJECTED, LOST = CONTROLLER_ACCOUNT.starts(
    "to_mechanism", "stored", "injected", "dissipated"
)
ACTING, MOVING, MOVED = CONTROLLER_ACCOUNT.starts("acting", "twist_known", "twist")
STRETCHED, ERROR, SPRING, PROJECTOR, CHANNEL = CONTROLLER_ACCOUNT.starts(
    "error_known", "error", "spring", "projector", "channel"
)
FROM_HAND, CHANGED, RECEIVED, HEARD_SAMPLE, QUEUE_AT = CONTROLLER_ACCOUNT.starts(
    "from_hand", "changed", "sample_known", "sample", "queue_at"
)
(IS_ANSWER, WRENCHES, MODELLED, FORCE_GAIN, SPRING_GAIN, DAMPER_GAIN, ANSWERED, GIVEN_THEN) = (
    ANSWER.starts(*ANSWER)
)
TO_MECHANISM, ERROR_OF_POSE = WRENCHES + 6 * ON_MECHANISM, WRENCHES + 6 * POSE_ERROR
PUSH = DEVICE_SAMPLE.start("hand_wrench")
SAMPLE_SIZE, MODEL_SIZE = DEVICE_SAMPLE.size, OPERATIONAL_MODEL.size
X, P_C, SHARE, FREE, TWIST, CONTACT = OPERATIONAL_MODEL.starts(
    *("inverse_inertia", "constraint_projector", "wrench_projector", "free_acceleration"),
    *("twist", "contact"),
)


@inner
def account_for_motion(account: Array, twist: Array, duration: float) -> None:
    """Add to E_m what the wrench that acts gave in ``duration`` (s), until the twist (6,)."""
    if account[MOVING] != 0.0:
        total = 0.0
        for i in range(6):
            total += account[ACTING + i] * (account[MOVED + i] + twist[i])
        account[GIVEN] += duration * (0.5 * total)
    account[MOVING] = 1.0
    put(account[MOVED : MOVED + 6], twist)


@inner
def account_for_hand(account: Array, sample: Array) -> None:
    """Add to E_h what the hand did until a sample (19,) of the device."""
    before = account[HEARD_SAMPLE : HEARD_SAMPLE + SAMPLE_SIZE]
    if account[RECEIVED] != 0.0:
        way, total = local(6), 0.0
        displacement(before, sample, way)
        for i in range(6):
            total += 0.5 * (before[PUSH + i] + sample[PUSH + i]) * way[i]
        account[FROM_HAND] += total
    account[RECEIVED] = 1.0
    put(before, sample)


@inner
def spring_energy(error: Array, gain: float, projector: Array, channel: Array) -> float:
    """Return ½ eᵀ (gain P_c + C) e, with P_c (36,) row by row and the diagonal (6,) of C; J."""
    held = 0.0
    for i in range(6):
        total = 0.0
        for j in range(6):
            total += projector[6 * i + j] * error[j]
        held += error[i] * (gain * total + channel[i] * error[i])
    return 0.5 * held


@inner
def account_for_springs(
    account: Array,
    error: Array,
    projector: Array,
    spring: float,
    damper: float,
    stiffness: Array,
    damping: Array,
    duration: float,
) -> None:
    """Account for the springs and dampers of an answer, ``duration`` (s) after the last one.

    Args:
        account: (account,) of the controller, changed; see ``loop_layout``.
        error: (6,) e of the answer, m and rad, world axes.
        projector: (36,) P_c, row by row.
        spring: k of the joint constraint, N/m.
        damper: b of the joint constraint, N s/m.
        stiffness: (6,) diagonal of C's stiffness, N/m and N m/rad.
        damping: (6,) diagonal of C's damping, N s/m and N m s/rad.
        duration: s.
    """
    stored = spring_energy(error, spring, projector, stiffness)
    before, old = account[ERROR : ERROR + 6], account[PROJECTOR : PROJECTOR + 36]
    channel = account[CHANNEL : CHANNEL + 6]
    if account[STRETCHED] != 0.0 and duration > 0.0:
        account[INJECTED] += stored - spring_energy(error, account[SPRING], old, channel)
        way = local(6)
        for i in range(6):
            way[i] = error[i] - before[i]
        account[LOST] += 2.0 * spring_energy(way, damper, projector, damping) / duration
    account[STORED], account[STRETCHED], account[SPRING] = stored, 1.0, spring
    put(before, error)
    put(old, projector)
    put(channel, stiffness)


@inner
def predict(
    account: Array,
    settings: Array,
    queue: Array,
    device: Array,
    operational_model: Array,
    time: float,
    predicted: Array,
) -> float:
    """Fill an operational model once what is in the queue has acted; return how long it takes, s.

    And half a period more of the wrench that F_h and F_c command on it now: it gets F_h of the
    samples, held over a period, and the device as it varies, half a period earlier in the mean. The
    pose is not extrapolated; F_c is taken as constant, so that equilibrium is kept.

    Args:
        account: (account,) of the controller; see ``loop_layout``.
        settings: (59,) of the controllers.
        queue: (delay, 6) commands to the mechanism that have not acted yet, N and N m.
        device: (19,) the sample, in SI units; see ``layout.DEVICE_SAMPLE``.
        operational_model: (139,) now, in SI units; see ``layout.OPERATIONAL_MODEL``.
        time: s.
        predicted: (139,) to fill, likewise.
    """
    put(predicted, operational_model)
    duration, impulse = (queue.shape[0] + 0.5) * account[PERIOD], local(6)
    hand_on_mechanism(settings, device, operational_model, time, impulse)
    for i in range(6):
        total = 0.5 * impulse[i]
        for row in range(queue.shape[0]):
            total += queue[row, i]
        impulse[i] = account[PERIOD] * total + duration * operational_model[CONTACT + i]
    x = shaped(operational_model[X:], (6, 6))
    for i in range(6):
        change = dot(x[i], impulse) + duration * operational_model[FREE + i]
        predicted[TWIST + i] = operational_model[TWIST + i] + change
    return float(duration)


@inner
def respond(settings: Array, operational_model: Array, time: float, out: Array) -> None:
    """Fill how a command answers a wrench that moves both sides: s Λ_d X + r (1 - β) Π (36,).

    s = 1 at a start, else r; share r as :meth:`Clutch.ramp`. In rows and columns of the task space.

    Args:
        settings: (59,) of the controllers.
        operational_model: (139,) operational model.
        time: s.
        out: to fill, row by row; SI, world axes.
    """
    task, inertia = settings[:DEVICE_INERTIA], settings[DEVICE_INERTIA:STIFFNESS]
    through = force_let_through(settings, time)
    kept = let_through(settings, time) * (1.0 - settings[FEEDFORWARD])
    for i in range(6):
        for j in range(6):
            at = 6 * i + j
            moved = through * (inertia[i] * operational_model[X + at])
            out[at] = task[i] * task[j] * (moved + kept * operational_model[SHARE + at])


@inner
def model_answer(
    settings: Array, operational_model: Array, time: float, locality: Array, answer: Array
) -> None:
    """Say how an answer depends on the device: G, K and B, as far as the device closes them.

    G = s ((1 + C6) Λ_d X - 1) + r (1 - β) Π, K = r k P_c, B = r_b b P_c; s = 1 at a start, else r;
    shares r and r_b as :meth:`Clutch.ramp` and :meth:`Clutch.brake`.

    Args:
        settings: (59,) of the controllers.
        operational_model: (139,) operational model.
        time: s.
        locality: (3,) see :func:`answer_sample`.
        answer: to fill.
    """
    task, inertia = settings[:DEVICE_INERTIA], settings[DEVICE_INERTIA:STIFFNESS]
    ramp, through = let_through(settings, time), force_let_through(settings, time)
    spring = ramp * settings[JOINT_STIFFNESS]
    damper = settings[JOINT_DAMPING]
    damper *= brake(settings, time, inertia[0], damper)
    respond(settings, operational_model, time, answer[FORCE_GAIN:SPRING_GAIN])
    again = through * settings[C6]
    for i in range(6):
        for j in range(6):
            at, within = 6 * i + j, task[i] * task[j]
            gain = answer[FORCE_GAIN + at]
            gain += within * (again * (inertia[i] * operational_model[X + at]))
            if i == j:
                gain -= within * through
            projector = within * operational_model[P_C + at]
            answer[FORCE_GAIN + at] = gain * locality[FORCE_LOCAL]
            answer[SPRING_GAIN + at] = spring * projector * locality[JOINT_LOCAL]
            answer[DAMPER_GAIN + at] = damper * projector * locality[JOINT_LOCAL]
    answer[MODELLED] = 1.0


@inner
def conclude(
    account: Array,
    settings: Array,
    device: Array,
    operational_model: Array,
    time: float,
    locality: Array,
    answer: Array,
) -> None:
    """Complete an answer that has its wrenches; ``locality`` as in :func:`answer_sample`."""
    account_for_springs(
        account,
        answer[ERROR_OF_POSE : ERROR_OF_POSE + 6],
        operational_model[P_C : P_C + 36],
        settings[JOINT_STIFFNESS],
        settings[JOINT_DAMPING],
        settings[STIFFNESS:DAMPING],
        settings[DAMPING:HELD_STIFFNESS],
        account[PERIOD],
    )
    answer[MODELLED] = 0.0
    closes = locality[FORCE_LOCAL] != 0.0 or locality[JOINT_LOCAL] != 0.0
    if closes and locality[WITH_MODEL] != 0.0:
        model_answer(settings, operational_model, time, locality, answer)
    answer[IS_ANSWER], answer[GIVEN_THEN] = 1.0, account[GIVEN]
    put(answer[ANSWERED : ANSWERED + SAMPLE_SIZE], device)


@inner
def give_answer(
    account: Array,
    settings: Array,
    faded: Array,
    queue: Array,
    device: Array,
    operational_model: Array,
    time: float,
    ahead: float,
    locality: Array,
    answer: Array,
) -> None:
    """Answer a sample; see :func:`answer_sample`."""
    out = shaped(answer[WRENCHES:], (6, 6))
    if locality[FORCE_LOCAL] != 0.0:
        predicted = local(MODEL_SIZE)
        later = ahead + predict(
            account, settings, queue, device, operational_model, time, predicted
        )
        answer_measurements(settings, device, predicted, time, later, out)
    else:
        answer_measurements(settings, device, operational_model, time, ahead, out)
    carries = False
    for i in range(6):
        carries = carries or faded[i] != 0.0
    if carries:
        for i in range(6):
            out[ON_HAND, i] += faded[i]
        limit(out[ON_HAND, :3], settings[FORCE_LIMIT])
        limit(out[ON_HAND, 3:], settings[TORQUE_LIMIT])


@inner
def passive_wrench(account: Array, answer: Array, commanded: Array) -> None:
    """Fill the command to the mechanism (6,): what of the last answer the hand has paid."""
    if answer[IS_ANSWER] == 0.0:
        commanded[:] = 0.0
        return
    put(commanded, answer[TO_MECHANISM : TO_MECHANISM + 6])
    if account[PASSIVE] == 0.0 or account[GIVEN] - account[FROM_HAND] - account[SLACK] <= 0.0:
        return
    twist, inertia = account[MOVED : MOVED + 6], account[INERTIA : INERTIA + 6]
    given = dot(commanded, twist)
    if given <= 0.0:
        return
    account[CHANGED] += 1.0
    square = 0.0
    for i in range(6):
        square += inertia[i] * twist[i] * twist[i]
    for i in range(6):
        commanded[i] -= given / square * (inertia[i] * twist[i])


@inner
def queue_wrench(account: Array, queue: Array, commanded: Array, acting: Array) -> None:
    """Put a wrench into the queue, and take out which acts from now on."""
    delay = queue.shape[0]
    if delay == 0:
        put(acting, commanded)
    else:
        at = int(account[QUEUE_AT])
        put(acting, queue[at])
        put(queue[at], commanded)
        account[QUEUE_AT] = (at + 1) % delay
    put(account[ACTING : ACTING + 6], acting)


@inner
def remember_commanded(past: Array, commanded: Array) -> None:
    """Put the wrench commanded on the mechanism (6,) before what was (n, 6)."""
    for row in range(past.shape[0] - 1, 0, -1):
        put(past[row], past[row - 1])
    put(past[0], commanded)


@kernel("void(float64[::1], float64[::1], float64)")
def move_point_on(account: Array, operational_model: Array, elapsed: float) -> None:
    """Account for the mechanism's motion until an operational model (139,), ``elapsed`` s on.

    Args:
        account: (account,) of the controller, changed; see ``loop_layout``.
        operational_model: (139,) now, in SI units; see ``layout.OPERATIONAL_MODEL``.
        elapsed: s since the last one.
    """
    account_for_motion(account, operational_model[TWIST : TWIST + 6], elapsed)


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[:,::1], float64[::1], float64[::1],"
    " float64, float64, float64[::1], float64[::1])"
)
def answer_sample(
    account: Array,
    settings: Array,
    faded: Array,
    queue: Array,
    device: Array,
    operational_model: Array,
    time: float,
    ahead: float,
    locality: Array,
    answer: Array,
) -> None:
    """Answer a sample of the device, and account for it.

    Args:
        account: (account,) of the controller, changed; see ``loop_layout``.
        settings: (59,) of the controllers, see :mod:`~hapticmech_ros.control.kernels`.
        faded: (6,) rest of the wrench carried on from another grasp, N and N m, world axes.
        queue: (delay, 6) commands to the mechanism that have not acted yet, N and N m.
        device: (19,) the sample, in SI units; see ``layout.DEVICE_SAMPLE``.
        operational_model: (139,) in SI units; see ``layout.OPERATIONAL_MODEL``.
        time: s.
        ahead: s, from the time of ``operational_model`` to that of ``device``.
        locality: (3,) 1 where the device closes the force channel, and the joint constraint; and 1
            if the answer is to say how it depends on the device.
        answer: (answer,) to fill; see ``loop_layout``.
    """
    account_for_hand(account, device)
    give_answer(
        account, settings, faded, queue, device, operational_model, time, ahead, locality, answer
    )
    conclude(account, settings, device, operational_model, time, locality, answer)


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[::1], float64, float64[::1],"
    " float64[::1])"
)
def account_for_answer(
    account: Array,
    settings: Array,
    device: Array,
    operational_model: Array,
    time: float,
    locality: Array,
    answer: Array,
) -> None:
    """Account for an answer to a sample that was computed elsewhere; as :func:`answer_sample`.

    Args:
        account: (account,) of the controller, changed; see ``loop_layout``.
        settings: (59,) of the controllers; see ``loop_layout``.
        device: (19,) sample of the device, in SI units; see ``layout.DEVICE_SAMPLE``.
        operational_model: (139,) in SI units; see ``layout.OPERATIONAL_MODEL``.
        time: s.
        locality: (3,) what the device closes; see :func:`answer_sample`.
        answer: (answer,) filled; see ``loop_layout``.
    """
    account_for_hand(account, device)
    conclude(account, settings, device, operational_model, time, locality, answer)


@kernel("void(float64[::1], float64[::1], float64, float64[::1])")
def command_response(settings: Array, operational_model: Array, time: float, out: Array) -> None:
    """Fill how a command answers F_c: C2 (s Λ_d X + r (1 - β) Π), of the task space.

    Args:
        settings: (59,) of the controllers; see ``loop_layout``.
        operational_model: (139,) in SI units; see ``layout.OPERATIONAL_MODEL``.
        time: s.
        out: (36,) to fill, row by row: 1, m and 1/m, world axes.
    """
    respond(settings, operational_model, time, out)
    for i in range(36):
        out[i] *= settings[C2]


@kernel("void(float64[::1], float64[:,::1], float64[:,::1], float64[::1], float64[:,::1])")
def command_mechanism(
    account: Array, queue: Array, past: Array, answer: Array, wrenches: Array
) -> None:
    """Fill the wrench commanded on the mechanism, and what acts on it from now on: rows of (2, 6).

    Args:
        account: (account,) of the controller, changed; see ``loop_layout``.
        queue: (d, 6) commands to the mechanism that do not act yet, N and N m.
        past: (n, 6) those until now, the last one first, likewise; changed.
        answer: (answer,) the last one; see ``loop_layout``.
        wrenches: (2, 6) to fill: what is sent, and what acts from now on, N and N m, world axes.
    """
    passive_wrench(account, answer, wrenches[0])
    queue_wrench(account, queue, wrenches[0], wrenches[1])
    remember_commanded(past, wrenches[0])
