# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How a node's process ends: signals that come late, and its last line."""

from __future__ import annotations

import io
import signal
import subprocess
import sys

import pytest

from hapticmech_ros.nodes.loop import print_report

# Python has taken its own handlers away when it clears modules; what is told there comes last.
ENDS = """
import os, signal
from hapticmech_ros.nodes.loop import StopRequest

class Last:
    def __del__(self, kill=os.kill, pid=os.getpid(), number=signal.{name}):
        kill(pid, number)

stop = StopRequest()
last = Last()
os.kill(os.getpid(), signal.SIGINT)
print("asked", stop.asked, flush=True)
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_second_signal_does_not_kill_a_process_that_ends(name: str) -> None:
    script = ENDS.format(name=name)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.stdout == "asked True\n"
    assert done.returncode == 0, signal.Signals(-done.returncode)


class Written(io.StringIO):
    def __init__(self) -> None:
        super().__init__()
        self.pieces: list[str] = []

    def write(self, text: str) -> int:
        self.pieces.append(text)
        return len(text)


class Node:
    def final_report(self) -> str:
        return "device: rendered"


def test_the_last_line_is_one_write(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Written()
    monkeypatch.setattr(sys, "stdout", terminal)
    print_report(Node())
    assert terminal.pieces == ["device: rendered\n"]
