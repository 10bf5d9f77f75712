# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint states by the names of joints, and lists of numbers in parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from sensor_msgs.msg import JointState

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError


def joints_read(message: JointState, names: Sequence[str]) -> tuple[Array, Array] | None:
    """Return positions and rates (n,) of some joints; None if a message has none of them.

    Args:
        message: with joints in any order, others included.
        names: of the joints, in the order that is wanted.

    Raises:
        InvalidInputError: a joint, a position or a rate is missing.
    """
    places = {name: index for index, name in enumerate(message.name)}
    if not places.keys() & set(names):
        return None
    missing = [name for name in names if name not in places]
    if missing:
        raise InvalidInputError("name", list(places), f"must have {missing}")
    at = [places[name] for name in names]
    if len(message.position) <= max(at) or len(message.velocity) <= max(at):
        rule = "must have position and velocity of every joint"
        raise InvalidInputError("joint state", len(message.position), rule)
    position = np.array([message.position[index] for index in at])
    velocity = np.array([message.velocity[index] for index in at])
    return position, velocity


def numbers_in(name: str, text: str) -> Array:
    """Return the numbers (n,) of a parameter's text, with spaces or commas between them.

    Args:
        name: of the parameter.
        text: of it; empty: no numbers.

    Raises:
        InvalidInputError: one is none.
    """
    try:
        found = np.array([float(word) for word in text.replace(",", " ").split()])
    except ValueError:
        raise InvalidInputError(name, text, "must be numbers with spaces between") from None
    if not np.isfinite(found).all():
        raise InvalidInputError(name, text, "must be finite")
    return found
