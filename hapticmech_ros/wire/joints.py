"""Names of the coordinates that a JointState carries, for joints of any type.

A joint of one degree of freedom has its own name and its usual position. A joint of several has one
entry per degree of freedom, ``<joint>/0`` and so on: its position as seen from the neutral one
(rotation vector of a spherical joint), so that positions and velocities have the same length.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.model import Array


def coordinate_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Return (nv) names in the order of v."""
    names: list[str] = []
    for index, joint in enumerate(mechanism.tree.joint_names):
        part = mechanism.tree.velocity_slice(index)
        size = part.stop - part.start
        names += [joint] if size == 1 else [f"{joint}/{axis}" for axis in range(size)]
    return tuple(names)


def state_of(
    mechanism: Mechanism,
    names: tuple[str, ...],
    received: list[str],
    position: object,
    velocity: object,
) -> tuple[Array, Array]:
    """Return (q, v) from a JointState's lists.

    Args:
        mechanism: whose coordinates they are.
        names: what :func:`coordinate_names` gives.
        received: names in the message; must be the same ones in the same order.
        position: as many numbers.
        velocity: as many numbers.

    Raises:
        InvalidInputError: other names, wrong sizes, or not finite.
    """
    if tuple(received) != names:
        raise InvalidInputError("joint names", list(received), f"must be {list(names)}")
    values = []
    for what, given in (("joint positions", position), ("joint velocities", velocity)):
        array = np.array(given, dtype=float)
        if array.shape != (len(names),) or not np.isfinite(array).all():
            raise InvalidInputError(what, array.tolist(), f"must be {len(names)} finite numbers")
        values.append(array)
    q = pin.integrate(mechanism.model, pin.neutral(mechanism.model), values[0])
    return np.asarray(q), values[1]
