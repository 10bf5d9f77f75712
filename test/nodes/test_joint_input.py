# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint states by name, whatever their order and company; numbers in a parameter's text."""

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.inputs import joints_read, numbers_in

NAMES = ("a", "b")


def test_joints_are_found_in_any_order_among_others():
    message = JointState(name=["b", "x", "a"], position=[2.0, 9.0, 1.0], velocity=[4.0, 9.0, 3.0])
    position, velocity = joints_read(message, NAMES)
    np.testing.assert_array_equal(position, [1.0, 2.0])
    np.testing.assert_array_equal(velocity, [3.0, 4.0])


def test_states_of_other_joints_are_none():
    assert joints_read(JointState(name=["x"], position=[1.0], velocity=[0.0]), NAMES) is None


def test_half_a_state_is_refused():
    with pytest.raises(InvalidInputError, match="must have"):
        joints_read(JointState(name=["a"], position=[1.0], velocity=[0.0]), NAMES)
    with pytest.raises(InvalidInputError, match="velocity of every joint"):
        joints_read(JointState(name=["a", "b"], position=[1.0, 2.0]), NAMES)


def test_numbers_stand_between_spaces_or_commas():
    np.testing.assert_array_equal(numbers_in("limits", "1 2.5, -3e2"), [1.0, 2.5, -300.0])
    assert numbers_in("limits", "").size == 0
    for wrong in ("1 two", "1 nan"):
        with pytest.raises(InvalidInputError, match="limits"):
            numbers_in("limits", wrong)
