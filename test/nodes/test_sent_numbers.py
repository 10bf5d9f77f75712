# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""No number that is not finite leaves in a message, be it of people's topics or of control."""

import math
from functools import partial
from operator import attrgetter

import numpy as np
import pytest
from geometry_msgs.msg import Point, PoseStamped, TransformStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from visualization_msgs.msg import Marker, MarkerArray

from hapticmech_ros.errors import OutputError
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.messages import check_finite, set_stamp
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.wire.bounds import bounds_of, message_bounds
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.messages import DeviceStateMessage
from nodes.stand_ins import Publisher


def one(kind, field, bad):
    """Return a message with a number in one of its fields."""
    message = kind()
    part, _, number = field.rpartition(".")
    setattr(attrgetter(part)(message), number, bad)
    return message


KINDS = {
    "pose": partial(one, PoseStamped, "pose.orientation.z"),
    "transform": partial(one, TransformStamped, "transform.translation.y"),
    "wrench": partial(one, WrenchStamped, "wrench.torque.x"),
    "twist": partial(one, TwistStamped, "twist.linear.z"),
    "markers": lambda bad: MarkerArray(markers=[Marker(), Marker(points=[Point(), Point(y=bad)])]),
    "joints": lambda bad: JointState(position=[0.0], velocity=[1.0, bad]),
    "effort": lambda bad: JointState(effort=[bad]),
    "array": lambda bad: Float64MultiArray(data=[1.0, bad]),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_message_with_a_number_that_is_none_is_not_sent(kind):
    publisher = Publisher()
    outlet = Exchange().outlet(publisher, "/t", stays=False)
    for bad in (math.nan, math.inf, -math.inf):
        with pytest.raises(OutputError, match="must be finite"):
            outlet.publish(KINDS[kind](bad))
    assert publisher.sent == []
    good = KINDS[kind](1e300)
    outlet.publish(good)
    assert publisher.sent == [good]


def test_what_holds_no_numbers_is_sent():
    check_finite(String(data="nan"))
    check_finite(Float64MultiArray())


def test_arrays_leave_within_their_bounds_only():
    flat = FlatArray(
        DeviceStateMessage.layout, message_bounds(DeviceStateMessage, Limits(force=10.0))
    )
    values = np.zeros(sum(DeviceStateMessage.layout.values()))
    values[8] = 1.0
    assert (
        FlatArray(DeviceStateMessage.layout).decode(flat.encode(values)).tobytes()
        == values.tobytes()
    )
    for index, bad in ((15, 10.5), (15, math.nan), (0, -1.0), (8, 0.5), (1, 1e9)):
        wrong = values.copy()
        wrong[index] = bad
        with pytest.raises(OutputError, match="is not sent"):
            flat.encode(wrong)
    with pytest.raises(OutputError, match="finite"):
        FlatArray({"numbers": 2}).encode(np.array([0.0, math.inf]))


def test_every_field_of_the_layouts_has_its_bound():
    # A new field without one would be bounded by nothing but being finite.
    bounds = bounds_of("device state", DeviceStateMessage.layout, Limits())
    assert "finite number" not in bounds.quantities


@pytest.mark.parametrize("time_ns", [-1, 2**31 * 1_000_000_000])
def test_a_time_that_no_stamp_can_hold_is_said_to_be_one(time_ns):
    with pytest.raises(OutputError, match=r"builtin_interfaces/Time"):
        set_stamp(PoseStamped().header.stamp, time_ns)
