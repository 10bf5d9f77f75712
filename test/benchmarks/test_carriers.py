# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Carriers of messages between two processes: what is sent arrives, and is answered."""

from __future__ import annotations

import signal
import socket
import threading
import time

import pytest

from benchmarks.carriers.benchmark import Answering, installed, run_benchmark, time_carrier
from benchmarks.carriers.carriers import (
    CARRIERS,
    SharedMemory,
    SocketEnd,
    Sockets,
    event_descriptors,
    unix_socket,
)
from benchmarks.children import BenchError


@pytest.mark.parametrize("name", list(CARRIERS))
def test_messages_of_any_length_come_back_as_they_were(name: str) -> None:
    if not installed(name):
        # The other ones are there everywhere; this one is named as missing.
        assert name in run_benchmark(1, 0.01).missing
        return
    with Answering(CARRIERS[name]) as end:
        for length in (1, 320, 1300, 30_000):
            message = bytes(range(256)) * (length // 256 + 1)
            end.send(message[:length])
            assert end.receive() == message[:length]


def test_a_carrier_that_alters_a_message_is_not_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    def altering() -> SharedMemory:
        made = event_descriptors()
        end_of = made.end

        def end(first: bool):
            own = end_of(first)
            receive = own.receive

            def other() -> bytes:
                message = receive()
                return message if len(message) < 320 else b"x" + message[1:]

            own.receive = other
            return own

        made.end = end
        return made

    monkeypatch.setitem(CARRIERS, "altering", altering)
    with pytest.raises(BenchError, match="altering"):
        time_carrier("altering", 320, 10)


def test_late_answers_of_the_first_messages_are_not_taken_for_later_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("benchmarks.carriers.carriers.PATIENCE_S", 0.1)

    def late() -> Sockets:
        made = unix_socket(socket.SOCK_SEQPACKET)()
        end_of = made.end

        def end(first: bool) -> SocketEnd:
            if not first:
                # As on a machine that starts the other process late: several messages wait for it.
                time.sleep(0.45)
                monkeypatch.setattr("benchmarks.carriers.carriers.PATIENCE_S", 2.0)
            return end_of(first)

        made.end = end
        return made

    with Answering(late) as end:
        end.send(b"timed")
        assert end.receive() == b"timed"


@pytest.mark.parametrize("name", [name for name in CARRIERS if installed(name)])
def test_a_process_that_pauses_is_answered_afterwards(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.carriers.carriers.PATIENCE_S", 0.2)
    with Answering(CARRIERS[name]) as end:
        # Longer than the other one's patience: as while this process collects its garbage.
        time.sleep(0.7)
        end.send(b"late")
        deadline = time.monotonic() + 10.0
        while (answer := end.receive()) != b"late":
            assert not answer
            assert time.monotonic() < deadline


def test_a_wait_for_a_word_of_memory_outlasts_a_signal() -> None:
    carrier = CARRIERS["shared memory, futex"]()
    first, second = carrier.end(first=True), carrier.end(first=False)
    previous = signal.signal(signal.SIGALRM, lambda *_: None)
    signal.setitimer(signal.ITIMER_REAL, 0.1)
    sender = threading.Timer(0.3, first.send, (b"after the signal",))
    sender.start()
    try:
        assert second.receive() == b"after the signal"
    finally:
        sender.join()
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, previous)
