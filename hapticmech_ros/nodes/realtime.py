# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node's process requests real-time settings from Linux, to keep its deadlines.

These are real-time scheduling, locked memory, processors, and short idle states; each where this
user may have it. Refusals are logged, with the line of configuration that would allow them.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import platform
import re
import resource
import struct
import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hapticmech_ros.system.cpu_list import cpus_of, listed

if TYPE_CHECKING:
    from hapticmech_ros.nodes.parameters import NodeParameters, RealtimeMode

# With fewer processors, nodes that come before all else leave too little to everything else: a
# program that is to stop the device would wait for seconds until it is started.
ENOUGH_CPUS = 4
# The largest share that ordinary scheduling gives, and how long such a thread runs before another
# one's turn, ns: a thread with a shorter slice preempts others as it wakes up (from Linux 6.12 on),
# which a nice value alone does not do. 0.1 ms is the shortest.
NICE, SLICE_NS = -20, 100_000
# Of a node that is starting: after nodes that act, before ordinary threads.
STARTING = 1
# Idle states that take longer to leave are not entered, us: C1 takes up to 2, C1E about 10. In a
# virtual machine even the shallowest one gives the processor back to the host, though it claims to
# take 1: there, none is entered.
LONGEST_IDLE_EXIT_US = 2
VIRTUAL_IDLE = "haltpoll"
# Where that is requested: in force as long as the file is open.
DMA_LATENCY = Path("/dev/cpu_dma_latency")
IDLE_DRIVER = Path("/sys/devices/system/cpu/cpuidle/current_driver")

ALLOWS_PRIORITY = (
    "'@realtime - rtprio 98' in /etc/security/limits.d/realtime.conf, or LimitRTPRIO=98 in a "
    "systemd unit, allows it"
)
ALLOWS_NICE = (
    "'@realtime - nice -20' in /etc/security/limits.d/realtime.conf, or LimitNICE=-20 in a "
    "systemd unit, allows it"
)
ALLOWS_LOCK = (
    "'@realtime - memlock unlimited' in /etc/security/limits.d/realtime.conf, or "
    "LimitMEMLOCK=infinity in a systemd unit, allows it"
)
ALLOWS_LATENCY = (
    'KERNEL=="cpu_dma_latency", GROUP="realtime", MODE="0660" in '
    "/etc/udev/rules.d/99-realtime.rules allows it"
)
_INSISTS = re.compile(r"\brealtime:=on\b")
_DECLINES = re.compile(r"\b(?:realtime:=off|use_sim_time:=true)\b")
_IN_REAL_TIME = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
_ORDINARY = os.SCHED_OTHER | os.SCHED_RESET_ON_FORK
_NAMES = {
    number: name
    for name in ("SCHED_OTHER", "SCHED_FIFO", "SCHED_RR", "SCHED_BATCH", "SCHED_IDLE")
    if (number := getattr(os, name, None)) is not None
}
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
# sched_setattr(2) and sched_getattr(2), for which the C library has no functions.
_SCHED_CALLS = {"x86_64": (314, 315), "aarch64": (274, 275)}
_SCHED_ATTRIBUTES = struct.Struct("IIQiIQQQII")
_SCHED_FLAG_RESET_ON_FORK = 1
_CAP_IPC_LOCK = 14
NOT_REQUESTED = "not requested"


@dataclass(frozen=True, slots=True)
class Request:
    """A process's requests.

    Attributes:
        mode: ``off``: nothing; ``auto``: what is granted, and real-time scheduling only with
            :data:`ENOUGH_CPUS`, else :data:`NICE`; ``on``: that with fewer too.
        priority: of SCHED_FIFO.
        cpus: to run on; empty: any, or by ``place``.
        place: of the sorted CPUs the one to run on if there are less than :data:`ENOUGH_CPUS`, such
            as -1 for the last; None: any.
    """

    mode: RealtimeMode = "off"
    priority: int = 0
    cpus: frozenset[int] = frozenset()
    place: int | None = None

    @classmethod
    def of(cls, nodes: Iterable[NodeParameters], in_sim_time: bool) -> Request:
        """Return the requests of a process with nodes of these parameters.

        They are the largest of any node. Nodes that follow /clock have no deadlines to keep.
        """
        asking = [node for node in nodes if node.realtime != "off" and not in_sim_time]
        if not asking:
            return cls()
        return cls(
            "on" if any(node.realtime == "on" for node in asking) else "auto",
            max(node.thread_priority for node in asking),
            frozenset().union(*(cpus_of(node.cpu_affinity) for node in asking)),
            _common_place(asking),
        )


