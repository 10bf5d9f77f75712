# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A period of the simulated device in one kernel, or a kernel for each of its substeps.

    (Λ_d + Λ_a) ẍ = F_s + F_o + u + w - b ẋ - f

u follows the command, limited by the actuators and held over a sample period (zero-order hold),
with the actuators' lag; F_o, by others than the hand, is held as well. The hand's own law F_s acts
all through the period, and its own mass Λ_a while it holds. w is weight, f end stops and Coulomb
friction. F_h, between device and hand, is F_s - Λ_a ẍ. A mass behind a grip is a separate body,
moved by the same steps: F_s pulls it, and the grip's spring and damper exert F_h.

A substep of length h drifts for h/2, changes the twist by the forces there, and drifts for h/2 with
the new one (position Verlet), so that a wrench acts by its mean over the substep to second order:

    p' = p + h/2 v,     v⁺ = v + h (Λ_d + Λ_a)⁻¹ (F_s(p', v') + ... - b (v + v⁺)/2)
    p⁺ = p' + h/2 v⁺

with v' = v + h/2 (Λ_d + Λ_a)⁻¹ (F_s + ... - b v) by the hand's wrench of the time before.

The device's parameters and the wrenches on it are one array, ``data``: a :class:`DeviceModel`,
followed by the plan of its hand (:mod:`~hapticmech_ros.device.hand_kernels`). Its state is another
one, a :class:`SimulatedState`.

End stops, then Coulomb friction, resist a device's motion besides viscous damping.

Both are implicit in the speed at the end of a step h and therefore add no energy at any stiffness
or friction; g = h / m, or h / I of rotation.

End stop, along the way out n, where d is the distance beyond the limit in the middle of the step:
the force f = k (d + ½ h v⁺) + b v⁺, if positive, gives

    v⁺ = (v - g k d) / (1 + g (b + ½ h k))

without b where the speed turns round, since work is done by the mean of both speeds.

Coulomb friction takes up to g F_c of the speed, never more than there is:

    v⁺ = max(1 - g F_c / |v|, 0) v

A device's driver works at the sample rate: compensation before a period, force sensing after it.

The hand's wrench without a sensor is a momentum observer's, from encoders and actuators. All forces
change the momentum p = Λ_d v. The known ones, actuators u, weight w, viscous damping b v and
friction f, are subtracted, and a low-pass r filters the rest:

    ṙ = ω (ṗ - u - w + b v + f - r),      ω = 2 π bandwidth

over a period T, with means of the period and the exact step of the low-pass,

    r⁺ = r + (1 - e^(-ω T)) (Λ_d (v⁺ - v) / T - u - w + b (v + v⁺) / 2 + f - r)

