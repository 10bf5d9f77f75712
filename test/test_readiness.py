# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Who is up says so by the protocol of systemd, and is known by what the system says of it."""

import os
import socket
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from hapticmech_ros.system.readiness import ADDRESS, Readiness, report_ready

PROGRAM = "from hapticmech_ros.system.readiness import report_ready; report_ready()"


@pytest.fixture
def readiness():
    found = Readiness()
    yield found
    found.close()


def test_a_process_that_says_so_is_known_by_its_number(readiness):
    assert readiness.pids() == frozenset()
    child = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], env=os.environ | {ADDRESS: readiness.address}
    )
    assert child.wait(60) == 0
    assert readiness.pids() == {child.pid}
    # What was heard once is not forgotten.
    assert readiness.pids() == {child.pid}


def test_other_words_do_not_count(readiness):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        other.connect("\0" + readiness.address[1:])
        for text in (b"STATUS=READY=1", b"READY=10", b"", b"\xff" * 10_000):
            other.send(text)
        assert readiness.pids() == frozenset()
        other.send(b"STATUS=up\nREADY=1\n")
    assert readiness.pids() == {os.getpid()}


def test_a_socket_in_a_file_is_told_too(tmp_path):
    """As systemd's own is."""
    path = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as received:
        received.bind(path)
        report_ready({ADDRESS: path})
        assert received.recv(100) == b"READY=1"


@pytest.mark.parametrize("address", ["", "relative", "@nobody-listens", "/nowhere/at/all"])
def test_nobody_who_wants_to_know_is_no_error(address):
    report_ready({ADDRESS: address})
    report_ready({})


def test_who_does_not_read_holds_nobody_up_for_long(readiness):
    """As where processes are started again and again, and nobody asks whether they are up."""
    program = "import hapticmech_ros.system.readiness as r\nfor _ in range(8): r.report_ready()"
    subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {ADDRESS: readiness.address},
        timeout=60,
        check=True,
    )
    assert len(readiness.pids()) == 1


def test_a_full_socket_does_not_hold_up_a_start(readiness):
    """With a wait in the caller, the message would have been given up by now."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        other.setblocking(False)
        other.connect("\0" + readiness.address[1:])
        with suppress(BlockingIOError):
            while True:
                other.send(b"STATUS=up")
    report_ready({ADDRESS: readiness.address})
    end = time.monotonic() + 60.0
    while os.getpid() not in readiness.pids():
        assert time.monotonic() < end


def test_many_at_once_are_all_heard_by_who_reads_now_and_then(readiness):
    """More than a socket holds: nobody's word is lost."""
    children = [
        subprocess.Popen(
            [sys.executable, "-c", PROGRAM], env=os.environ | {ADDRESS: readiness.address}
        )
        for _ in range(15)
    ]
    end = time.monotonic() + 60.0
    while not {child.pid for child in children} <= readiness.pids():
        assert time.monotonic() < end
        time.sleep(0.2)
    assert [child.wait(60) for child in children] == [0] * 15