class Realtime:
    """This process's requests, and their results.

    Threads begun later and processes started from here are ordinary ones, on the same processors.

    Args:
        request: to make now.

    Attributes:
        refusals: a sentence for each thing that was refused.
    """

    def __init__(self, request: Request) -> None:
        self._request = request
        self._latency: int | None = None
        asked = request.mode != "off"
        # How many others could use: one that is pinned to a single one leaves them the rest.
        self._cpus = len(os.sched_getaffinity(0))
        cpus = request.cpus or self._own_cpu()
        self._pinning = pin(cpus) if asked and cpus else ""
        self._scheduling = self._schedule() if asked else ""
        self._memory = lock_memory() if asked else NOT_REQUESTED
        self._idle = self._keep_awake() if asked else NOT_REQUESTED
        found = (self._pinning, self._scheduling, self._memory, self._idle)
        self.refusals = [one for one in found if one not in ("", NOT_REQUESTED)]

    def figures(self) -> dict[str, str]:
        """Return entries for diagnostics: the present settings, and why requests were refused."""
        return {
            "scheduling": _joined(scheduling(), self._scheduling),
            "cpu_affinity": _joined(listed(os.sched_getaffinity(0)), self._pinning),
            "memory_lock": self._memory or "locked",
            "cpu_dma_latency": self._idle or f"{longest_idle_exit_us()} us",
        }

    def close(self) -> None:
        """Let processors idle as they like again."""
        if self._latency is not None:
            os.close(self._latency)
            self._latency = None

    def _own_cpu(self) -> frozenset[int]:
        """Return the CPU for this process's part where there are few; else nothing."""
        place = self._request.place
        if place is None or not 1 < self._cpus < ENOUGH_CPUS:
            return frozenset()
        return frozenset({sorted(os.sched_getaffinity(0))[place]})

    def _schedule(self) -> str:
        cpus = self._cpus
        if self._request.mode == "on" or cpus >= ENOUGH_CPUS:
            return ask_for_real_time(self._request.priority)
        some = f"{cpus} CPU{'s' if cpus > 1 else ''}"
        sentence = f"no SCHED_FIFO with {some} (from {ENOUGH_CPUS} on, or with realtime:=on)"
        return "; ".join(filter(None, (sentence, ask_for_share())))

    def _keep_awake(self) -> str:
        """Request short idle states; return why that was refused, or nothing."""
        try:
            self._latency = os.open(DMA_LATENCY, os.O_WRONLY | os.O_CLOEXEC)
            os.write(self._latency, struct.pack("i", longest_idle_exit_us()))
        except PermissionError:
            return f"{DMA_LATENCY} is not granted to this user: {ALLOWS_LATENCY}"
        except OSError as error:
            return f"{DMA_LATENCY}: {error.strerror}"
        return ""


class QuickStart:
    """Runs a node's start before all ordinary threads, and after every node that acts.

    Beside nodes in real time an ordinary thread gets only the rest of its own processor, though
    another one may be free: a restart would take seconds. Nothing changes where the priority is not
    granted, or the parent has chosen the process's scheduling, nor with fewer than
    :data:`ENOUGH_CPUS`: nodes that act do not come before all else there.

    Args:
        arguments: of the process; ``realtime:=off`` among them declines it, ``realtime:=on``
            insists whatever the number of processors.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        on = any(_INSISTS.search(argument) for argument in arguments)
        few = not on and len(os.sched_getaffinity(0)) < ENOUGH_CPUS
        declined = few or any(_DECLINES.search(argument) for argument in arguments)
        self._begun = not declined and os.sched_getscheduler(0) == os.SCHED_OTHER
        if self._begun:
            with contextlib.suppress(OSError):
                os.sched_setscheduler(0, _IN_REAL_TIME, os.sched_param(STARTING))

    def end(self) -> None:
        """Make this thread an ordinary one again."""
        if self._begun:
            with contextlib.suppress(OSError):
                # Only who may have everything may take the flag away.
                os.sched_setscheduler(0, _ORDINARY, os.sched_param(0))


def ask_for_real_time(priority: int) -> str:
    """Request real-time scheduling of all threads; return why it was refused, or nothing.

    ``SCHED_FIFO``: a thread that has something to do runs before every ordinary one of the machine.
    Processes started from here, and threads begun later, are ordinary ones.

    Args:
        priority: 1 to 99.
    """
    try:
        for thread in _threads():
            os.sched_setscheduler(thread, _IN_REAL_TIME, os.sched_param(priority))
    except PermissionError:
        return f"real-time priority {priority} is not granted to this user: {ALLOWS_PRIORITY}"
    except OSError as error:
        return f"real-time priority {priority} cannot be had here: {error.strerror}"
    return ""


def ask_for_share() -> str:
    """Request nice :data:`NICE` for all threads; return why it was refused, or nothing.

    Such a thread runs as soon as it wakes up, where the system knows slices, and leaves others a
    share all the same. The slice is requested also where the nice value is refused: it needs no
    permission. Processes started from here, and threads begun later, have the nice value and the
    slice that all have.
    """
    refusal = ""
    try:
        for thread in _threads():
            os.sched_setscheduler(thread, _ORDINARY, os.sched_param(0))
            try:
                os.setpriority(os.PRIO_PROCESS, thread, NICE)
            except PermissionError:
                refusal = f"nice {NICE} is not granted to this user: {ALLOWS_NICE}"
            _ask_for_slice(thread)
    except OSError as error:
        return f"nice {NICE} cannot be had here: {error.strerror}"
    return refusal


def pin(cpus: Iterable[int]) -> str:
    """Request that all threads run on these processors; return why it was refused, or nothing."""
    wanted = set(cpus)
    allowed = os.sched_getaffinity(0)
    missing = wanted - allowed
    if missing:
        return f"cpu_affinity {listed(wanted)}: there is no CPU {listed(missing)} for this process"
    try:
        for thread in _threads():
            os.sched_setaffinity(thread, wanted)
    except OSError as error:
        return f"cpu_affinity {listed(wanted)} cannot be had here: {error.strerror}"
    return ""


def lock_memory() -> str:
    """Request that pages stay in memory once used; return why it was refused, or nothing.

    Not where there is a limit: memory requested later would be refused when it is reached.
    """
    _, most = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if most != resource.RLIM_INFINITY and not _has_capability(_CAP_IPC_LOCK):
        return f"locked memory is limited to {most // 1024} KiB for this user: {ALLOWS_LOCK}"
    libc = ctypes.CDLL(None, use_errno=True)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (most, most))
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        return f"memory cannot be locked here: {os.strerror(ctypes.get_errno())}"
    return ""


def longest_idle_exit_us() -> int:
    """Return how long (us) the processors may take to leave an idle state here."""
    with contextlib.suppress(OSError):
        if IDLE_DRIVER.read_text("ascii").strip() == VIRTUAL_IDLE:
            return 0
    return LONGEST_IDLE_EXIT_US


def slice_ns() -> int:
    """Return the slice (ns) of the process's main thread; 0 if there is none, or it is hidden."""
    call = _SCHED_CALLS.get(platform.machine())
    if call is None:
        return 0
    found = ctypes.create_string_buffer(_SCHED_ATTRIBUTES.size)
    if ctypes.CDLL(None).syscall(call[1], os.getpid(), found, _SCHED_ATTRIBUTES.size, 0):
        return 0
    return int(_SCHED_ATTRIBUTES.unpack(found.raw)[5])


