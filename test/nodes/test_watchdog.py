# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A process whose loop stands still ends and says so; one that was stopped goes on."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import time

import pytest

# Loaded here first: it is built, if need be, before the clock runs.
import hapticmech_ros.nodes.loop  # noqa: F401

BEGINNING = """
import ctypes, sys, time
from hapticmech_ros.nodes.loop import Watchdog
watchdog = Watchdog(0.5)
def go_on(seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        watchdog.go_round()
        time.sleep(0.01)
go_on(0.8)
print("runs", flush=True)
"""


def started(code: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", BEGINNING + textwrap.dedent(code)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize(
    "stands",
    # The second one holds Python's lock, as a thread does that waits for the middleware's.
    ["time.sleep(60)", "ctypes.PyDLL(None).sleep(60)"],
)
def test_a_loop_that_stands_still_ends_its_process_and_tells_where(stands: str) -> None:
    begun = time.monotonic()
    process = started(f"def stand():\n    {stands}\nstand()")
    out, told = process.communicate(timeout=30.0)
    assert time.monotonic() - begun < 25.0
    assert (process.returncode, out) == (-signal.SIGABRT, "runs\n")
    assert "watchdog: the loop of this process has stood still for 0.5 s; aborted\n" in told
    assert "in stand\n" in told


def test_a_standard_error_that_takes_nothing_does_not_keep_it_alive() -> None:
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writing, bytes(4096))
    os.set_blocking(writing, True)
    code = BEGINNING + "time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code], stderr=writing) as process:
        assert process.wait(timeout=30.0) == 134
    os.close(reading)
    os.close(writing)


def test_a_process_that_was_stopped_goes_on() -> None:
    process = started("go_on(1.0)\nprint('ends', flush=True)")
    assert process.stdout.readline() == "runs\n"
    process.send_signal(signal.SIGSTOP)
    time.sleep(1.5)
    process.send_signal(signal.SIGCONT)
    out, told = process.communicate(timeout=30.0)
    assert (process.returncode, out, told) == (0, "ends\n", "")


def test_a_loop_that_has_ended_is_not_watched() -> None:
    process = started("watchdog.end()\ntime.sleep(1.0)\nprint('ends')")
    out, told = process.communicate(timeout=30.0)
    assert (process.returncode, out, told) == (0, "runs\nends\n", "")
