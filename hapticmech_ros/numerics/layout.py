# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What device, analysis and controllers pass to each other, as records, in a session and a graph.

What the numbers of stamps, twists and wrenches are, for the layouts of messages.
"""

from __future__ import annotations

from hapticmech_ros.compilation.records import Number, Record, Vector, matrix

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


class ControllerEnergies(Record):
    """Energies of the controllers since rendering started.

    Attributes:
        to_mechanism: E_m, given to the mechanism at its operational point, J.
        stored: S, held in springs now, J.
        injected: E_inj, that came by directions and gains that changed, J.
        dissipated: E_b, lost in dampers, J.
    """

    to_mechanism, stored, injected, dissipated = Number(), Number(), Number(), Number()


class LocalModel(Record):
    """How a wrench on the hand depends on the device, which corrects it by that; SI.

    Attributes:
        force: G, wrench per F_h: 1, m and 1/m.
        stiffness: K, wrench per displacement ξ: N/m, N/rad, N and N m/rad.
        damping: B, wrench per twist v: N s/m, N s/rad, N s and N m s/rad.
    """

    force, stiffness = matrix(6, 6, "ratio"), matrix(6, 6, "stiffness")
    damping = matrix(6, 6, "damping")
