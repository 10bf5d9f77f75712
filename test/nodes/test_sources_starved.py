# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A reader without a processor never takes one publisher for two, and still notices a second.

A model of both ways, in a time of its own: a publisher as in ``exchange.Outlet``, connections and
the middleware's queue, and a reader as in ``loop.Inbox`` and ``Exchange.listen``.
"""

from __future__ import annotations

import random
from collections import deque
from dataclasses import dataclass, field

import pytest

from hapticmech_ros.nodes.exchange import MOST_UNDERWAY, SETTLES_NS, UNDERWAY_NS
from hapticmech_ros.nodes.lane import BEHIND_NS, STALLED_NS
from hapticmech_ros.nodes.messages import CONTROL_SUBSCRIBER
from hapticmech_ros.nodes.sources import MIDDLEWARE, Origin, Sources
from nodes.stand_ins import Listed
from sampling import sampled

MS, S = 1_000_000, 1_000_000_000
# Of the reliability campaign: until forces are zero.
NOTICED_NS = 20 * MS
OUTLET = 7
EPOCH_NS = 1000 * S


@dataclass
class Stalls:
    """When something gets no processor: long and short pauses, with more or less time between."""

    chance: random.Random
    longest_ns: int
    apart_ns: int
    until_ns: int = 0
    next_ns: int = 0

    def runs(self, now_ns: int) -> bool:
        if now_ns >= self.next_ns:
            # From 10 ms on, as many around 30 ms as around 3 s.
            longer = (self.longest_ns / 10 / MS) ** self.chance.random()
            self.until_ns = now_ns + round(10 * MS * longer)
            self.next_ns = self.until_ns + round(self.chance.expovariate(1 / self.apart_ns))
        return now_ns >= self.until_ns


@dataclass
class Middleware:
    """Brings each publisher's messages in order, late; of those not taken it keeps the newest."""

    chance: random.Random
    stalls: Stalls
    loss: float
    waiting: deque = field(default_factory=deque)
    brought: deque = field(default_factory=lambda: deque(maxlen=CONTROL_SUBSCRIBER.depth))

    def send(self, what: tuple[str, int, int]) -> None:
        if self.chance.random() >= self.loss:
            self.waiting.append(what)

    def go_on(self, now_ns: int) -> None:
        if self.stalls.runs(now_ns):
            # A few at a time: the queue may be taken from while it works off what has piled up.
            for _ in range(min(len(self.waiting), self.chance.randint(1, 8))):
                self.brought.append(self.waiting.popleft())


@dataclass
class Publisher:
    """Sends over its connection, and through the middleware where somebody needs that."""

    name: str
    middleware: Middleware
    capacity: int
    serial: int
    number: int = 0
    sent: int = 0
    linked: bool = False
    others: bool = False
    full_ns: int = 0
    settled_ns: int = 0
    counted: bool = False
    connections: list[tuple[int, deque]] = field(default_factory=list)

    def link(self, linked: bool) -> None:
        """Lose the connection, or make one anew; what is in the old one can still be read."""
        self.linked, self.full_ns = linked, 0
        if linked:
            self.serial += 2
            self.connections.append((self.serial << 32 | OUTLET, deque()))

    def speak(self, now_ns: int) -> None:
        stalled = 0 < self.full_ns < now_ns - STALLED_NS
        counted = self.linked and not stalled
        if counted != self.counted:
            self.counted, self.settled_ns = counted, now_ns + SETTLES_NS
        both = not counted or self.others or now_ns < self.settled_ns
        self.number += both
        if self.linked:
            self.sent += 1
            via, frames = self.connections[-1]
            if len(frames) < self.capacity:
                self.full_ns = 0
                frames.append((Origin(via, self.number, self.sent, now_ns), both))
            else:
                self.full_ns = self.full_ns or now_ns
        if both:
            self.middleware.send((self.name, self.number, now_ns))


