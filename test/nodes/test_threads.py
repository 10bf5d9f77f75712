# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Threads of a node's process: callbacks, and what people see, beside the loop's."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hapticmech_ros.nodes import turn
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.lane import Lane
from hapticmech_ros.nodes.loop import Threads
from nodes.stand_ins import at_last


class Queued:
    """An executor to which a test gives callbacks."""

    def __init__(self) -> None:
        self.queue: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()

    def spin_once(self, timeout_sec: float) -> None:
        try:
            callback = self.queue.get(timeout=timeout_sec)
        except queue.Empty:
            return
        callback()


@pytest.fixture
def process(tmp_path: Path) -> Iterator[tuple[Queued, Exchange, Threads]]:
    """Return an executor, an exchange and the threads, of which this one is the loop's."""
    executor, exchange = Queued(), Exchange()
    tmp_path.chmod(0o700)
    exchange.lane = Lane(tmp_path)
    # Nobody else comes.
    os.utime(tmp_path, (0, 0))
    exchange.lane.look()
    threads = Threads(executor, exchange)  # type: ignore[arg-type]
    threads.begin(exchange.lane.turn)
    yield executor, exchange, threads
    threads.end()
    exchange.close()


def wait_for(happened: Callable[[], object], exchange: Exchange) -> None:
    """Wait as the loop does, until something has happened."""
    at_last(happened, lambda: exchange.collect(0.01))


def test_callbacks_run_while_the_loop_waits_and_not_while_it_works(
    process: tuple[Queued, Exchange, Threads],
) -> None:
    executor, exchange, _ = process
    began, ran = threading.Event(), threading.Event()

    def callback() -> None:
        began.set()
        with exchange.taken():
            ran.set()

    executor.queue.put(callback)
    assert began.wait(20.0)
    # It is this thread's turn.
    assert not ran.wait(0.1)
    wait_for(ran.is_set, exchange)


def test_a_loop_that_is_always_busy_lets_callbacks_have_their_turn(
    process: tuple[Queued, Exchange, Threads],
) -> None:
    executor, exchange, _ = process
    for _ in range(30):
        began, ran = threading.Event(), threading.Event()

        def callback(began: threading.Event = began, ran: threading.Event = ran) -> None:
            began.set()
            with exchange.taken():
                ran.set()

        executor.queue.put(callback)
        assert began.wait(20.0)
        time.sleep(0.001)
        for _ in range(3):
            # There is always something to read, and it takes most of the time.
            exchange.lane.turn.ring()
            exchange.collect(0.01)
            end = time.monotonic() + 200e-6
            while time.monotonic() < end:
                pass
        assert ran.is_set()


def test_a_callback_that_may_change_deadlines_ends_the_wait(
    process: tuple[Queued, Exchange, Threads],
) -> None:
    executor, exchange, _ = process

    def callback(rings: bool) -> None:
        with exchange.taken(rings):
            pass

    for rings in (True, False):
        executor.queue.put(lambda rings=rings: callback(rings))
        begun = time.monotonic()
        exchange.collect(2.0)
        assert (time.monotonic() - begun < 1.0) == rings


def test_an_error_in_a_callback_reaches_the_loop(
    process: tuple[Queued, Exchange, Threads],
) -> None:
    executor, exchange, threads = process

    def fail() -> None:
        raise KeyError("as of a defect")

    executor.queue.put(fail)
    begun = time.monotonic()
    exchange.collect(2.0)
    assert time.monotonic() - begun < 1.0
    with pytest.raises(KeyError, match="as of a defect"):
        threads.have_listened()


def test_who_does_not_listen_is_deaf_until_he_does_again(
    process: tuple[Queued, Exchange, Threads], monkeypatch: pytest.MonkeyPatch
) -> None:
    executor, exchange, threads = process
    monkeypatch.setattr(turn, "DEAF_NS", 150_000_000)
    wait_for(threads.have_listened, exchange)
    assert not exchange.turn.is_deaf
    goes_on, began = threading.Event(), threading.Event()

    def stand() -> None:
        began.set()
        goes_on.wait(20.0)

    executor.queue.put(stand)
    assert began.wait(20.0)
    begun = time.monotonic()
    wait_for(lambda: exchange.turn.is_deaf, exchange)
    assert time.monotonic() - begun > 0.05
    threads.have_listened()
    assert not threads.have_listened()
    goes_on.set()
    wait_for(lambda: not exchange.turn.is_deaf, exchange)
    wait_for(threads.have_listened, exchange)


def test_views_are_published_beside_the_loop_one_after_the_other(
    process: tuple[Queued, Exchange, Threads],
) -> None:
    _, exchange, _ = process
    published = list[tuple[int, int]]()

    def view(number: int) -> Callable[[], None]:
        return lambda: published.append((number, threading.get_ident()))

    # While it works only the first one is kept: a newer one comes soon.
    assert [exchange.lane.turn.view(view(number)) for number in range(3)] == [True] * 3
    wait_for(lambda: published, exchange)
    assert exchange.lane.turn.view(view(3))
    wait_for(lambda: len(published) == 2, exchange)
    assert [number for number, _ in published] == [0, 3]
    assert threading.get_ident() not in [thread for _, thread in published]


def test_without_a_lane_the_loop_is_alone() -> None:
    executor, exchange = Queued(), Exchange()
    threads = Threads(executor, exchange)  # type: ignore[arg-type]
    executor.queue.put(lambda: pytest.fail("ran"))
    with exchange.taken():
        assert threads.have_listened()
    assert not exchange.turn.is_deaf
    threads.end()
    assert executor.queue.qsize() == 1
