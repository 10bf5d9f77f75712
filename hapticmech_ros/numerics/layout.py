# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a device measures, and what rendering needs of an operational point, as records.

What the numbers of stamps, twists and wrenches are, for the layouts of messages.
"""

from __future__ import annotations

from hapticmech_ros.compilation.records import Record, Vector, matrix

SECONDS = ("seconds", "nanoseconds")
TWIST = ("linear_velocity",) * 3 + ("angular_velocity",) * 3
WRENCH = ("force",) * 3 + ("torque",) * 3


class Pose(Record):
    """Where something is, world axes.

    Attributes:
        position: m.
        quaternion: x, y, z, w.
    """

    position = Vector(3, "position")
    quaternion = Vector(4, "quaternion")


class DeviceSample(Pose):
    """What a device measures, world axes: where the point held is, how it moves, and F_h.

    Attributes:
        position: m.
        quaternion: x, y, z, w.
        twist: m/s and rad/s.
        hand_wrench: F_h, by the hand, on the device, at the point held, N and N m.
    """

    twist = Vector(6, TWIST)
    hand_wrench = Vector(6, WRENCH)


class OperationalModelSample(Record):
    """What rendering needs of an operational point, at one time; axes of the world, at the point.

    Matrices go row by row; of s and of rows that the task space does not have, the rest is zero.

    Attributes:
        s: sqrt(μ), descending.
        inverse_inertia: X, 1/kg, 1/(kg m) and 1/(kg m²).
        constraint_projector: P_c.
        wrench_projector: Π.
        free_acceleration: a_0, m/s² and rad/s².
        position: m.
        quaternion: x, y, z, w.
        twist: m/s and rad/s.
        contact: F_c, by the environment, on the mechanism, N and N m.
    """

    s = Vector(6, "ratio")
    inverse_inertia = matrix(6, 6, "inverse_inertia")
    constraint_projector = matrix(6, 6, "ratio")
    wrench_projector = matrix(6, 6, "ratio")
    free_acceleration = Vector(6, "acceleration")
    position = Vector(3, "position")
    quaternion = Vector(4, "quaternion")
    twist = Vector(6, TWIST)
    contact = Vector(6, WRENCH)
