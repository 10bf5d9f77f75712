# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the rendering loop remembers between samples: records that its kernels work on.

The controller's side and the device's side have one account each, which belongs to whoever runs
that side: a node, or a session both. Vectors are in world axes, wrenches in N and N m at the point
held; what is said to be known, or to hold, is 1, or else 0.
"""

from __future__ import annotations

from hapticmech_ros.compilation.records import Nested, Number, Record, Vector, Whole, matrix
from hapticmech_ros.numerics.layout import (
    TWIST,
    WRENCH,
    ControllerEnergies,
    DeviceSample,
    LocalModel,
    Pose,
)

# By so much more than evenly a damper brakes in what is left of its time, at a start.
BRAKE = 1.2


class ControllerSettings(Record):
    """What fixes the controllers: gains of the scene, limits of the device, and the clutch.

    Attributes:
        task: 1 for rows of a six-vector that the task space has, else 0.
        inertia: diagonal of Λ_d, kg and kg m².
        stiffness, damping: diagonals of C, N/m, N m/rad and N s/m, N m s/rad.
        held_stiffness, held_damping: of C as it acts on the device.
        feedforward: β.
        joint_stiffness, joint_damping: k, N/m, and b, N s/m, of the joint constraint.
        joint_force_limit, joint_torque_limit: of the joint constraint, N and N m.
        c1, c2, c3, c4, c5, c6: gains of the channels, C1 to C6.
        ramp: duration of the clutch's ramp, s.
        carries: whether a wrench is carried on from another grasp.
        force_limit, torque_limit: of the device, N and N m.
        engaged_at: when the clutch was engaged, s.
        displacement: of the clutch, from device to operational point, m.
        turn: of the clutch, a quaternion of length 1 from device to operational point.
    """

    task, inertia, stiffness, damping = Vector(6), Vector(6), Vector(6), Vector(6)
    held_stiffness, held_damping = Vector(6), Vector(6)
    feedforward, joint_stiffness, joint_damping = Number(), Number(), Number()
    joint_force_limit, joint_torque_limit = Number(), Number()
    c1, c2, c3, c4, c5, c6 = Number(), Number(), Number(), Number(), Number(), Number()
    ramp, carries, force_limit, torque_limit = Number(), Number(), Number(), Number()
    engaged_at, displacement, turn = Number(), Vector(3), Vector(4)


class ControllerAccount(Record):
    """The controller's account of energy: constants first.

    Attributes:
        period: s.
        passive: whether the mechanism's port is under passivity control.
        slack: of that, J.
        inertia: diagonal of Λ_d, kg and kg m².
        energies: E_m, S, E_inj and E_b.
        acting: wrench that acts on the mechanism, N and N m.
        twist_known, twist: of the operational point in the sample before, m/s and rad/s.
        error_known, error: e of the answer before, m and rad.
        spring: k that this error stretched, N/m.
        projector: P_c along which it does.
        channel: diagonal of C's stiffness that it stretched, N/m and N m/rad.
        from_hand: E_h, that the hand has put in, J.
        changed: wrenches to the mechanism that passivity control has changed.
        sample_known, sample: of the device, the last one that was heard.
        queue_at: where in the queue the next wrench is.
    """

    period, passive, slack, inertia = Number(), Number(), Number(), Vector(6)
    energies, acting = Nested(ControllerEnergies), Vector(6, WRENCH)
    twist_known, twist = Number(), Vector(6, TWIST)
    error_known, error = Number(), Vector(6)
    spring, projector, channel = Number(), matrix(6, 6), Vector(6)
    from_hand, changed = Number(), Number()
    sample_known, sample, queue_at = Number(), Nested(DeviceSample), Number()


class ControlWrenches(Record):
    """Wrenches of one control period; as rows, those of :class:`~.measurements.ControlOutput`.

    Attributes:
        on_hand: by the device, N and N m.
        on_mechanism: by the hand, at the operational point, N and N m.
        impedance, joint_constraint, four_channel: the three parts of ``on_hand``, N and N m.
        error: pose error e, m and rad.
    """

    on_hand, on_mechanism = Vector(6), Vector(6)
    impedance, joint_constraint, four_channel, error = Vector(6), Vector(6), Vector(6), Vector(6)


class Answer(Record):
    """An answer to a sample of the device.

    Attributes:
        given: whether it is one.
        wrenches: of the controllers.
        modelled: whether it says how ``wrenches.on_hand`` depends on the device.
        model: that.
        sample: of the device, that is answered.
        to_mechanism: E_m then, J.
    """

    given, wrenches = Number(), Nested(ControlWrenches)
    modelled, model = Number(), Nested(LocalModel)
    sample, to_mechanism = Nested(DeviceSample), Number()


class ActingWrenches(Record):
    """What acts on device and mechanism in a period.

    Attributes:
        on_hand: by the device, N and N m.
        on_mechanism: by the hand, at the operational point, N and N m.
        commanded: on the mechanism, to act once its delay is over, N and N m.
    """

    on_hand, on_mechanism, commanded = Vector(6), Vector(6), Vector(6)


class Locality(Record):
    """What the device closes by itself.

    Attributes:
        force_channel: whether it closes the force channel.
        joint_constraint: whether it closes the joint constraint.
        with_model: whether answers are to say how.
    """

    force_channel, joint_constraint, with_model = Number(), Number(), Number()


class DeviceAccount(Record):
    """The device's account of energy: constants first.

    Attributes:
        inertia: diagonal of Λ_d, kg and kg m².
        acts: 1 where there are actuators.
        force_limit, torque_limit: of the actuators, N and N m.
        period: s.
        kept: share of the actuators' old wrench in the mean of a period.
        ahead: for how long what a command gives is predicted, s.
        moved: what a held wrench moves in that time, per acceleration, s².
        most_damping: largest λ of the damper -λ Λ_d v, 1/s.
        filtered: whether velocities are filtered.
        passive: whether commands are under passivity control.
        allowance, slack: of that, J.
        actuators: W, that the actuators have taken from the device, J.
        mechanism: E_m as it was received last, J.
        received: whether it was.
        dissipated: what damping took, J.
        changed: commands that were changed.
        pose_known, pose: of the device in the last sample.
        added: what its driver adds to a command, for weight and friction, N and N m.
        rate: mean twist since that sample, carried on by half a period, m/s and rad/s.
        applied: what of old commands acts on, N and N m.
        queue_at: where in the queue the next answer is.
    """

    inertia, acts = Vector(6), Vector(6)
    force_limit, torque_limit = Number(), Number()
    period, kept, ahead, moved = Number(), Number(), Number(), Number()
    most_damping, filtered = Number(), Number()
    passive, allowance, slack = Number(), Number(), Number()
    actuators, mechanism, received = Number(), Number(), Number()
    dissipated, changed, pose_known, pose = Number(), Number(), Number(), Nested(Pose)
    added, rate, applied = Vector(6, WRENCH), Vector(6, TWIST), Vector(6, WRENCH)
    queue_at = Number()


class HandSample(Record):
    """A hand's wrench in one sample.

    Attributes:
        spacing: since the sample before, s.
        wrench: F_h, by the hand, on the device, N and N m.
    """

    spacing, wrench = Number(), Vector(6, WRENCH)


class HandMemory(Record):
    """A hand's last wrenches.

    Attributes:
        known: how many samples are.
        newest, second, third: these.
    """

    known, newest = Number(), Nested(HandSample)
    second, third = Nested(HandSample), Nested(HandSample)


class MeanChange(Record):
    """By how much the mean of a wrench over a period differs from its newest sample.

    Attributes:
        line: F', by the line through two samples, N and N m.
        bend: F'', what the parabola through three adds to it, N and N m.
    """

    line, bend = Vector(6, WRENCH), Vector(6, WRENCH)


class HandsCorrection(Record):
    """What corrects a command for other hands; see :mod:`~hapticmech_ros.control.other_hands`.

    Attributes:
        change: sum of H_j (F_j(t) - F_j(t' - T)), N and N m.
        line, bend: sums of H_j F'_j and of H_j F''_j, N and N m.
        hands: K, how many there are.
    """

    change, line, bend, hands = Vector(6), Vector(6), Vector(6), Number()


class ChannelState(Record):
    """Whole numbers of one direction of a connection; slots follow.

    Attributes:
        stream: of its random numbers.
        sent, lost: messages so far.
        newest: number of the newest message that was received, -1 before any was.
        tag: that came with it.
    """

    dtype = int
    stream, sent, lost, newest, tag = Whole(), Whole(), Whole(), Whole(), Whole()


class ChannelSlot(Record):
    """A message on its way.

    Attributes:
        arrives: when, ns.
        number: of the message, -1 if the slot is free.
        tag: that goes with it.
    """

    dtype = int
    arrives, number, tag = Whole(), Whole(), Whole()
