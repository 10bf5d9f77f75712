"""Scheduling of a node's process: in real time, where the system grants it."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hapticmech_ros.nodes.parameters import NodeParameters

_ASKS = re.compile(r"thread_priority:=0*[1-9]")
_IN_REAL_TIME = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
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


# Of a node that is being made: after nodes that act, before what is ordinary.
STARTING = 1


class QuickStart:
    """Runs what makes a node before everything ordinary, and after every node that acts.

    Beside nodes in real time an ordinary thread gets what they leave of the processor that it is
    on, though another one may be free: a restart would take seconds. Nothing changes where the
    priority is not granted, or whoever started the process has chosen its scheduling.

    Args:
        arguments: of the process; ``thread_priority:=50``, or another one, among them asks for it.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        asked = any(_ASKS.search(argument) for argument in arguments)
        self._begun = asked and os.sched_getscheduler(0) == os.SCHED_OTHER
        if self._begun:
            with contextlib.suppress(OSError):
                os.sched_setscheduler(0, _IN_REAL_TIME, os.sched_param(STARTING))

    def end(self) -> None:
        """Make this thread an ordinary one again."""
        if self._begun:
            with contextlib.suppress(OSError):
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def ask_for_real_time(priority: int) -> str:
    """Request real-time scheduling of all threads; return why it was refused, or nothing.

    ``SCHED_FIFO``: a thread that has something to do runs before every ordinary one of the machine.
    Processes started from here, and threads begun later, are ordinary ones.

    Args:
        priority: 1 to 99.
    """
    try:
        for thread in Path("/proc/self/task").iterdir():
            os.sched_setscheduler(int(thread.name), _IN_REAL_TIME, os.sched_param(priority))
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
