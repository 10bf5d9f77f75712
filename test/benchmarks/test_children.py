# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0

import os
import sys
from pathlib import Path

from benchmarks.children import (
    BUSY,
    finding_benchmarks,
    wait_until,
)
from hapticmech_ros.graph.processes import start_process


def busy_children(parent: int) -> set[int]:
    """Return the busy programs of a process."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    busy = "\0".join(BUSY)
    return {pid for pid in map(int, children) if command_of(pid).rstrip("\0") == busy}


def command_of(pid: int) -> str:
    """Return the command line of a process; empty if it has ended."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8")
    except (FileNotFoundError, ProcessLookupError):
        return ""


def test_busy_programs_end_with_a_process_that_is_killed() -> None:
    program = "import benchmarks.children as c, time\nwith c.busy_programs(2): time.sleep(600)"
    environment = finding_benchmarks(os.environ)
    process = start_process([sys.executable, "-c", program], environment)
    try:
        wait_until(lambda: len(busy_children(process.pid)) == 2, 60.0, "two programs")
        busy = busy_children(process.pid)
    finally:
        process.kill()
        process.wait()
    wait_until(lambda: not any(map(command_of, busy)), 60.0, "their end")
