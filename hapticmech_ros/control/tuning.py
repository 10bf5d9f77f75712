# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gains by one name each, as parameters of a node give them."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import ValidationError

from hapticmech_ros.errors import InvalidInputError, check_one_of
from hapticmech_ros.scene.controller import Controller

# Selects the scene's own gain.
SCENES = -1.0
# Name -> part of the controller, and field in it.
TUNED: Mapping[str, tuple[str, str]] = {
    "constraint_stiffness": ("joint_constraint", "stiffness"),
    "constraint_damping": ("joint_constraint", "damping"),
    "constraint_feedforward": ("joint_constraint", "feedforward"),
    "position_stiffness": ("position_channel", "stiffness"),
    "position_damping": ("position_channel", "damping"),
    "position_angular_stiffness": ("position_channel", "angular_stiffness"),
    "position_angular_damping": ("position_channel", "angular_damping"),
    "c1": ("position_channel", "to_mechanism"),
    "c2": ("force_channel", "contact"),
    "c3": ("force_channel", "hand"),
    "c4": ("position_channel", "to_device"),
    "c5": ("force_channel", "mechanism_feedback"),
    "c6": ("force_channel", "device_feedback"),
}


def tuned(gains: Controller, values: Mapping[str, float]) -> Controller:
    """Return gains with some of them replaced.

    Args:
        gains: of the scene.
        values: by name; -1 leaves the scene's.

    Raises:
        InvalidInputError: an unknown name, or a value that the gain cannot have.
    """
    document = gains.model_dump()
    for name, value in values.items():
        check_one_of("gain", name, TUNED)
        if value != SCENES:
            part, field = TUNED[name]
            document[part][field] = value
    try:
        return Controller.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        path = tuple(first["loc"])
        name = next((name for name, at in TUNED.items() if at == path), ".".join(map(str, path)))
        raise InvalidInputError(name, first["input"], str(first["msg"])) from None
