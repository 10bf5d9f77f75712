# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the machine that runs the tests grants."""

import subprocess
import sys


def grants_real_time(priority: int) -> bool:
    """Return whether this user may have a real-time priority: asked by a process of its own."""
    return _succeeds(f"os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({priority}))")


def grants_nice(value: int) -> bool:
    """Return whether this user may have a nice value."""
    return _succeeds(f"os.setpriority(os.PRIO_PROCESS, 0, {value})")


def _succeeds(call: str) -> bool:
    code = f"import os; {call}"
    asked = subprocess.run([sys.executable, "-c", code], check=False, stderr=subprocess.DEVNULL)
    return asked.returncode == 0