def come_after_loop() -> None:
    """Let the loop's thread run before the one that asks, wherever both want to.

    In real time it has a priority less. Else it has the slice that all have: a thread with a
    shorter one runs as it wakes up.
    """
    if os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO:
        priority = max(os.sched_getparam(0).sched_priority - 1, 1)
        os.sched_setscheduler(0, _IN_REAL_TIME, os.sched_param(priority))
    else:
        _ask_for_slice(threading.get_native_id(), 0)


def _ask_for_slice(thread: int, length_ns: int = SLICE_NS) -> None:
    """Request a slice, 0 for the usual one; older systems take no notice, and others refuse."""
    call = _SCHED_CALLS.get(platform.machine())
    if call is None:
        return
    attributes = _SCHED_ATTRIBUTES.pack(
        _SCHED_ATTRIBUTES.size,
        os.SCHED_OTHER,
        _SCHED_FLAG_RESET_ON_FORK,
        os.getpriority(os.PRIO_PROCESS, thread),
        0,
        length_ns,
        *(0, 0, 0, 0),
    )
    ctypes.CDLL(None).syscall(call[0], thread, attributes, 0)


def scheduling() -> str:
    """Return how the system schedules the process's main thread, as those of its loops.

    Returns:
        Policy, and priority or nice value; the slice where it is the one requested here.
    """
    main = os.getpid()
    policy = os.sched_getscheduler(main) & ~os.SCHED_RESET_ON_FORK
    name = _NAMES.get(policy, f"policy {policy}")
    priority = os.sched_getparam(main).sched_priority
    if priority:
        return f"{name} {priority}"
    nice = os.getpriority(os.PRIO_PROCESS, main)
    short = f", slice {SLICE_NS // 1000} us" if slice_ns() == SLICE_NS else ""
    return f"{name}, nice {nice}{short}" if nice else f"{name}{short}"


def _common_place(nodes: Iterable[NodeParameters]) -> int | None:
    """Return the place of all nodes of a process; None if they differ, or one chooses its CPUs."""
    places = {None if node.cpu_affinity else node.place for node in nodes}
    return places.pop() if len(places) == 1 else None


def _threads() -> list[int]:
    return [int(thread.name) for thread in Path("/proc/self/task").iterdir()]


def _has_capability(number: int) -> bool:
    found = re.search(r"^CapEff:\s*([0-9a-f]+)", Path("/proc/self/status").read_text(), re.M)
    return found is not None and bool(int(found[1], 16) >> number & 1)


def _joined(state: str, refusal: str) -> str:
    return f"{state}: {refusal}" if refusal else state
