# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What goes through the middleware, and how what came over the lane is delivered."""

import pytest

from hapticmech_ros.nodes.exchange import MOST_UNDERWAY, Exchange, _Copies
from hapticmech_ros.nodes.lane import Arrived
from hapticmech_ros.nodes.sources import Origin
from nodes.stand_ins import Publisher


def test_nothing_is_converted_that_nobody_wants_unless_it_stays() -> None:
    publisher, latched = Publisher(0), Publisher(0)
    outlet = Exchange().outlet(publisher, "/topic", False)
    assert not outlet.wanted
    outlet.publish(object())
    assert publisher.sent == []
    outlet = Exchange().outlet(latched, "/topic", True)
    assert outlet.wanted
    outlet.publish(b"a")
    assert latched.sent == [b"a"]


def test_without_a_lane_all_goes_through_the_middleware() -> None:
    publisher, message = Publisher(1), object()
    outlet = Exchange().outlet(publisher, "/topic", False, "Kind")
    outlet.publish(message)
    outlet.publish(b"a")
    assert publisher.sent == [message, b"a"]
    assert (outlet.ways(), outlet.published) == ("middleware", 2)


def test_delivery_goes_on_after_a_listener_that_raised() -> None:
    def refuse(message: bytes, origin: Origin) -> None:
        raise ValueError(message)

    exchange, received = Exchange(), []
    for listener in (refuse, lambda message, origin: received.append(message)):
        exchange._waiting.append(Arrived(listener, b"a", Origin(1 << 32, 1)))
    with pytest.raises(ValueError, match="a"):
        exchange.deliver()
    exchange.deliver()
    assert received == [b"a"]


def test_copies_that_never_come_back_are_forgotten() -> None:
    copies = _Copies()
    for number in range(MOST_UNDERWAY + 1):
        copies.note(b"%d" % number)
    assert not copies.had(b"0")
    assert copies.had(b"%d" % MOST_UNDERWAY)
