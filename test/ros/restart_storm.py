# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Four nodes, each in a process, of which one after the other is killed and started anew at random.

Processes are forked from this one, which has imported all they need: a start takes a tenth of the
time. Prints a line of JSON once the storm is over: how many were killed by each signal, and whoever
ended without being asked. The nodes then run until standard input ends.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import random
import signal
import sys
import time
from collections import Counter

from hapticmech_ros.graph.processes import ros_arguments
from hapticmech_ros.nodes import runtime
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.realtime import QuickStart

SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
# From a moment after the start to well after messages flow; and how long nobody is there.
LIVES_S, ABSENT_S = (0.0, 0.15), (0.0, 0.05)
# Whoever does not end when told to keeps the storm from going on.
TIMEOUT_S = 150
_PR_SET_PDEATHSIG = 1
# Descriptor of what was standard output at the start.
TOLD = 9


def started(name: str, transport: str, rate: float) -> int:
    """Return the process id of a node that starts."""
    pid = os.fork()
    if pid:
        return pid
    status = 1
    try:
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        os.close(TOLD)
        parameters = {
            "scene": "five_bar",
            "transport": transport,
            "control_rate": rate,
            "diagnostics_period": 0.1,
        }
        status = runtime.run([name], ros_arguments(parameters), QuickStart(()))
    finally:
        sys.stdout.flush()
        os._exit(status)


def main(seed: int, restarts: int, transport: str, rate: float) -> None:
    signal.alarm(TIMEOUT_S)
    draw = random.Random(seed)
    for name in NODES:
        runtime.actor_type(name)
    importlib.import_module("hapticmech_ros.nodes.managed")
    # A signal that comes while Python forks is lost if Python is to handle it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(1, TOLD)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    running = {name: started(name, transport, rate) for name in NODES}
    killed: Counter[str] = Counter()
    unasked: list[tuple[str, int]] = []
    for _ in range(restarts):
        time.sleep(draw.uniform(*LIVES_S))
        for name, pid in list(running.items()):
            ended, status = os.waitpid(pid, os.WNOHANG)
            if ended:
                unasked.append((name, os.waitstatus_to_exitcode(status)))
                running[name] = started(name, transport, rate)
        victim, number = draw.choice(list(NODES)), draw.choice(SIGNALS)
        os.kill(running[victim], number)
        os.waitpid(running[victim], 0)
        killed[number.name] += 1
        time.sleep(draw.uniform(*ABSENT_S))
        running[victim] = started(victim, transport, rate)
    os.write(TOLD, (json.dumps({"killed": killed, "unasked": unasked}) + "\n").encode())
    sys.stdin.read()
    for pid in running.values():
        os.kill(pid, signal.SIGTERM)
    for pid in running.values():
        os.waitpid(pid, 0)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], float(sys.argv[4]))
