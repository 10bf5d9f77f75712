# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A second publisher of a topic is noticed by its numbers; losses and a late number are not one."""

from __future__ import annotations

import random

import pytest

from hapticmech_ros.nodes.sources import (
    MIDDLEWARE,
    STOPPED,
    UNNUMBERED,
    CommandGuard,
    Origin,
    Sources,
)
from nodes.stand_ins import MS, Listed
from sampling import sampled

LANE, OTHER_LANE = 1 << 32, 2 << 32


def received(sources: Sources, number: int, now_ns: int) -> None:
    """Bring a message through the middleware."""
    sources.received(Origin(MIDDLEWARE, number), now_ns)


def goes_on(
    sources: Sources,
    times: range,
    number: int,
    via: int = MIDDLEWARE,
    step: int = 1,
    faulty: bool | None = None,
) -> None:
    """Bring a message each millisecond, numbered from a number on; check what is said of each."""
    for count, now in enumerate(times):
        sources.received(Origin(via, number + step * count), now * MS)
        assert faulty in (None, bool(sources.fault(now * MS)))


def of_two(*names: str, numbers: tuple[int, int] = (10, 2)) -> tuple[Listed, Sources]:
    """Return a middleware that knows these, and sources of whom two have spoken at time 0."""
    middleware = Listed(*names)
    found = Sources(middleware, "/topic")
    for number in numbers:
        received(found, number, 0)
    return middleware, found


@pytest.fixture
def sources() -> Sources:
    return Sources(Listed("/left/one", "/other"), "/topic")


@pytest.mark.parametrize("seed", sampled(range(20)))
def test_losses_and_numbers_in_another_order_are_of_one_publisher(seed: int) -> None:
    chance = random.Random(seed)
    sources = Sources(Listed("/one"), "/topic")
    sent = [number for number in range(1, 2000) if chance.random() > 0.2]
    # After the first, each is late by up to seven others.
    order = [0, *sorted(sent, key=lambda number: number + chance.uniform(0.0, 8.0))]
    for now, number in enumerate(order):
        received(sources, number, now * MS)
        assert sources.fault(now * MS) == ""


@pytest.mark.parametrize(
    ("first", "second"), [(1, 1), (1, 5000), (5000, 1), (100, 101), (100, 103), (103, 100)]
)
@pytest.mark.parametrize("seed", sampled(range(5)))
def test_a_second_that_speaks_at_the_same_rate_is_noticed_at_once(
    first: int, second: int, seed: int
) -> None:
    chance = random.Random(seed)
    sources = Sources(Listed("/left/one", "/other"), "/topic")
    for now in range(100):
        received(sources, first - 99 + now, now * MS)
    # Numbers that are apart by n may take for a while as if the first had lost n messages.
    within = 4 + abs(first - second) if abs(first - second) < 16 else 2
    for now in range(100, 100 + within):
        pair = [first + now - 99, second + now - 100]
        chance.shuffle(pair)
        for number in pair:
            received(sources, number, now * MS)
    told = sources.fault((100 + within) * MS)
    assert told == "more than one publisher of /topic: /left/one and /other"


@pytest.mark.parametrize("other", [Origin(MIDDLEWARE, 1), Origin(OTHER_LANE, 0)], ids=str)
def test_one_on_the_lane_and_another_are_two(sources: Sources, other: Origin) -> None:
    for now in range(50):
        sources.received(Origin(LANE, 20, sent=now + 1), now * MS)
    assert sources.fault(50 * MS) == ""
    sources.received(other, 50 * MS)
    assert sources.fault(50 * MS) != ""


def test_a_slow_second_is_noticed_by_its_first_message(sources: Sources) -> None:
    goes_on(sources, range(200), 5000)
    received(sources, 3, 200 * MS)
    assert sources.fault(200 * MS) != ""


