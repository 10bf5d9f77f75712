# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a device's parameters may ask for: nothing less safe than its scene allows. No ROS."""

from __future__ import annotations

import math
from collections.abc import Iterator

from hapticmech_ros.device.safety import SafetyLimits, safety_limits
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.parameters import DriverParameters, ParameterError
from hapticmech_ros.nodes.timeouts import COMMAND, timeout_of
from hapticmech_ros.scene.device import Device


def command_timeout_of(parameters: DriverParameters, device: Device, period_s: float) -> float:
    """Return how long (s) a device acts on a command.

    Args:
        parameters: of the device's node.
        device: of the scene.
        period_s: control period, s.

    Raises:
        InvalidInputError: longer than the scene allows, or less than three periods.
    """
    return timeout_of(parameters, "command_timeout", COMMAND, period_s, device)


def limits_of(parameters: DriverParameters, device: Device, period_s: float) -> SafetyLimits:
    """Return the limits that parameters choose within those of the scene's device.

    Args:
        parameters: of the device's node.
        device: of the scene.
        period_s: control period, s.

    Raises:
        ParameterError: names every parameter that breaks a rule, with value and rule.
    """
    problems = list(_problems(parameters, device, period_s))
    if problems:
        raise ParameterError("; ".join(problems))
    scene = safety_limits(device)
    return SafetyLimits(
        force=parameters.force_limit or scene.force,
        torque=parameters.torque_limit or scene.torque,
        force_slew=parameters.force_slew or scene.force_slew,
        torque_slew=parameters.torque_slew or scene.torque_slew,
        ramp=parameters.start_ramp or scene.ramp,
        radius=parameters.workspace_radius or scene.radius,
    )


def _problems(parameters: DriverParameters, device: Device, period_s: float) -> Iterator[str]:
    safety = device.safety
    for name, bound, key in (
        ("force_limit", device.force_limit, "device.force_limit"),
        ("torque_limit", device.torque_limit, "device.torque_limit"),
        ("force_slew", safety.force_slew, "device.safety.force_slew"),
        ("torque_slew", safety.torque_slew, "device.safety.torque_slew"),
        ("workspace_radius", safety.workspace_radius or math.inf, "device.safety.workspace_radius"),
    ):
        value = getattr(parameters, name)
        if value > bound:
            yield f"{name}: must be at most the scene's {key}, {bound:g} (got {value:g})"
    # 0 is the scene's; a shorter ramp opens sooner.
    if 0.0 < parameters.start_ramp < safety.start_ramp:
        yield (
            "start_ramp: must be at least the scene's device.safety.start_ramp, "
            f"{safety.start_ramp:g} (got {parameters.start_ramp:g})"
        )
    try:
        command_timeout_of(parameters, device, period_s)
    except InvalidInputError as error:
        yield str(error)
