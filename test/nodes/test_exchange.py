# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages within a process: each once, in order, and outside only if somebody listens there."""

import time

from hapticmech_ros.nodes.exchange import MOST_UNDERWAY, Exchange, Outlet
from hapticmech_ros.nodes.sources import INSIDE, Origin


class FakePublisher:
    """Publishes into a list, to a given number of subscriptions."""

    def __init__(self, subscriptions: int) -> None:
        self.subscriptions = subscriptions
        self.sent: list[object] = []

    def publish(self, message: object) -> None:
        self.sent.append(message)

    def get_subscription_count(self) -> int:
        return self.subscriptions


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


def outlet(exchange: Exchange, subscriptions: int, stays: bool = False) -> tuple[Outlet, list]:
    publisher = FakePublisher(subscriptions)
    return exchange.outlet(publisher, "/topic", stays), publisher.sent


def test_within_the_process_nothing_goes_outside() -> None:
    exchange, received = Exchange(), []
    exchange.listen("/topic", Hears(received))
    # The one subscription is that of the listener itself.
    publish, sent = outlet(exchange, 1)
    publish.publish(b"a")
    assert received == []
    exchange.deliver()
    assert received == [b"a"]
    assert sent == []


def test_who_listens_outside_gets_it_too_and_the_copy_is_dropped_here() -> None:
    exchange, received = Exchange(), []
    is_own = exchange.listen("/topic", Hears(received))
    publish, sent = outlet(exchange, 2)
    publish.publish(b"a")
    exchange.deliver()
    assert received == sent == [b"a"]
    assert all(is_own(message) for message in sent)
    assert not is_own(b"of another process")


def test_nothing_is_converted_that_nobody_wants_unless_it_stays() -> None:
    exchange = Exchange()
    publish, sent = outlet(exchange, 0)
    assert not publish.wanted
    publish.publish(object())
    assert sent == []
    latched, kept = outlet(exchange, 0, stays=True)
    assert latched.wanted
    latched.publish(b"a")
    assert kept == [b"a"]


def test_what_stays_goes_outside_also_while_only_this_process_listens() -> None:
    exchange, received = Exchange(), []
    exchange.listen("/topic", Hears(received))
    publish, sent = outlet(exchange, 1, stays=True)
    publish.publish(b"a")
    exchange.deliver()
    assert received == sent == [b"a"]


def test_message_objects_take_the_way_through_the_middleware() -> None:
    exchange, received = Exchange(), []
    exchange.listen("/topic", Hears(received))
    publish, sent = outlet(exchange, 1)
    message = object()
    publish.publish(message)
    exchange.deliver()
    assert sent == [message]
    assert received == []


def test_who_comes_later_is_noticed() -> None:
    exchange, received = Exchange(), []
    exchange.listen("/topic", Hears(received))
    publish, sent = outlet(exchange, 1)
    publish.publish(b"a")
    publish.publisher.subscriptions = 2  # type: ignore[attr-defined]
    deadline = time.monotonic() + 10.0
    while not sent and time.monotonic() < deadline:
        publish.publish(b"b")
    assert sent == [b"b"]


def test_answers_come_after_the_message_they_answer() -> None:
    exchange, received = Exchange(), []
    publish, _ = outlet(exchange, 1)

    def answer(message: bytes, origin: Origin) -> None:
        if message == b"question":
            publish.publish(b"answer")
            exchange.deliver()
        received.append(message)

    exchange.listen("/topic", answer)
    publish.publish(b"question")
    publish.publish(b"next")
    exchange.deliver()
    assert received == [b"question", b"next", b"answer"]


def test_a_silenced_listener_hears_no_more() -> None:
    exchange, received = Exchange(), []
    exchange.listen("/topic", Hears(received))
    publish, _ = outlet(exchange, 1)
    publish.publish(b"a")
    exchange.silence("/topic", Hears(received))
    exchange.deliver()
    publish.publish(b"b")
    exchange.deliver()
    assert received == []


def test_delivery_goes_on_after_a_listener_that_raised() -> None:
    exchange, received = Exchange(), []

    def refuse(message: bytes, origin: Origin) -> None:
        raise ValueError(message)

    exchange.listen("/topic", refuse)
    exchange.listen("/topic", Hears(received))
    publish, _ = outlet(exchange, 2)
    publish.publish(b"a")
    try:
        exchange.deliver()
    except ValueError:
        exchange.deliver()
    assert received == [b"a"]


def test_copies_that_never_come_back_are_forgotten() -> None:
    exchange, received = Exchange(), []
    is_own = exchange.listen("/topic", Hears(received))
    publish, _ = outlet(exchange, 2)
    for number in range(MOST_UNDERWAY + 1):
        publish.publish(b"%d" % number)
    exchange.deliver()
    assert not is_own(b"0")
    assert is_own(b"%d" % MOST_UNDERWAY)
