# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a simulated device is, and its state: arrays that its kernels work on."""

from __future__ import annotations

from hapticmech_ros.layout import DEVICE_SAMPLE, TWIST, WRENCH, Field, Layout

ONE, THREE, SIX, PLACE = Field(1), Field(3), Field(6), Field(12)
# Step and period, s; number of steps in a period; gain of the velocity filter; limits of the
# actuators, N and N m; steps of the encoders, m and rad, 0 if ideal; of the actuators' error what
# is left after a step, and its mean over one, per unit, 0 if there is none; Coulomb friction, N and
# N m; end stops: limit, stiffness and damping; damping; change of the twist per wrench and step, 0
# where the scene has no direction, and the same with the hand's own mass; that mass and inertia.
# Then what acts: command, weight, the wrench by others than the hand; and where the hand could take
# hold: position and rotation.
# Of the driver: 1 where the scene has a direction; 1 where there are actuators; share of the
# friction that is compensated, from which speeds on, m/s and rad/s; 1 if weight is; 1 if what it
# reports of the hand is estimated, and 2 if it is nothing; share of the observer's error that a
# period takes away; share of the actuators' error in a period's mean; and Λ_d.
DEVICE_MODEL = Layout(
    {
        **dict.fromkeys(("step", "period", "substeps", "filter_gain"), ONE),
        **dict.fromkeys(("force_limit", "torque_limit", "position_step", "angle_step"), ONE),
        **dict.fromkeys(("lag", "lag_mean", "friction", "angular_friction"), ONE),
        **dict.fromkeys(("stop", "angular_stop"), THREE),
        **dict.fromkeys(("damping", "gain", "held_gain", "arm"), SIX),
        **dict.fromkeys(("command", "weight", "push"), SIX),
        "held": PLACE,
        **dict.fromkeys(("task", "acts"), SIX),
        **dict.fromkeys(("compensated", "dead_zone", "angular_dead_zone", "lifts"), ONE),
        **dict.fromkeys(("senses_itself", "observer_share", "actuator_share"), ONE),
        "inertia": SIX,
    }
)
# What is published: what is measured, the wrench of the hand as it is reported, and the wrench
# applied; and what is not: position, rotation and twist of the body; measured rotation; where the
# device started, and where the hand took hold; the window in which it holds; position, rotation and
# twist of its mass behind a grip, and what pulls that; and its wrench. Rotations go row by row.
DEVICE_STATE = Layout(
    {
        **DEVICE_SAMPLE.fields,
        "applied": Field(6, WRENCH),
        "body": PLACE,
        "body_twist": Field(6, TWIST),
        "seen": Field(9),
        "home": PLACE,
        "anchor": PLACE,
        "window": ONE,
        "limb": PLACE,
        "limb_twist": Field(6, TWIST),
        "pull": Field(6, WRENCH),
        "own": Field(6, WRENCH),
    }
)
