# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a controller's timeout may be: no longer than its scene lets a command stand. No ROS."""

from __future__ import annotations

from hapticmech_ros.nodes.parameters import ControllerParameters, ParameterError
from hapticmech_ros.scene.device import Device


def input_timeout_of(parameters: ControllerParameters, device: Device) -> float:
    """Return how old (s) a controller's inputs may be.

    Whoever commands from an old input gives commands that are as old. What a declared network's
    jitter may add to silence comes on top, as with the device's ``command_timeout``.

    Raises:
        ParameterError: longer than the scene's ``device.safety.command_timeout``.
    """
    given, bound = parameters.input_timeout, device.safety.command_timeout
    if given > bound:
        raise ParameterError(
            "input_timeout: must be at most the scene's device.safety.command_timeout, "
            f"{bound:g} (got {given:g})"
        )
    return given
