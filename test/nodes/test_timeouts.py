# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Timeouts: as many periods at each rate, taken as they are given, refused where none can hold."""

import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.parameters import (
    ControllerParameters,
    DeviceParameters,
    MechanismParameters,
)
from hapticmech_ros.nodes.robot_parameters import FollowerParameters
from hapticmech_ros.nodes.timeouts import (
    COMMAND,
    CONTROLLER_INPUT,
    MECHANISM_COMMAND,
    ROBOT_JOINTS,
    ROBOT_TARGET,
    ROBOT_WRENCH,
    ZERO_FORCE,
    timeout_of,
)
from hapticmech_ros.scene.device import Device, Safety

DEVICE = Device(safety=Safety(command_timeout=0.05))
# Model, timeout, rule, whether the scene's bound holds for it.
TIMEOUTS = [
    (DeviceParameters, "command_timeout", COMMAND, True),
    (ControllerParameters, "input_timeout", CONTROLLER_INPUT, True),
    (MechanismParameters, "command_timeout", MECHANISM_COMMAND, False),
    (FollowerParameters, "joint_timeout", ROBOT_JOINTS, False),
    (FollowerParameters, "target_timeout", ROBOT_TARGET, False),
    (FollowerParameters, "wrench_timeout", ROBOT_WRENCH, False),
]
EACH = pytest.mark.parametrize(("model", "name", "rule", "bounded"), TIMEOUTS)


@pytest.mark.parametrize(
    ("rate", "command", "inputs", "mechanism", "zero"),
    [
        (4000.0, 0.012, 0.011, 0.05, 0.02),
        (1000.0, 0.012, 0.011, 0.05, 0.02),
        (500.0, 0.024, 0.022, 0.1, 0.04),
        (250.0, 0.048, 0.044, 0.2, 0.08),
    ],
)
def test_they_follow_the_rate(rate, command, inputs, mechanism, zero):
    rules = (COMMAND, CONTROLLER_INPUT, MECHANISM_COMMAND, ZERO_FORCE)
    found = [rule.at(1.0 / rate) for rule in rules]
    assert found == pytest.approx([command, inputs, mechanism, zero], rel=1e-12)


@EACH
@pytest.mark.parametrize("rate", [4000.0, 1000.0, 500.0, 250.0, 125.0])
def test_at_no_rate_is_a_loop_closer_to_breaking_off_than_eleven_periods(
    model, name, rule, bounded, rate
):
    found = timeout_of(model(), name, rule, 1.0 / rate, Device() if bounded else None)
    assert found == rule.at(1.0 / rate)
    assert found * rate >= 11.0 - 1e-9


@EACH
def test_what_is_given_is_taken_as_it_is(model, name, rule, bounded):
    for given in (0.012, 0.0125, 0.05):
        parameters = model(**{name: given})
        # 250 Hz: from three periods on.
        assert timeout_of(parameters, name, rule, 0.004, DEVICE if bounded else None) == given


@EACH
def test_what_could_never_hold_is_refused_with_value_and_rule(model, name, rule, bounded):
    parameters = model(**{name: 0.011})
    with pytest.raises(InvalidInputError) as refused:
        timeout_of(parameters, name, rule, 0.004, DEVICE if bounded else None)
    told = f"{name}: must be 0 or at least 3 periods of 250 Hz, 0.012 s (got 0.011)"
    assert str(refused.value) == told
    # In lockstep no timeout counts, however slow what was recorded is replayed.
    timeout_of(model(lockstep=True, **{name: 0.011}), name, rule, 0.004)


@pytest.mark.parametrize(("model", "name", "rule", "bounded"), TIMEOUTS[:2])
def test_none_is_longer_than_the_scene_lets_a_command_stand(model, name, rule, bounded):
    with pytest.raises(InvalidInputError) as refused:
        timeout_of(model(**{name: 0.051}), name, rule, 0.001, DEVICE)
    assert str(refused.value) == (
        f"{name}: must be at most the scene's device.safety.command_timeout, 0.05 (got 0.051)"
    )
    # Nor by the rate: twelve periods are 0.06 s.
    assert timeout_of(model(), name, rule, 0.005, DEVICE) == 0.05
    # By default what is documented for a machine that stalls, and a driver of 10 Hz.
    assert timeout_of(model(**{name: 0.1}), name, rule, 0.001, Device()) == 0.1
    slow = Device(safety=Safety(command_timeout=1.0))
    assert timeout_of(model(**{name: 1.0}), name, rule, 0.001, slow) == 1.0


def test_a_scene_whose_bound_no_graph_can_keep_is_refused():
    with pytest.raises(InvalidInputError) as refused:
        timeout_of(DeviceParameters(), "command_timeout", COMMAND, 0.02, DEVICE)
    assert str(refused.value) == (
        "device.safety.command_timeout: must be at least 3 periods of 50 Hz, 0.06 s (got 0.05)"
    )
    least = Device(safety=Safety(command_timeout=0.012))
    assert timeout_of(DeviceParameters(), "command_timeout", COMMAND, 0.001, least) == 0.012
    timeout_of(DeviceParameters(lockstep=True), "command_timeout", COMMAND, 0.02, DEVICE)