(after De Luca and Mattone, "Sensorless robot collision detection and hybrid force/motion control",
ICRA 2005, here for a body in Cartesian space). A constant wrench is found without bias, a sinusoid
of frequency f Hz lags by arctan(f / bandwidth) and half a period. The estimate attributes
everything else to the hand: Coulomb friction beyond its compensated share, end stops, an error of
the mass.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.compilation.records import Nested, Number, Record, Vector, matrix
from hapticmech_ros.device.hand_kernels import (
    OPEN,
    Body,
    HandModel,
    Place,
    grasp_window,
    hand_wrench,
    pull,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import TWIST, WRENCH, DeviceSample
from hapticmech_ros.numerics.rotation_kernels import (
    exp3,
    log3,
    multiply,
    multiply_transposed,
    quaternion_of,
)
from hapticmech_ros.numerics.saturation import limit
from hapticmech_ros.numerics.small_matrices import add_scaled, dot, subtract3


class Stop(Record):
    """An end of the workspace, of translation or rotation.

    Attributes:
        limit: distance from the home pose, m or rad; 0 for none.
        stiffness: N/m or N m/rad.
        damping: N s/m or N m s/rad.
    """

    limit, stiffness, damping = Number(), Number(), Number()


class DeviceModel(Record):
    """A device's parameters, and the wrenches on it.

    Six numbers are of translation and rotation along and about the axes of the world; wrenches act
    on the device at the point held, N and N m.

    Attributes:
        step: of the integration, h, s.
        period: of a sample, T, s.
        substeps: steps in a period.
        filter_gain: of the velocity filter, share of a new value that a period takes over.
        force_limit, torque_limit: of the actuators, N and N m.
        position_step, angle_step: of the encoders, m and rad; 0 if ideal.
        lag: share of the actuators' error that is left after a step; 0 if they have none.
        lag_mean: mean of that share over a step.
        friction, angular_friction: Coulomb friction F_c, N and N m.
        stop, angular_stop: end stops.
        damping: b, N s/m and N m s/rad.
        gain: change of the twist per wrench and step, h Λ_d⁻¹, s/kg and s/(kg m²); 0 where the
            scene has no direction.
        held_gain: the same with the hand's own mass, h (Λ_d + Λ_a)⁻¹.
        arm: Λ_a, the hand's own mass and inertia, kg and kg m².
        command: the wrench commanded to the actuators.
        weight: w.
        push: F_o, by others than the hand.
        held: where the hand could take hold.
        task: 1 where the scene has a direction, else 0.
        acts: 1 where there are actuators, else 0.
        compensated: share of the friction that the driver compensates.
        dead_zone, angular_dead_zone: speeds above which it does, m/s and rad/s.
        lifts: 1 if the driver lifts the weight.
        senses_itself: source of the hand's reported wrench: ``MEASURED``, ``ESTIMATED`` or
            ``ABSENT``.
        observer_share: share of the observer's error that a period takes away.
        actuator_share: mean over a period of the share of the actuators' error that is left.
        inertia: Λ_d, kg and kg m².
        hand: that holds it.
    """

    step, period, substeps, filter_gain = Number(), Number(), Number(), Number()
    force_limit, torque_limit = Number(), Number()
    position_step, angle_step = Number(), Number()
    lag, lag_mean = Number(), Number()
    friction, angular_friction = Number(), Number()
    stop, angular_stop = Nested(Stop), Nested(Stop)
    damping, gain, held_gain, arm = Vector(6), Vector(6), Vector(6), Vector(6)
    command, weight, push = Vector(6), Vector(6), Vector(6)
    held = Nested(Place)
    task, acts = Vector(6), Vector(6)
    compensated, dead_zone, angular_dead_zone, lifts = Number(), Number(), Number(), Number()
    senses_itself, observer_share, actuator_share = Number(), Number(), Number()
    inertia = Vector(6)
    hand = Nested(HandModel)


class PublishedState(DeviceSample):
    """A device's published quantities: measured and reported, world axes at the point held.

    Attributes:
        applied: by the actuators at this time, N and N m.
    """

    applied = Vector(6, WRENCH)


class SimulatedState(PublishedState):
    """State of a device: the published part, and the rest.

    Attributes:
        body: the true motion of the point held.
        seen: measured rotation.
        home: where the device started, about which the workspace is.
        anchor: where the hand took hold.
        window: number of the window in which the hand holds; ``OPEN`` if no hand does.
        limb: the hand's mass behind a grip.
        pull: by the arm on that mass, N and N m, world axes.
        own: F_h by the hand, on the device, N and N m, world axes at the point held.
    """

    body, seen = Nested(Body), matrix(3, 3)
    home, anchor = Nested(Place), Nested(Place)
    window = Number()
    limb = Nested(Body)
    pull, own = Vector(6, WRENCH), Vector(6, WRENCH)


class Substep(Record):
    """Values that :func:`end_substep` needs from the substep's start.

    Attributes:
        twist: at its start, m/s and rad/s.
        others: all forces but the hand's, N and N m.
        own: the hand's in its middle, N and N m.
        limb_twist: of the mass behind a grip at its start, m/s and rad/s.
    """

    twist = Vector(6, TWIST)
    others, own = Vector(6, WRENCH), Vector(6, WRENCH)
    limb_twist = Vector(6, TWIST)


MODEL_SIZE, SUBSTEP_SIZE = DeviceModel.layout.size, Substep.layout.size
# Sources of the hand's wrench that a device reports.
MEASURED, ESTIMATED, ABSENT = 0.0, 1.0, 2.0


@inner
def _add_friction(
    share: float, dead_zone: float, coulomb: float, damping: float, rate: Array, given: Array
) -> None:
    """Fill a share of friction's force or torque (3,) at a rate (3,), none in the dead zone."""
    speed = np.sqrt(dot(rate, rate))
    known = min(max(speed / dead_zone - 1.0, 0.0), 1.0)
    for i in range(3):
        given[i] = 0.0
        if known > 0.0:
            given[i] = share * (known * (coulomb / speed + damping) * rate[i])


@kernel("void(DeviceModel, float64[::1], float64[::1])")
def compensate(device: DeviceModel, twist: Array, added: Array) -> None:
    """Fill the wrench that the driver adds to a command.

    Args:
        device: its parameters.
        twist: (6,) measured, m/s and rad/s, world axes.
        added: (6,) to fill, N and N m, world axes.
    """
    added[:] = 0.0
    if device.compensated > 0.0:
        share, damping = device.compensated, device.damping
        dead, turning = device.dead_zone, device.angular_dead_zone
        _add_friction(share, dead, device.friction, damping[0], twist[:3], added[:3])
        _add_friction(share, turning, device.angular_friction, damping[3], twist[3:], added[3:])
    for i in range(6):
        added[i] = device.task[i] * (added[i] - device.lifts * device.weight[i])


@kernel("void(DeviceModel, SimulatedState, SimulatedState)")
def estimate_hand(device: DeviceModel, before: SimulatedState, out: SimulatedState) -> None:
    """Fill the reported wrench of the hand without a sensor: r⁺ of the module.

    Args:
        device: its parameters, and its actuators' last command.
        before: its state at the period's start.
        out: its state at the end.
    """
    reported = out.hand_wrench
    if device.senses_itself == ABSENT:
        reported[:] = 0.0
        return
    mean, known = local(6), local(6)
    known[:] = 0.0
    for i in range(6):
        mean[i] = 0.5 * (before.twist[i] + out.twist[i])
    if device.compensated > 0.0:
        share, dead, turning = device.compensated, device.dead_zone, device.angular_dead_zone
        _add_friction(share, dead, device.friction, 0.0, mean[:3], known[:3])
        _add_friction(share, turning, device.angular_friction, 0.0, mean[3:], known[3:])
    for i in range(6):
        asked = device.command[i]
        given = asked + device.actuator_share * (before.applied[i] - asked)
        change = device.inertia[i] * (out.twist[i] - before.twist[i]) / device.period
        pushed = change - given - device.task[i] * device.weight[i]
        resisted = device.damping[i] * mean[i] + known[i]
        estimate = before.hand_wrench[i]
        behind = device.task[i] * (pushed + resisted) - estimate
        reported[i] = estimate + device.observer_share * behind


@kernel("void(DeviceModel, SimulatedState, float64[::1])")
def command_device(device: DeviceModel, state: SimulatedState, command: Array) -> None:
    """Command actuators, within their limits, with a command and the driver's additions.

    Args:
        device: its parameters and command, changed.
        state: with the measured twist.
        command: (6,) servo_cf, N and N m, world axes.
    """
    given = device.command
    compensate(device, state.twist, given)
    for i in range(6):
        asked = command[i] + given[i]
        given[i] = device.acts[i] * asked
    limit(given[:3], device.force_limit)
    limit(given[3:], device.torque_limit)


@inner
def stop(end: Stop, away: Array, rate: Array, gain: float, left: float) -> None:
    """Slow a rate (3,) of ``away`` (3,) down at the end of the workspace.

    ``left`` s are left of the step.
    """
    distance = np.sqrt(dot(away, away))
    if distance == 0.0:
        return
    beyond = distance - end.limit
    speed = dot(away, rate) / distance
    if beyond + left * speed <= 0.0:
        return
    pushed = speed - gain * end.stiffness * beyond
    damping = end.damping if pushed * speed >= 0.0 else 0.0
    after = pushed / (1.0 + gain * (damping + left * end.stiffness))
    if after < speed:
        add_scaled(rate, (after - speed) / distance, away)


@inner
def rub(rate: Array, most: float) -> None:
    """Take ``most`` of a rate (3,) away, or all."""
    speed = np.sqrt(dot(rate, rate))
    share = 0.0 if speed <= most else 1.0 - most / speed
    for i in range(3):
        rate[i] *= share


@inner
def _drift(device: DeviceModel, body: Body) -> None:
    """Carry the pose of a body on by half a substep."""
    way, turn, turned = local(3), shaped(local(9), (3, 3)), shaped(local(9), (3, 3))
    half, twist = 0.5 * device.step, body.twist
    for i in range(3):
        body.position[i] += half * twist[i]
        way[i] = half * twist[3 + i]
    exp3(way, turn)
    multiply(turn, body.rotation, turned)
    put(body.rotation, turned)


@inner
def _resist(device: DeviceModel, gain: Array, home: Place, body: Body) -> None:
    """Let end stops and friction act on a body's twist in the middle of a substep."""
    left, rate, spin, away = 0.5 * device.step, body.twist[:3], body.twist[3:], local(3)
    if device.stop.limit > 0.0:
        subtract3(body.position, home.position, away)
        stop(device.stop, away, rate, gain[0], left)
    if device.angular_stop.limit > 0.0:
        turn = shaped(local(9), (3, 3))
        multiply_transposed(body.rotation, home.rotation, turn)
        log3(turn, away)
        stop(device.angular_stop, away, spin, gain[5], left)
    if device.friction > 0.0:
        rub(rate, gain[0] * device.friction)
    if device.angular_friction > 0.0:
        rub(spin, gain[5] * device.angular_friction)


@inner
def _give(device: DeviceModel, applied: Array, given: Array) -> None:
    """Advance the actuators' wrench (6,) by a substep, and fill its mean over that (6,)."""
    asked = device.command
    if device.lag_mean == 0.0:
        put(given, asked)
        put(applied, asked)
        return
    for i in range(6):
        behind = applied[i] - asked[i]
        given[i] = asked[i] + device.lag_mean * behind
        applied[i] = asked[i] + device.lag * behind


@inner
def time_of(device: DeviceModel, ticks: int, index: int) -> float:
    """Return s since the hand could take hold, ``index`` substeps into a period."""
    if index < device.substeps:
        return ticks * device.period + index * device.step
    return (ticks + 1) * device.period


@inner
def middle_of(device: DeviceModel, ticks: int, index: int) -> float:
    """Return s since the hand could take hold, in the middle of substep ``index`` of a period."""
    return ticks * device.period + (index + 0.5) * device.step


@inner
def _take(device: DeviceModel, plan: Array, ticks: int, index: int, out: SimulatedState) -> None:
    """Fill the window in which the hand holds, and from where."""
    window, body = OPEN, out.body
    if ticks >= 0:
        window = grasp_window(device.hand, plan, time_of(device, ticks, index))
    if window == 0:
        put(out.anchor.values, device.held.values)
    elif window > 0 and window != out.window:
        put(out.anchor.values, Place(body.values).values)
    if window != OPEN and window != out.window:
        put(out.limb.values, body.values)
    out.window = window


@inner
def _has_limb(device: DeviceModel, out: SimulatedState) -> bool:
    """Return whether a mass behind a grip moves with the hand now."""
    return bool(out.window != OPEN and device.hand.limb_mass[0] > 0.0)


@inner
def _speed_up(device: DeviceModel, out: SimulatedState, share: float) -> None:
    """Change the twist of the mass behind a grip by the forces on it over a share of a substep."""
    for i in range(6):
        gain = share * device.step * device.task[i] / device.hand.limb_mass[i]
        out.limb.twist[i] += gain * (out.pull[i] - out.own[i])


@inner
def _push(device: DeviceModel, plan: Array, elapsed: float, out: SimulatedState) -> None:
    """Fill the wrench of the scene's hand, ``elapsed`` (s) since it could hold, if it holds."""
    hand, own = device.hand, out.own
    if out.window == OPEN:
        own[:] = 0.0
    elif _has_limb(device, out):
        hand_wrench(hand, plan, elapsed, out.limb, out.anchor, out.pull)
        pull(hand.grip, out.limb, out.body, own)
    else:
        hand_wrench(hand, plan, elapsed, out.body, out.anchor, own)


@inner
def _quantise(device: DeviceModel, out: SimulatedState) -> None:
    """Fill measured position and rotation."""
    body, fine, turn = out.body, device.position_step, device.angle_step
    for i in range(3):
        place = body.position[i]
        out.position[i] = fine * np.rint(place / fine) if fine > 0.0 else place
    if turn > 0.0:
        angles = local(3)
        log3(body.rotation, angles)
        for i in range(3):
            angles[i] = turn * np.rint(angles[i] / turn)
        exp3(angles, out.seen)
    else:
        put(out.seen, body.rotation)


@inner
def _measure(device: DeviceModel, before: SimulatedState, out: SimulatedState) -> None:
    """Fill the encoders' pose of the body in ``out``; its twist by differences, low-passed."""
    _quantise(device, out)
    quaternion_of(out.seen, out.quaternion)
    if device.position_step == 0.0 and device.angle_step == 0.0:
        put(out.twist, out.body.twist)
        return
    moved, turn = local(6), shaped(local(9), (3, 3))
    multiply_transposed(out.seen, before.seen, turn)
    log3(turn, moved[3:])
    subtract3(out.position, before.position, moved)
    for i in range(6):
        old = before.twist[i]
        out.twist[i] = old + device.filter_gain * (moved[i] / device.period - old)


@kernel("void(DeviceModel, float64[::1], SimulatedState, int64, SimulatedState)")
def begin(
    device: DeviceModel, plan: Array, state: SimulatedState, ticks: int, out: SimulatedState
) -> None:
    """Begin a period: ``out`` is where ``state`` is, and the hand takes hold if it is time to.

    The hand's wrench is to be put into ``out`` then, in the middle of each of the substeps that
    follow, and before :func:`finish`: zero unless it holds.

    Args:
        device: its parameters, and its actuators' last command.
        plan: (numbers,) of its hand.
        state: at the period's start.
        ticks: whole periods since the hand could take hold; -1 if no hand holds.
        out: to fill.
    """
    put(out.values, state.values)
    _take(device, plan, ticks, 0, out)


@kernel("void(DeviceModel, SimulatedState, Substep)")
def half_substep(device: DeviceModel, out: SimulatedState, before: Substep) -> None:
    """Move ``out`` to the middle of a substep, with the twist that is predicted there.

    ``before`` is filled with the twists at its start, and all forces but the hand's.
    """
    body, given = out.body, local(6)
    _give(device, out.applied, given)
    put(before.twist, body.twist)
    _drift(device, body)
    gain = device.held_gain if out.window != OPEN else device.gain
    for i in range(6):
        before.others[i] = device.push[i] + device.weight[i] + given[i]
        net = before.others[i] + out.own[i] - device.damping[i] * before.twist[i]
        body.twist[i] += 0.5 * gain[i] * net
    if _has_limb(device, out):
        put(before.limb_twist, out.limb.twist)
        _drift(device, out.limb)
        _speed_up(device, out, 0.5)


@kernel("boolean(DeviceModel, float64[::1], int64, int64, SimulatedState, Substep)")
def end_substep(
    device: DeviceModel, plan: Array, ticks: int, index: int, out: SimulatedState, before: Substep
) -> bool:
    """End a substep from its middle; then the hand lets go or takes hold.

    Args:
        device: its parameters.
        plan: (numbers,) of its hand.
        ticks: whole periods since the hand could take hold; -1 if no hand holds.
        index: of the substep.
        out: changed.
        before: of :func:`half_substep`; filled with the hand's wrench in the middle.

    Returns:
        Whether the hand held.
    """
    body, own = out.body, out.own
    held: bool = out.window != OPEN
    gain = device.held_gain if held else device.gain
    for i in range(6):
        lost = 0.5 * gain[i] * device.damping[i]
        pushed = gain[i] * (before.others[i] + own[i])
        body.twist[i] = ((1.0 - lost) * before.twist[i] + pushed) / (1.0 + lost)
    put(before.own, own)
    if _has_limb(device, out):
        put(out.limb.twist, before.limb_twist)
        _speed_up(device, out, 1.0)
        _drift(device, out.limb)
    _resist(device, gain, out.home, body)
    _drift(device, body)
    _take(device, plan, ticks, index + 1, out)
    if out.window == OPEN:
        own[:] = 0.0
    return held


@kernel("void(DeviceModel, SimulatedState, boolean, Substep, SimulatedState)")
def finish(
    device: DeviceModel, state: SimulatedState, held: bool, before: Substep, out: SimulatedState
) -> None:
    """Fill the measurements at the end of a period.

    Args:
        device: its parameters.
        state: at the period's start.
        held: whether the hand held in the last substep.
        before: as of :func:`end_substep`, of that.
        out: at its end; the inertial wrench of the hand's own mass is subtracted from the hand's.
    """
    own, arm = out.own, device.arm
    if arm[0] + arm[3] > 0.0 and held and out.window != OPEN:
        for i in range(6):
            # In the middle of the substep, and by how much the hand's wrench changes it since.
            changed = device.held_gain[i] * (own[i] - before.own[i])
            rate = out.body.twist[i] - before.twist[i] + changed
            own[i] -= arm[i] * (rate / device.step)
    put(out.hand_wrench, own)
    _measure(device, state, out)
    if device.senses_itself != MEASURED:
        estimate_hand(device, state, out)


@kernel("void(float64[::1], SimulatedState, int64, SimulatedState)")
def move_device(data: Array, state: SimulatedState, ticks: int, out: SimulatedState) -> None:
    """Fill ``out`` with the state one period after ``state``.

    Args:
        data: (numbers,) the device, a :class:`DeviceModel` and the plan of its hand.
        state: where to start.
        ticks: whole periods since the hand could take hold; -1 if no hand holds.
        out: to fill.
    """
    device, plan, held = DeviceModel(data), data[MODEL_SIZE:], False
    substeps, before = int(device.substeps), Substep(local(SUBSTEP_SIZE))
    begin(device, plan, state, ticks, out)
    _push(device, plan, time_of(device, ticks, 0), out)
    for index in range(substeps):
        half_substep(device, out, before)
        _push(device, plan, middle_of(device, ticks, index), out)
        held = end_substep(device, plan, ticks, index, out, before)
    _push(device, plan, time_of(device, ticks, substeps), out)
    finish(device, state, held, before, out)


@kernel("void(DeviceModel, float64[::1], boolean, SimulatedState)")
def stand(device: DeviceModel, plan: Array, holds: bool, out: SimulatedState) -> None:
    """Fill a device that stands still.

    Args:
        device: its parameters.
        plan: (numbers,) of its hand.
        holds: whether the hand can take hold now.
        out: zero except its place, its home and its anchor.
    """
    out.window = grasp_window(device.hand, plan, 0.0) if holds else OPEN
    put(out.limb.values, out.body.values)
    _push(device, plan, 0.0, out)
    _quantise(device, out)
    quaternion_of(out.seen, out.quaternion)
    if device.senses_itself == MEASURED:
        put(out.hand_wrench, out.own)
