# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages within a process: each once, in order, and outside only if somebody listens there."""

import time
from types import SimpleNamespace

import pytest

from hapticmech_ros.nodes.exchange import MOST_UNDERWAY, Exchange
from hapticmech_ros.nodes.sources import INSIDE, Origin
from nodes.stand_ins import Publisher


class Hears:
    """Puts messages into a list; two of one list are equal."""

    def __init__(self, received: list) -> None:
        self.received = received

    def __call__(self, message: bytes, origin: Origin) -> None:
        assert origin == INSIDE
        self.received.append(message)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Hears) and other.received is self.received

    __hash__ = None


def talk(subscriptions: int, stays: bool = False) -> SimpleNamespace:
    """Return an exchange, who hears its topic, and its outlet, with what that sends outside."""
    exchange, received, publisher = Exchange(), [], Publisher(subscriptions)
    return SimpleNamespace(
        exchange=exchange,
        received=received,
        is_own=exchange.listen("/topic", Hears(received)),
        outlet=exchange.outlet(publisher, "/topic", stays),
        publisher=publisher,
        sent=publisher.sent,
    )


def test_within_the_process_nothing_goes_outside() -> None:
    # The one subscription is that of the listener itself.
    one = talk(1)
    one.outlet.publish(b"a")
    assert one.received == []
    one.exchange.deliver()
    assert one.received == [b"a"]
    assert one.sent == []


def test_who_listens_outside_gets_it_too_and_the_copy_is_dropped_here() -> None:
    one = talk(2)
    one.outlet.publish(b"a")
    one.exchange.deliver()
    assert one.received == one.sent == [b"a"]
    assert all(one.is_own(message) for message in one.sent)
    assert not one.is_own(b"of another process")


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


def test_what_stays_goes_outside_also_while_only_this_process_listens() -> None:
    one = talk(1, stays=True)
    one.outlet.publish(b"a")
    one.exchange.deliver()
    assert one.received == one.sent == [b"a"]


def test_message_objects_take_the_way_through_the_middleware() -> None:
    one, message = talk(1), object()
    one.outlet.publish(message)
    one.exchange.deliver()
    assert one.sent == [message]
    assert one.received == []


def test_who_comes_later_is_noticed() -> None:
    one = talk(1)
    one.outlet.publish(b"a")
    one.publisher.subscriptions = 2
    deadline = time.monotonic() + 10.0
    while not one.sent and time.monotonic() < deadline:
        one.outlet.publish(b"b")
    assert one.sent == [b"b"]


def test_answers_come_after_the_message_they_answer() -> None:
    exchange, received = Exchange(), []
    outlet = exchange.outlet(Publisher(1), "/topic", False)

    def answer(message: bytes, origin: Origin) -> None:
        if message == b"question":
            outlet.publish(b"answer")
            exchange.deliver()
        received.append(message)

    exchange.listen("/topic", answer)
    outlet.publish(b"question")
    outlet.publish(b"next")
    exchange.deliver()
    assert received == [b"question", b"next", b"answer"]


def test_a_silenced_listener_hears_no_more() -> None:
    one = talk(1)
    one.outlet.publish(b"a")
    one.exchange.silence("/topic", Hears(one.received))
    one.exchange.deliver()
    one.outlet.publish(b"b")
    one.exchange.deliver()
    assert one.received == []


def test_delivery_goes_on_after_a_listener_that_raised() -> None:
    def refuse(message: bytes, origin: Origin) -> None:
        raise ValueError(message)

    exchange, received = Exchange(), []
    exchange.listen("/topic", refuse)
    exchange.listen("/topic", Hears(received))
    exchange.outlet(Publisher(2), "/topic", False).publish(b"a")
    with pytest.raises(ValueError, match="a"):
        exchange.deliver()
    exchange.deliver()
    assert received == [b"a"]


def test_copies_that_never_come_back_are_forgotten() -> None:
    one = talk(2)
    for number in range(MOST_UNDERWAY + 1):
        one.outlet.publish(b"%d" % number)
    one.exchange.deliver()
    assert not one.is_own(b"0")
    assert one.is_own(b"%d" % MOST_UNDERWAY)
