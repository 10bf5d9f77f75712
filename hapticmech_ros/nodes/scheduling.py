"""Scheduling of a node's process: in real time, where the system grants it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from hapticmech_ros.nodes.parameters import NodeParameters

_NAMES = {
    number: name
    for name in ("SCHED_OTHER", "SCHED_FIFO", "SCHED_RR", "SCHED_BATCH", "SCHED_IDLE")
    if (number := getattr(os, name, None)) is not None
}


def priority_of(nodes: Iterable[NodeParameters], in_sim_time: bool) -> int:
    """Return the real-time priority of a process with nodes of these parameters; 0: none.

    The highest that one of them asks for. Nodes that follow /clock have no deadlines to keep.
    """
    return 0 if in_sim_time else max((node.thread_priority for node in nodes), default=0)


def ask_for_real_time(priority: int) -> str:
    """Ask for real-time scheduling of all threads of this process; say why not, if it is refused.

    ``SCHED_FIFO``: a thread that has something to do runs before every ordinary one of the machine.
    Processes started from here, and threads begun later, are ordinary ones.

    Args:
        priority: 1 to 99.
    """
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    try:
        for thread in Path("/proc/self/task").iterdir():
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))
    except PermissionError:
        return f"real-time priority {priority} is not granted to this user"
    except OSError as error:
        return f"real-time priority {priority} cannot be had here: {error.strerror}"
    return ""


def scheduling() -> str:
    """Return how the system schedules the thread that asks: policy, and priority if it has one."""
    policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    name = _NAMES.get(policy, f"policy {policy}")
    priority = os.sched_getparam(0).sched_priority
    return f"{name} {priority}" if priority else name