def test_a_second_that_joined_before_is_noticed_by_the_first_of_the_other(
    sources: Sources,
) -> None:
    # A client at 20 Hz, then a controller at 1 kHz.
    for now in range(0, 500, 50):
        received(sources, now // 50 + 1, now * MS)
    received(sources, 1, 501 * MS)
    assert sources.fault(501 * MS) != ""


def test_who_takes_over_from_one_that_fell_silent_is_alone(sources: Sources) -> None:
    goes_on(sources, range(100), 5000)
    goes_on(sources, range(300, 400), 1, faulty=False)


def test_the_one_that_stays_is_obeyed_again_after_a_second(sources: Sources) -> None:
    for now in range(100):
        received(sources, 5000 + now, now * MS)
        received(sources, 1 + now, now * MS)
    for now in range(100, 1101):
        assert sources.fault(now * MS) != ""
        received(sources, 5000 + now, now * MS)
    assert sources.fault(1101 * MS) == ""


@pytest.mark.parametrize("period", [1003, 2000, 2490], ids=lambda period: f"{period} ms")
def test_a_slow_second_lets_the_first_be_obeyed_once(sources: Sources, period: int) -> None:
    obeyed, before = 0, True
    for now in range(1, 14000):
        received(sources, 5000 + now, now * MS)
        if now % period == 0:
            received(sources, now // period, now * MS)
            last = now
        free = not sources.fault(now * MS)
        obeyed, before = obeyed + (free and not before), free
    assert obeyed == 1
    # Once it has left, the other is obeyed; and the next second is waited for as the first was.
    goes_on(sources, range(14000, last + 3001), 19000, faulty=True)
    goes_on(sources, range(last + 3001, last + 5000), last + 8001, faulty=False)
    now = last + 5000
    received(sources, 10**6, now * MS)
    goes_on(sources, range(now, now + 1001), now + 5000, faulty=True)
    goes_on(sources, range(now + 1001, now + 1100), now + 6001, faulty=False)


def test_two_that_stand_still_for_a_while_are_still_two(sources: Sources) -> None:
    for now in range(100):
        received(sources, 5000 + now, now * MS)
        received(sources, 1 + now, now * MS)
    # Only one of them, on a machine that is busy for half a second.
    goes_on(sources, range(100, 600), 5100, faulty=True)
    received(sources, 101, 600 * MS)
    goes_on(sources, range(600, 1600), 5600, faulty=True)


def test_when_both_have_left_the_next_is_alone() -> None:
    _, sources = of_two("/left/one", "/other")
    assert sources.fault(1000 * MS) != ""
    assert sources.fault(1001 * MS) == ""
    received(sources, 1, 2000 * MS)
    assert sources.fault(2000 * MS) == ""


def test_a_name_that_is_not_known_yet_is_asked_for_again() -> None:
    middleware, sources = of_two("/one", "_NODE_NAME_UNKNOWN_")
    assert "UNKNOWN" in sources.fault(0)
    middleware.names = ("/one", "/other")
    assert "UNKNOWN" in sources.fault(99 * MS)
    assert "/one and /other" in sources.fault(100 * MS)


def test_a_publisher_that_is_listed_late_is_named_then() -> None:
    middleware, sources = of_two("/dead", "/one")
    assert sources.fault(0).endswith("/dead and /one")
    middleware.names = ("/one", "/other")
    assert sources.fault(100 * MS).endswith("/one and /other")


def test_namesakes_are_told_apart() -> None:
    _, sources = of_two("/device", "/device", numbers=(10, 10))
    first, second = sources.fault(0).rpartition(": ")[2].split(" and ")
    assert first != second
    assert first.startswith("/device (")


def test_without_numbers_the_middleware_is_asked() -> None:
    alone = Sources(Listed("/one"), "/topic")
    received(alone, UNNUMBERED, 0)
    assert alone.fault(0) == ""
    two = Sources(Listed("/one", "/other"), "/topic")
    received(two, UNNUMBERED, 0)
    assert "/one and /other" in two.fault(0)


def test_one_that_changes_to_the_lane_and_back_is_one(sources: Sources) -> None:
    goes_on(sources, range(100), 40)
    # Nobody listens outside: it counts no further.
    for now in range(100, 200):
        sources.received(Origin(LANE, 141), now * MS)
        if now == 110:
            # What was under way through the middleware.
            received(sources, 140, now * MS)
            received(sources, 141, now * MS)
        assert sources.fault(now * MS) == ""
    goes_on(sources, range(200, 300), 142, LANE, faulty=False)
    goes_on(sources, range(300, 400), 242, faulty=False)


def test_what_is_under_way_when_the_lane_takes_over_is_its_own_at_any_rate(
    sources: Sources,
) -> None:
    goes_on(sources, range(100), 0)
    # At 10 kHz many messages come before the middleware is looked at.
    for tenth in range(60):
        sources.received(Origin(LANE, 101), 100 * MS + tenth * MS // 10)
    for number in (100, 101):
        received(sources, number, 107 * MS)
    assert sources.fault(107 * MS) == ""


def test_a_full_lane_whose_messages_come_through_the_middleware_is_one(sources: Sources) -> None:
    for now in range(200):
        if now % 7 == 3:
            received(sources, now, now * MS)
        else:
            sources.received(Origin(LANE, now), now * MS)
        assert sources.fault(now * MS) == ""


@pytest.mark.parametrize("first", [1, 199, 200, 201, 205, 300, 5000])
def test_a_stranger_beside_one_on_the_lane_is_noticed_within_two(
    sources: Sources, first: int
) -> None:
    """Whatever its numbers: the one on the lane tells how many it has sent otherwise."""
    goes_on(sources, range(100), 200, LANE, step=0)
    assert sources.fault(100 * MS) == ""
    for now in range(100, 102):
        received(sources, first + now - 100, now * MS)
        sources.received(Origin(LANE, 200), now * MS)
    assert sources.fault(102 * MS) == "more than one publisher of /topic: /left/one and /other"


@pytest.mark.parametrize("apart", range(-20, 21))
@pytest.mark.parametrize("first", [True, False])
def test_a_stranger_is_noticed_too_where_the_middleware_carries_everything(
    sources: Sources, apart: int, first: bool
) -> None:
    for now in range(100):
        sources.received(Origin(LANE, 200 + now), now * MS)
        sources.copied(200 + now, now * MS)
    assert sources.fault(100 * MS) == ""
    for now in range(100, 103):
        sources.received(Origin(LANE, 200 + now), now * MS)
        for copy in (first, not first):
            if copy:
                sources.copied(200 + now, now * MS)
            else:
                received(sources, 200 + now + apart, now * MS)
    assert sources.fault(102 * MS) == "more than one publisher of /topic: /left/one and /other"


def test_copies_that_come_late_or_not_at_all_are_of_one(sources: Sources) -> None:
    for now in range(100):
        sources.received(Origin(LANE, 200 + now), now * MS)
        if now % 3:
            sources.copied(195 + now, now * MS)
        assert sources.fault(now * MS) == ""


@pytest.mark.parametrize("number", [0, 50, 10**6])
def test_two_on_the_lane_are_two_whatever_their_numbers(sources: Sources, number: int) -> None:
    goes_on(sources, range(50), 50, LANE, step=0)
    assert sources.fault(50 * MS) == ""
    sources.received(Origin(OTHER_LANE, number), 50 * MS)
    assert sources.fault(50 * MS) != ""


def test_one_that_was_restarted_on_the_lane_is_alone(sources: Sources) -> None:
    goes_on(sources, range(100), 50, LANE, step=0)
    goes_on(sources, range(300, 400), 0, OTHER_LANE, step=0, faulty=False)


@pytest.mark.parametrize(
    ("names", "told"), [((), "two without a name"), (("/one",), "/one and one without a name")]
)
def test_a_fault_tells_of_two_whatever_is_known_by_name(names: tuple, told: str) -> None:
    _, sources = of_two(*names)
    assert sources.fault(0) == f"more than one publisher of /topic: {told}"


def test_late_copies_of_what_the_lane_took_over_are_of_one(sources: Sources) -> None:
    """Whoever else is listed: the lane has brought the same message."""
    for now in range(100):
        sources.received(Origin(LANE, 200 + min(now, 10)), now * MS)
    for number in range(200, 211):
        sources.copied(number, 100 * MS)
    assert sources.fault(100 * MS) == ""


def test_what_comes_late_is_somebody_elses_only_if_there_may_be_somebody() -> None:
    middleware = Listed("/one")
    sources = Sources(middleware, "/topic")
    goes_on(sources, range(1000, 1200), 200, LANE, step=0)
    late = [Origin(MIDDLEWARE, number, sent_ns=(900 + number) * MS) for number in (100, 101, 102)]
    sources.received(late[0], 1200 * MS)
    assert sources.fault(1200 * MS) == ""
    middleware.names = ("/one", "/other")
    sources.received(late[1], 1200 * MS)
    assert sources.fault(1200 * MS).endswith("/one and /other")


def test_what_comes_in_time_is_somebody_elses_before_he_is_listed() -> None:
    sources = Sources(Listed("/one"), "/topic")
    goes_on(sources, range(1000, 1200), 200, LANE, step=0)
    sources.received(Origin(MIDDLEWARE, 100, sent_ns=1199 * MS), 1200 * MS)
    assert sources.fault(1200 * MS).endswith("/one and one without a name")


def test_a_number_that_comes_twice_is_of_two_however_late() -> None:
    sources = Sources(Listed("/one"), "/topic")
    goes_on(sources, range(1000, 1200), 200, LANE, step=0)
    for fault in (False, True):
        sources.received(Origin(MIDDLEWARE, 199, sent_ns=1100 * MS), 1200 * MS)
        assert bool(sources.fault(1200 * MS)) is fault


@pytest.mark.parametrize("stays", [True, False])
def test_a_connection_that_was_made_anew_is_no_second_unless_the_first_speaks(stays: bool) -> None:
    sources = Sources(Listed("/one", "/other"), "/topic")
    for now in range(50):
        sources.received(Origin(LANE, 20, sent=now + 1), now * MS)
    for now in range(50, 100):
        sources.received(Origin(OTHER_LANE, 20 + now - 50, sent=now + 1), now * MS)
        if stays:
            sources.received(Origin(LANE, 20, sent=now + 1), now * MS)
        assert bool(sources.fault(now * MS)) is stays


def test_an_emergency_stop_lasts_and_comes_first(sources: Sources) -> None:
    guard = CommandGuard(sources)
    assert guard.fault(0) == ""
    guard.stopped = True
    received(sources, 100, 0)
    received(sources, 7, 0)
    assert guard.fault(1000 * MS) == STOPPED
    assert guard.fault(0) == STOPPED
    guard.stopped = False
    assert "/left/one and /other" in guard.fault(0)
    assert guard.fault(2000 * MS) == ""


@pytest.mark.parametrize("watched", [0, 1])
def test_two_on_either_topic_are_a_fault_that_names_both(watched: int) -> None:
    topics = "/device/servo_cf", "/device/local_feedback_gain"
    both = [Sources(Listed("/one", "/other"), topic) for topic in topics]
    guard = CommandGuard(*both)
    for one in both:
        received(one, 100, 0)
        # Nor is it a fault that nobody speaks on the other one.
        assert guard.fault(0) == ""
    received(both[watched], 7, 0)
    assert guard.fault(0) == f"more than one publisher of {topics[watched]}: /one and /other"
    guard.forget()
    assert guard.fault(0) == ""
