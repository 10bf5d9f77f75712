# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The clock that tests step: the time of day follows, the monotonic clock does not."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from benchmarks.reliability.stepped_clock import SteppedClock

# Says by how many minutes each clock differs from what it is told, or how a wait until then ends.
CHILD = """
import ctypes, datetime, sys, time

def apart(now_ns, told):
    return round((now_ns - int(told)) / 60e9)

class Timespec(ctypes.Structure):
    _fields_ = [("s", ctypes.c_long), ("ns", ctypes.c_long)]

libc = ctypes.CDLL(None, use_errno=True)
for line in sys.stdin:
    day, steady = line.split()
    if day == "wait":
        semaphore, until = ctypes.create_string_buffer(64), Timespec(int(time.time() + 600), 0)
        libc.sem_init(semaphore, 0, 0)
        print("waiting", flush=True)
        print(libc.sem_timedwait(semaphore, ctypes.byref(until)), flush=True)
        continue
    clocks = (time.time_ns(), time.time() * 1e9, datetime.datetime.now().timestamp() * 1e9,
              time.clock_gettime_ns(time.CLOCK_REALTIME), libc.time(None) * 10**9)
    found = [apart(int(now), day) for now in clocks]
    print(*found, apart(time.monotonic_ns(), steady), flush=True)
"""


@contextmanager
def living_by(clock: SteppedClock) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", CHILD],
        env=clock.environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def ask(process: subprocess.Popen[str], *words: object) -> str:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(" ".join(map(str, words)) + "\n")
    process.stdin.flush()
    return process.stdout.readline().strip()


def apart(process: subprocess.Popen[str]) -> list[int]:
    """Return by how many minutes clocks of the day, and the monotonic one, differ from ours."""
    return [int(word) for word in ask(process, time.time_ns(), time.monotonic_ns()).split()]


def test_clocks_of_the_day_step_and_the_monotonic_one_does_not(tmp_path: Path) -> None:
    with SteppedClock(tmp_path) as clock, living_by(clock) as process:
        for step, offset in ((0, 0), (600, 10), (-1260, -11), (660, 0)):
            clock.step(step)
            *days, steady = apart(process)
            assert days == [offset] * 5
            assert steady == 0