@dataclass
class Reader:
    """Hears what comes over the lane, and looks at the middleware now and then."""

    sources: Sources
    publishers: list[Publisher]
    middleware: Middleware
    underway: dict = field(default_factory=dict)

    def collect(self, now_ns: int, whole: bool) -> None:
        """Take of each connection one message, or all of which the newest is heard."""
        for publisher in self.publishers:
            for via, frames in list(publisher.connections):
                newest = None
                while frames:
                    newest, both = frames.popleft()
                    if both:
                        self.underway[publisher.name, newest.number] = now_ns
                        if len(self.underway) > MOST_UNDERWAY:
                            del self.underway[next(iter(self.underway))]
                    if not whole and now_ns - newest.sent_ns <= BEHIND_NS:
                        break
                if newest is not None:
                    self.sources.received(newest, now_ns)
                elif via != publisher.connections[-1][0]:
                    publisher.connections.remove((via, frames))

    def run(self, now_ns: int) -> None:
        self.collect(now_ns, whole=False)
        while self.middleware.brought:
            name, number, sent_ns = self.middleware.brought.popleft()
            self.collect(now_ns, whole=True)
            noted = self.underway.get((name, number))
            if noted is not None and now_ns - noted < UNDERWAY_NS:
                self.sources.copied(number, now_ns)
            else:
                self.sources.received(Origin(MIDDLEWARE, number, sent_ns=sent_ns), now_ns)


class Model:
    """One publisher, or two, and a reader."""

    def __init__(self, seed: int) -> None:
        chance = self.chance = random.Random(seed)
        longest = chance.choice([100 * MS, 3 * S, 10 * S])
        self.listed = Listed(*["one"] * (seed % 5 > 0))
        apart = [round(chance.choice([0.1, 1, 5]) * S) for _ in range(2)]
        self.reading = Stalls(chance, longest, apart[0])
        self.middleware = Middleware(
            chance, Stalls(chance, longest, apart[1]), chance.choice([0.0, 0.0, 0.3])
        )
        capacity = chance.choice([20, 278, 5000])
        self.one = Publisher("one", self.middleware, capacity, 1, number=chance.choice([0, 3000]))
        self.sources = Sources(self.listed, "/topic")
        self.reader = Reader(self.sources, [self.one], self.middleware)
        self.period_ns = chance.choice([MS, MS, 5 * MS, MS // 4])
        self.now_ns = EPOCH_NS
        self.changes = {"link": 0, "others": 0}

    def step(self, calm: bool = False) -> None:
        """Let a period go by; where it is calm all have a processor, and nothing changes."""
        now = self.now_ns = self.now_ns + self.period_ns
        chance = self.chance
        if not calm and chance.random() < self.period_ns / S:
            change = chance.choice(list(self.changes))
            self.changes[change] += 1
            if change == "link":
                self.one.link(not self.one.linked)
            else:
                self.one.others = not self.one.others
        for publisher in chance.sample(self.reader.publishers, len(self.reader.publishers)):
            publisher.speak(now)
        if calm:
            self.middleware.brought.extend(self.middleware.waiting)
            self.middleware.waiting.clear()
        else:
            self.middleware.go_on(now)
        if calm or self.reading.runs(now):
            self.reader.run(now + chance.randint(0, self.period_ns // 2))


@pytest.mark.parametrize("seed", sampled(range(60), every=3))
def test_one_publisher_is_never_two_whatever_waits_for_a_processor(seed: int) -> None:
    model = Model(seed)
    for _ in range(25_000):
        model.step()
        assert model.sources.fault(model.now_ns) == "", (model.now_ns - EPOCH_NS) / S


@pytest.mark.parametrize("on_lane", [True, False])
@pytest.mark.parametrize("is_listed", [True, False])
@pytest.mark.parametrize("seed", range(20))
def test_a_second_is_noticed_in_time_after_all_of_that(
    seed: int, is_listed: bool, on_lane: bool
) -> None:
    model = Model(seed)
    for _ in range(5000):
        model.step()
    # What has piled up is worked off.
    for _ in range(200):
        model.step(calm=True)
    assert model.sources.fault(model.now_ns) == ""
    number = model.chance.choice([0, model.one.number, 10**6])
    second = Publisher("two", model.middleware, 278, 100, number, sent=number)
    if on_lane:
        second.link(True)
    model.reader.publishers.append(second)
    # A middleware may list somebody later than it brings his messages.
    model.listed.names = ("one", "two") if is_listed else ("one",)
    start = model.now_ns
    while not model.sources.fault(model.now_ns):
        model.step(calm=True)
        assert model.now_ns - start <= max(NOTICED_NS, 20 * model.period_ns)
