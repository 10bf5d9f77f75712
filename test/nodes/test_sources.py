"""A second publisher of a topic is noticed by its numbers; losses and a late number are not one."""

from __future__ import annotations

import random
from types import SimpleNamespace

import pytest

from hapticmech_ros.nodes.sources import UNNUMBERED, WITHIN, Sources

MS = 1_000_000


class Middleware:
    """Knows publishers by name."""

    def __init__(self, *names: str) -> None:
        self.names = names

    def get_publishers_info_by_topic(self, topic: str) -> list:
        assert topic == "/topic"
        return [
            SimpleNamespace(
                node_namespace=name.rpartition("/")[0] or "/",
                node_name=name.rpartition("/")[2],
                endpoint_gid=bytes([0] * 15 + [index]),
            )
            for index, name in enumerate(self.names)
        ]


@pytest.fixture
def sources() -> Sources:
    return Sources(Middleware("/left/one", "/other"), "/topic")


def test_one_publisher_is_none_too_many(sources: Sources) -> None:
    for now in range(1000):
        sources.heard(now + 5000, now * MS)
        assert sources.fault(now * MS) == ""


@pytest.mark.parametrize("seed", range(20))
def test_losses_and_numbers_in_another_order_are_of_one_publisher(seed: int) -> None:
    chance = random.Random(seed)
    sources = Sources(Middleware("/one"), "/topic")
    sent = [number for number in range(1, 2000) if chance.random() > 0.2]
    # After the first, each is late by up to seven others.
    order = [0, *sorted(sent, key=lambda number: number + chance.uniform(0.0, 8.0))]
    for now, number in enumerate(order):
        sources.heard(number, now * MS)
        assert sources.fault(now * MS) == ""


@pytest.mark.parametrize(
    ("first", "second"), [(1, 1), (1, 5000), (5000, 1), (100, 101), (100, 103), (103, 100)]
)
@pytest.mark.parametrize("seed", range(5))
def test_a_second_that_speaks_at_the_same_rate_is_noticed_at_once(
    first: int, second: int, seed: int
) -> None:
    chance = random.Random(seed)
    sources = Sources(Middleware("/left/one", "/other"), "/topic")
    for now in range(100):
        sources.heard(first - 99 + now, now * MS)
    # Numbers that are apart by n may take for a while as if the first had lost n messages.
    within = 4 + abs(first - second) if abs(first - second) < 16 else 2
    for now in range(100, 100 + within):
        pair = [first + now - 99, second + now - 100]
        chance.shuffle(pair)
        for number in pair:
            sources.heard(number, now * MS)
    told = sources.fault((100 + within) * MS)
    assert told == "more than one publisher of /topic: /left/one and /other"


def test_one_of_this_process_and_one_from_outside_are_two(sources: Sources) -> None:
    for now in range(50):
        sources.heard(WITHIN, now * MS)
    assert sources.fault(50 * MS) == ""
    sources.heard(1, 50 * MS)
    assert sources.fault(50 * MS) != ""


def test_a_slow_second_is_noticed_by_its_first_message(sources: Sources) -> None:
    for now in range(200):
        sources.heard(5000 + now, now * MS)
    sources.heard(3, 200 * MS)
    assert sources.fault(200 * MS) != ""


def test_a_second_that_joined_before_is_noticed_by_the_first_of_the_other(
    sources: Sources,
) -> None:
    # A client at 20 Hz, then a controller at 1 kHz.
    for now in range(0, 500, 50):
        sources.heard(now // 50 + 1, now * MS)
    sources.heard(1, 501 * MS)
    assert sources.fault(501 * MS) != ""


def test_who_takes_over_from_one_that_fell_silent_is_alone(sources: Sources) -> None:
    for now in range(100):
        sources.heard(5000 + now, now * MS)
    for now in range(300, 400):
        sources.heard(now - 299, now * MS)
        assert sources.fault(now * MS) == ""


def test_the_one_that_stays_is_obeyed_again_after_a_second(sources: Sources) -> None:
    for now in range(100):
        sources.heard(5000 + now, now * MS)
        sources.heard(1 + now, now * MS)
    for now in range(100, 1101):
        assert sources.fault(now * MS) != ""
        sources.heard(5000 + now, now * MS)
    assert sources.fault(1101 * MS) == ""


def test_two_that_stand_still_for_a_while_are_still_two(sources: Sources) -> None:
    for now in range(100):
        sources.heard(5000 + now, now * MS)
        sources.heard(1 + now, now * MS)
    # Only one of them, on a machine that is busy for half a second.
    for now in range(100, 600):
        sources.heard(5000 + now, now * MS)
        assert sources.fault(now * MS) != ""
    sources.heard(101, 600 * MS)
    for now in range(600, 1600):
        sources.heard(5000 + now, now * MS)
        assert sources.fault(now * MS) != ""


def test_when_both_have_left_the_next_is_alone(sources: Sources) -> None:
    sources.heard(10, 0)
    sources.heard(2, 0)
    assert sources.fault(1000 * MS) != ""
    assert sources.fault(1001 * MS) == ""
    sources.heard(1, 2000 * MS)
    assert sources.fault(2000 * MS) == ""


def test_a_name_that_is_not_known_yet_is_asked_for_again() -> None:
    middleware = Middleware("/one", "_NODE_NAME_UNKNOWN_")
    sources = Sources(middleware, "/topic")
    sources.heard(10, 0)
    sources.heard(2, 0)
    assert "UNKNOWN" in sources.fault(0)
    middleware.names = ("/one", "/other")
    assert "UNKNOWN" in sources.fault(99 * MS)
    assert "/one and /other" in sources.fault(100 * MS)


def test_a_publisher_that_is_listed_late_is_named_then() -> None:
    middleware = Middleware("/dead", "/one")
    sources = Sources(middleware, "/topic")
    sources.heard(10, 0)
    sources.heard(2, 0)
    assert sources.fault(0).endswith("/dead and /one")
    middleware.names = ("/one", "/other")
    assert sources.fault(100 * MS).endswith("/one and /other")


def test_namesakes_are_told_apart() -> None:
    sources = Sources(Middleware("/device", "/device"), "/topic")
    sources.heard(10, 0)
    sources.heard(10, 0)
    first, second = sources.fault(0).rpartition(": ")[2].split(" and ")
    assert first != second
    assert first.startswith("/device (")


def test_without_numbers_the_middleware_is_asked() -> None:
    alone = Sources(Middleware("/one"), "/topic")
    alone.heard(UNNUMBERED, 0)
    assert alone.fault(0) == ""
    two = Sources(Middleware("/one", "/other"), "/topic")
    two.heard(UNNUMBERED, 0)
    assert "/one and /other" in two.fault(0)


def test_what_was_heard_can_be_forgotten(sources: Sources) -> None:
    sources.heard(10, 0)
    sources.heard(2, 0)
    assert sources.fault(0) != ""
    sources.forget()
    assert sources.fault(0) == ""
