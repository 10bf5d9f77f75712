# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the rendering loop remembers between samples: arrays that its kernels work on.

The controller's side and the device's side have one array each, which belongs to whoever runs that
side: a node, or a session both. Energies are in J, wrenches in N and N m, world axes.
"""

from __future__ import annotations

from hapticmech_ros.numerics.layout import DEVICE_SAMPLE, TWIST, WRENCH, Field, Layout

# By so much more than evenly a damper brakes in what is left of its time, at a start.
BRAKE = 1.2
ONE, SIX, SQUARE = Field(1), Field(6), Field(36)
SAMPLE = Field(DEVICE_SAMPLE.size)
# What fixes the controllers: 1 in the scene's task space, else 0; diagonal of Λ_d; diagonals of C's
# stiffness and damping, and of these as C acts on the device; β, k, b, force and torque limit of
# the joint constraint; C1 to C6; duration of the clutch's ramp, s, and 1 if a wrench is carried on
# from another grasp, else 0; force and torque limit of the device; and of the clutch its time, s,
# its displacement, m, and its turn, a quaternion of length 1.
SETTINGS = Layout(
    {
        **dict.fromkeys(("task", "inertia", "stiffness", "damping"), SIX),
        **dict.fromkeys(("held_stiffness", "held_damping"), SIX),
        **dict.fromkeys(("feedforward", "joint_stiffness", "joint_damping"), ONE),
        **dict.fromkeys(("joint_force_limit", "joint_torque_limit"), ONE),
        **dict.fromkeys(("c1", "c2", "c3", "c4", "c5", "c6"), ONE),
        **dict.fromkeys(("ramp", "carries", "force_limit", "torque_limit", "engaged_at"), ONE),
        "displacement": Field(3),
        "turn": Field(4),
    }
)
# A controller's account of energy: constants first. Period, s; 1 for passivity control of the
# mechanism's port, and its slack; diagonal of Λ_d. Then E_m, S, E_inj and E_b; the wrench that acts
# on the mechanism; 1 if the point's twist of the sample before is known, and that; 1 if the error
# of the answer before is known, that error, and the springs that it stretched: k, P_c, diagonal of
# C. Then what the hand has put in, E_h; wrenches to the mechanism that were changed for it; 1 if a
# sample of the device is known, that sample; and where in the queue the next wrench is.
CONTROLLER_ACCOUNT = Layout(
    {
        "period": ONE,
        "passive": ONE,
        "slack": ONE,
        "inertia": SIX,
        "to_mechanism": ONE,
        "stored": ONE,
        "injected": ONE,
        "dissipated": ONE,
        "acting": Field(6, WRENCH),
        "twist_known": ONE,
        "twist": Field(6, TWIST),
        "error_known": ONE,
        "error": SIX,
        "spring": ONE,
        "projector": SQUARE,
        "channel": SIX,
        "from_hand": ONE,
        "changed": ONE,
        "sample_known": ONE,
        "sample": SAMPLE,
        "queue_at": ONE,
    }
)
# An answer to a sample of the device: 1 if it is one; wrenches, rows as in ControlOutput; 1 if it
# says how the first of them depends on the device: G, K and B; that sample; and E_m then.
ANSWER = Layout(
    {
        "given": ONE,
        "wrenches": SQUARE,
        "modelled": ONE,
        "force": SQUARE,
        "stiffness": SQUARE,
        "damping": SQUARE,
        "sample": SAMPLE,
        "to_mechanism": ONE,
    }
)
# Rows of an answer's wrenches: on the hand, by the device; on the mechanism, by the hand; the three
# parts of the first; and the pose error e.
ON_HAND, ON_MECHANISM, IMPEDANCE, JOINT_CONSTRAINT, FOUR_CHANNEL, POSE_ERROR = range(6)
# Rows of what acts in a tick: the first two, and the wrench commanded on the mechanism.
COMMANDED = 2
# What the device closes by itself, 1 or 0: the force channel, and the joint constraint; and whether
# answers are to say how.
LOCALITY = Layout(dict.fromkeys(("force_channel", "joint_constraint", "with_model"), ONE))
FORCE_LOCAL, JOINT_LOCAL, WITH_MODEL = LOCALITY.starts(*LOCALITY)
# The device's account: constants first. Diagonal of Λ_d; 1 where there are actuators; their limits,
# N and N m; period, s; share of their old wrench in the mean of a period; what is predicted, s, and
# what a held wrench moves in it per acceleration, s²; most damping, 1/s; 1 if velocities are
# filtered; 1 for passivity control, its allowance and slack. Then W, E_m, 1 if E_m is known; what
# damping took; commands changed; 1 if the device's pose is known, and that; what its driver adds;
# its mean twist since then; what of old commands acts on; and where in the queue the next answer
# is.
DEVICE_ACCOUNT = Layout(
    {
        "inertia": SIX,
        "acts": SIX,
        "force_limit": ONE,
        "torque_limit": ONE,
        "period": ONE,
        "kept": ONE,
        "ahead": ONE,
        "moved": ONE,
        "most_damping": ONE,
        "filtered": ONE,
        "passive": ONE,
        "allowance": ONE,
        "slack": ONE,
        "actuators": ONE,
        "mechanism": ONE,
        "received": ONE,
        "dissipated": ONE,
        "changed": ONE,
        "pose_known": ONE,
        "pose": Field(7),
        "added": Field(6, WRENCH),
        "rate": Field(6, TWIST),
        "applied": Field(6, WRENCH),
        "queue_at": ONE,
    }
)
