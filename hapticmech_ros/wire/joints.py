# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Names of the coordinates that a JointState carries, for joints of any type.

A joint of one degree of freedom has its own name and its usual position. A joint of several has one
entry per degree of freedom, ``<joint>/0`` and so on: its position as seen from the neutral one
(rotation vector of a spherical joint), so that positions and velocities have the same length.
"""

from __future__ import annotations

from hapticmech_ros.mechanism import Mechanism


def coordinate_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Return (nv) names in the order of v."""
    names: list[str] = []
    for index, joint in enumerate(mechanism.tree.joint_names):
        part = mechanism.tree.velocity_slice(index)
        size = part.stop - part.start
        names += [joint] if size == 1 else [f"{joint}/{axis}" for axis in range(size)]
    return tuple(names)
