# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph as processes: starts the nodes, monitors them, and always ends them. Imports no ROS.

From the nodes' reports of processor time and deadlines it finds whether a graph fits its machine.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

from hapticmech_ros.compilation.library import compile_ahead
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.system.discovery import choose_discovery
from hapticmech_ros.system.installation import refuse_without_ros
from hapticmech_ros.system.readiness import ADDRESS, SHOWN, Readiness, Report
from hapticmech_ros.wire.topics import PAGE, VIEWER

# Shortest time between the first and the last reports, from which the load is computed, s.
LEAST_SPAN_S = 0.9
# A node's reports count from this long after its first one, s: until then the middleware carries
# its messages too, and Python rather than a kernel handles them.
SETTLES_S = 1.0
# A graph fits if it misses at most this share of its deadlines, and uses at most this share of the
# processors: other programs started within 0.7 s beside one that used a third of two processors,
# and within 1.1 s beside one that used 0.6.
MOST_MISSED, MOST_USED = 0.03, 0.5
# A graph saturates its machine if it uses more than TAKES_ALL of the processors and misses more
# than MISSES_MANY of its deadlines, or misses more than MISSES_MOST: beside one that missed half, a
# restarted node was not up within a minute.
TAKES_ALL, MISSES_MANY, MISSES_MOST = 0.8, 0.1, 0.5
# A proposed rate would use at most this share of the processors: the load is a mean, with peaks.
PROPOSED_USED = 0.4
# The control rates to propose, Hz.
RATES = (1000.0, 500.0, 250.0)


@dataclass(frozen=True, slots=True)
class GraphLoad:
    """A graph's use of processors, and its missed deadlines, over a span of time.

    Attributes:
        rate_hz: requested control rate, Hz.
        cores: number of processors available to the graph.
        used: processor time of its processes per time, in processors.
        missed: largest share of deadlines that a node missed.
        composed: whether its nodes share a process.
        users: number of hands.
    """

    rate_hz: float
    cores: float
    used: float
    missed: float
    composed: bool = False
    users: int = 1

    @property
    def period_us(self) -> float:
        """Processor time of all nodes per control period that was not missed, us."""
        return 1e6 * self.used / (self.rate_hz * max(1.0 - self.missed, 0.1))

    @property
    def fits(self) -> bool:
        """Whether missed deadlines and processor use are within MOST_MISSED and MOST_USED."""
        return self.missed <= MOST_MISSED and self.used <= MOST_USED * self.cores

    @property
    def saturates(self) -> bool:
        """Whether it misses its deadlines however much processor time it takes from others."""
        takes_all = self.missed > MISSES_MANY and self.used > TAKES_ALL * self.cores
        return takes_all or self.missed > MISSES_MOST

    @property
    def fitting_rate_hz(self) -> float | None:
        """The highest of :data:`RATES` below the present one that would fit.

        If none would, by the processor time per period, the lowest one below, since other programs
        may cause the load; None if there is no lower rate.
        """
        lower = [rate for rate in RATES if rate < 0.99 * self.rate_hz]
        for rate in lower:
            if 1e-6 * self.period_us * rate <= PROPOSED_USED * self.cores:
                return rate
        return lower[-1] if lower else None

    def sentence(self) -> str:
        """Return in a line the processor time per period, the share used and deadlines missed."""
        cost = f"{self.period_us:.0f} us of processor time"
        share = f"{self.used:.2f} of {self.cores:g} cores"
        missed = f"{self.missed:.1%} of the deadlines missed"
        return f"a period of {1e3 / self.rate_hz:g} ms takes {cost}: {share}, {missed}"

    def sentences(self) -> list[str]:
        """Return :meth:`sentence`, and :meth:`advice` if the graph does not fit."""
        return [self.sentence(), *([] if self.fits else [self.advice()])]

    def advice(self) -> str:
        """Return in a line what to do if the graph does not fit."""
        rate = self.fitting_rate_hz
        helps = [f"--control-rate {rate:g}"] if rate is not None else []
        helps += [] if self.composed else ["--composed"]
        helps += ["fewer users"] if self.users > 1 else []
        helps.append("ending other programs")
        carried = self.missed <= MOST_MISSED
        why = "leaves too little time to other programs at" if carried else "does not keep up with"
        return (
            f"this machine {why} {self.rate_hz:g} Hz: the loop may be interrupted; "
            f"try {', '.join(helps)} (docs/realtime.md)"
        )


class LoadWatch:
    """Computes a graph's load from the reports of its nodes, once these have settled.

    Args:
        rate_hz: control rate, Hz.
        cores: number of processors available to the graph.
        composed: whether its nodes share a process.
        users: number of hands.
        least_span_s: shortest time between the two reports compared, s.
        settles_s: time after a node's first report from which its reports count, s.
    """

    def __init__(
        self,
        rate_hz: float,
        cores: float,
        composed: bool = False,
        users: int = 1,
        least_span_s: float = LEAST_SPAN_S,
        settles_s: float = SETTLES_S,
    ) -> None:
        self._rate_hz, self._cores = rate_hz, cores
        self._composed, self._users = composed, users
        self._least_span_s, self._settles_s = least_span_s, settles_s
        self._first: dict[str, Mapping[str, str]] = {}
        # When each process reported first, s of the monotonic clock.
        self._begun: dict[tuple[str, str], float] = {}

    def look(self, reports: Mapping[str, Report]) -> GraphLoad | None:
        """Take the nodes' last reports, and return the load since their first ones that count.

        None until each node has reported again at least ``least_span_s`` later.
        """
        used: dict[str, float] = {}
        missed = 0.0
        for name, report in reports.items():
            now = report.figures
            if "pid" not in now:
                # Not configured yet.
                return None
            time_s, then = float(now["monotonic_s"]), self._first.setdefault(name, now)
            begun = self._begun.setdefault((name, now["pid"]), time_s)
            if now["pid"] != then["pid"] or float(then["monotonic_s"]) < begun + self._settles_s:
                then = self._first[name] = now
            span = time_s - float(then["monotonic_s"])
            if span < self._least_span_s:
                continue
            # The nodes of one process report the same time: any of them is used.
            used[name] = (float(now["cpu_s"]) - float(then["cpu_s"])) / span
            periods = int(now.get("periods", 0)) - int(then.get("periods", 0))
            if periods > 0:
                lost = int(now["missed_deadlines"]) - int(then["missed_deadlines"])
                missed = max(missed, lost / periods)
        if not used or len(used) < len(reports):
            return None
        by_process = {reports[name].figures["pid"]: share for name, share in used.items()}
        total = sum(by_process.values())
        return GraphLoad(self._rate_hz, self._cores, total, missed, self._composed, self._users)


# A process that has not ended this long after a signal, s, gets the next, stronger one.
STOP_TIMEOUT_S = 5.0
# Nice value for nodes whose graph saturates its machine: beside an ordinary program's thread they
# get six sevenths of a processor; at nice -20, 99 %.
SHARING_NICE = -5
_PR_SET_PDEATHSIG = 1
_NAMESPACE = re.compile(r"/?(?:[A-Za-z_]\w*(?:/[A-Za-z_]\w*)*/?)?", re.ASCII)
MECHANISM = "mechanism_simulator"


class NodeDiedError(HapticMechError):
    """A node's process ended by itself."""


class AuxiliaryProcess:
    """A process beside a graph: if it ends by itself, the user is notified and the graph goes on.

    Args:
        name: shown to the user.
        process: the process.
        loss: what no longer works without it.
        notify: shows a sentence to the user.
    """

    def __init__(
        self, name: str, process: subprocess.Popen[str], loss: str, notify: Callable[[str], None]
    ) -> None:
        self.process = process
        self._name, self._loss, self._notify = name, loss, notify
        self._reported = False

    @property
    def has_ended(self) -> bool:
        """Whether its end has been reported to the user."""
        return self._reported

    def look(self) -> None:
        """Notify the user once if it has ended."""
        if not self._reported and self.process.poll() is not None:
            self._reported = True
            self._notify(f"{ending(self._name, self.process)}: the graph goes on, but {self._loss}")

    def end(self) -> bool:
        """End it if it still runs, and return whether it ended normally, with exit code 0."""
        if not self._reported and stop_process(self.process):
            self._reported = True
            self._notify(f"{ending(self._name, self.process)}: {self._loss}")
        return not self._reported


class Graph(AbstractContextManager["Graph"]):
    """The four nodes, in a process each, or composed in one.

    Use as a context manager: leaving it stops every process.

    Args:
        scene: name of a shipped scene, or path of a file.
        composed: run all nodes in one process.
        namespace: put all topics and nodes under this name.
        parameters: further parameters, ``node.parameter`` or just ``parameter`` for all nodes.
        environment: of the processes; this one's if left out.
        nodes: which of :data:`NODES`, and viewer or live page; all of NODES if left out. A live
            page has a process of its own, and its end is no failure of the graph. With several
            points to hold, ``point/node`` is the node of one point, ``node`` that of each.
        hold: operational points, each held by a device of its own; none: the scene's first one.
            With several, each has its device, analyser and controller in a namespace of its name;
            viewer and live page show all of them.
        arguments: further ROS arguments for all nodes.
        shown: whether the caller shows the nodes' last reports, by :meth:`endings`, so that the
            nodes do not print them.
    """

    # Holds the file with parameters of single nodes, if there are any.
    _folder: TemporaryDirectory[str] | None = None

    def __init__(
        self,
        scene: str,
        composed: bool = False,
        namespace: str = "",
        parameters: Mapping[str, object] | None = None,
        environment: Mapping[str, str] | None = None,
        nodes: Collection[str] = tuple(NODES),
        hold: Sequence[str] = (),
        arguments: Sequence[str] = (),
        shown: bool = False,
    ) -> None:
        self._environment = dict(os.environ if environment is None else environment)
        if shown:
            self._environment[SHOWN] = "1"
        self._readiness = Readiness()
        self._environment[ADDRESS] = self._readiness.address
        self._commands: dict[str, list[str]] = {}
        self.processes: dict[str, subprocess.Popen[str]] = {}
        compile_ahead()
        given = {"scene": scene, **(parameters or {})}
        of_all = {name: value for name, value in given.items() if "." not in name}
        of_nodes = {name: value for name, value in given.items() if "." in name}
        settings = self._parameter_file(of_nodes) if of_nodes else []
        try:
            for name, group, ros in _plan(of_all, namespace, composed, nodes, hold):
                command = [sys.executable, "-m", "hapticmech_ros.nodes.entry", group, *ros]
                self._commands[name] = [*command, *settings, *arguments]
                self.processes[name] = start_process(self._commands[name], self._environment)
        except BaseException:
            self.stop()
            raise

    def _parameter_file(self, parameters: Mapping[str, object]) -> list[str]:
        """Write a file with parameters of single nodes, and return the ROS arguments for it."""
        self._folder = TemporaryDirectory(prefix="hapticmech_ros_")
        file = Path(self._folder.name) / "parameters.yaml"
        file.write_text(parameter_file(parameters), encoding="utf-8")
        return ["--params-file", str(file)]

    def check(self) -> None:
        """Raise NodeDiedError if a process other than a live page has ended."""
        for name, process in self.processes.items():
            if name not in self.pages:
                check_running(name, process)

    @property
    def pages(self) -> dict[str, subprocess.Popen[str]]:
        """Processes that serve a live page, by name."""
        return {n: p for n, p in self.processes.items() if n.rpartition("/")[2] == PAGE}

    @property
    def notified(self) -> dict[str, str]:
        """Environment variables by which a process beside the graph reports that it is up."""
        return {ADDRESS: self._readiness.address}

    def is_up(self, process: subprocess.Popen[str]) -> bool:
        """Return whether a process has reported that it is up."""
        return process.pid in self._readiness.pids()

    def is_ready(self) -> bool:
        """Return whether all processes are up: nodes active, unless others manage their start."""
        return all(map(self.is_up, self.processes.values()))

    def reports(self) -> dict[str, Report]:
        """Return each node's last report, by its full name."""
        if self._readiness.is_open:
            self._readiness.pids()
        return dict(self._readiness.reports)

    def endings(self) -> dict[str, Report]:
        """Return each node's final report, sent when it ended, by its full name."""
        return dict(self._readiness.endings)

    def leave_share(self) -> bool:
        """Raise the nice value of threads below :data:`SHARING_NICE` to that one.

        Returns:
            Whether there were any, and so the nodes had more precedence over other programs.
        """
        had = False
        for process in self.processes.values():
            # A process that ends meanwhile has no threads any more.
            with suppress(OSError):
                for thread in Path(f"/proc/{process.pid}/task").iterdir():
                    if os.getpriority(os.PRIO_PROCESS, int(thread.name)) < SHARING_NICE:
                        os.setpriority(os.PRIO_PROCESS, int(thread.name), SHARING_NICE)
                        had = True
        return had

    def ended(self) -> list[str]:
        """Return the names of the processes that have ended."""
        return [name for name, process in self.processes.items() if process.poll() is not None]

    def respawn(self) -> list[str]:
        """Restart processes that have ended, and return a sentence on how each has ended.

        Raises:
            NodeDiedError: a process ended before it was ever up, and would again.
        """
        sentences, pids = [], self._readiness.pids()
        for name in self.ended():
            if self.processes[name].pid not in pids:
                check_running(name, self.processes[name])
            sentences.append(f"{ending(name, self.processes[name])}: it is started again")
            self.restart(name)
        return sentences

    def kill(self, name: str) -> None:
        """Kill a process by SIGKILL, as in a crash."""
        self.processes[name].kill()
        self.processes[name].wait()

    def restart(self, name: str) -> None:
        """Restart a process that has ended.

        Raises:
            InvalidInputError: it has not ended.
        """
        if self.processes[name].poll() is None:
            raise InvalidInputError("process", name, "must have ended before it is started again")
        # Read pending reports, to make room for those of the new process.
        self._readiness.pids()
        self.processes[name] = start_process(self._commands[name], self._environment)

    def stop(self) -> dict[str, int]:
        """End every process, SIGINT first, and return exit codes by name."""
        self.reports()  # Few fit into the socket at once: room for the last ones.
        codes = stop_processes(self.processes)
        if self._readiness.is_open:
            self._readiness.pids()
            self._readiness.close()
        if self._folder is not None:
            self._folder.cleanup()
        return codes

    def __exit__(self, *_: object) -> None:
        self.stop()


def parameter_file(parameters: Mapping[str, object]) -> str:
    """Return the text of a ROS parameter file that sets ``node.parameter`` in any namespace.

    ``-p node:parameter:=value`` only reaches a node without a namespace. A name that begins with a
    slash is the full name of one node.
    """
    nodes: dict[str, dict[str, dict[str, object]]] = {}
    for name, value in parameters.items():
        node, _, parameter = name.rpartition(".")
        whole = node if node.startswith("/") else f"/**/{node}"
        nodes.setdefault(whole, {"ros__parameters": {}})["ros__parameters"][parameter] = value
    return json.dumps(nodes)


def ros_arguments(
    parameters: Mapping[str, object],
    namespace: str = "",
    remaps: Mapping[str, str] | None = None,
) -> list[str]:
    """Return ``--ros-args`` that set parameters, a namespace, and remapped topics.

    Raises:
        InvalidInputError: the namespace is not valid in ROS.
    """
    if not _NAMESPACE.fullmatch(namespace):
        rule = "must be names of letters, digits and _ between slashes, none beginning with a digit"
        raise InvalidInputError("namespace", namespace, rule)
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        node, _, parameter = name.rpartition(".")
        # In YAML, an apostrophe in a single-quoted string is doubled.
        quoted = str(value).replace("'", "''")
        text = f"'{quoted}'" if isinstance(value, str) else str(value).lower()
        arguments += ["-p", f"{node + ':' if node else ''}{parameter}:={text}"]
    if namespace:
        arguments += ["-r", f"__ns:=/{namespace.strip('/')}"]
    for old, new in (remaps or {}).items():
        arguments += ["-r", f"{old}:={new}"]
    return arguments


def _plan(
    parameters: Mapping[str, object],
    namespace: str,
    composed: bool,
    nodes: Collection[str],
    hold: Sequence[str],
) -> Iterator[tuple[str, str, list[str]]]:
    """Yield each process's name, its nodes, comma-separated, and its ROS arguments."""
    if len(hold) < 2:
        chosen = {**parameters, **({"operational_point": hold[0]} if hold else {})}
        arguments = ros_arguments(chosen, namespace)
        for group in _groups(nodes, composed):
            yield group, group, arguments
        return
    held = {**parameters, "held_points": ",".join(hold)}
    # Nodes shared by all points.
    for name in (MECHANISM, VIEWER, PAGE):
        if name in nodes:
            yield name, name, ros_arguments(held, namespace)
    root = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
    for point in hold:
        shared = ("mechanism/state", f"mechanism/{point}/servo_cf")
        remaps = {name: f"{root}/{name}" for name in shared}
        chosen = {**parameters, "operational_point": point}
        arguments = ros_arguments(chosen, f"{root}/{point}", remaps)
        for group in _groups(_nodes_at(point, nodes), composed):
            yield f"{point}/{group}", group, arguments


def _nodes_at(point: str, nodes: Collection[str]) -> list[str]:
    """Return the nodes of one of several points: those named for it, and those for each point."""
    placed = [name.rpartition("/") for name in nodes if name not in (MECHANISM, VIEWER, PAGE)]
    return [node for where, _, node in placed if where in ("", point)]


def _groups(nodes: Collection[str], composed: bool) -> list[str]:
    """Return the nodes of each process, comma-separated; a live page has its own process."""
    together = [name for name in nodes if name != PAGE]
    apart = [name for name in nodes if name == PAGE]
    return [*([",".join(together)] if composed and together else together), *apart]


def start_process(
    command: Sequence[str], environment: Mapping[str, str], pipe_output: bool = False
) -> subprocess.Popen[str]:
    """Start a process that ends with this one, for whatever reason, and return it.

    ROS discovers it on this machine only, unless the environment sets a wider range.

    Raises:
        HapticMechError: there is no rclpy, or not the middleware that the environment selects.
    """
    chosen = dict(environment)
    choose_discovery(chosen)
    refuse_without_ros(chosen)
    return subprocess.Popen(
        list(command),
        env=chosen,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE if pipe_output else None,
        text=True,
        preexec_fn=_end_with_parent,
    )


def check_running(name: str, process: subprocess.Popen[str]) -> None:
    """Raise NodeDiedError if a process has ended.

    Raises:
        NodeDiedError: the process has ended.
    """
    if process.poll() is not None:
        raise NodeDiedError(ending(name, process))


def ending(name: str, process: subprocess.Popen[str]) -> str:
    """Return a sentence on how a process has ended: by exit code or signal."""
    code = process.wait()
    why = f"exit code {code}" if code >= 0 else f"signal {-code}"
    return f"{name} ended by itself: {why}"


def stop_process(process: subprocess.Popen[str]) -> int:
    """End a process: SIGINT, then SIGTERM, then SIGKILL; return its exit code."""
    return stop_processes({"": process})[""]


def stop_processes(processes: Mapping[str, subprocess.Popen[str]]) -> dict[str, int]:
    """End processes together, each as in :func:`stop_process`; return exit codes by name."""
    for process in processes.values():
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    return {name: _wait_for_end(process) for name, process in processes.items()}


def _wait_for_end(process: subprocess.Popen[str]) -> int:
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            return process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.send_signal(number)
    return process.wait()


def events_of(
    process: subprocess.Popen[str], patience_s: float | None = None
) -> Iterator[dict[str, Any]]:
    """Yield the events that a process prints as lines of JSON on its standard output.

    Args:
        process: with its output in a pipe.
        patience_s: time without output after which the event ``nothing`` is yielded, s.
    """
    lines: SimpleQueue[str | None] = SimpleQueue()

    def read() -> None:
        for line in process.stdout or ():
            lines.put(line)
        lines.put(None)

    threading.Thread(target=read, daemon=True).start()
    while True:
        try:
            line = lines.get(timeout=patience_s)
        except Empty:
            yield {"event": "nothing"}
            continue
        if line is None:
            return
        if line.startswith("{"):
            yield json.loads(line)


def private_environment(domain: int | None = None) -> dict[str, str]:
    """Return an environment for a separate ROS graph: on this machine, apart from other graphs.

    A Fast DDS profile chosen by the user is kept.

    Args:
        domain: ROS_DOMAIN_ID; if left out, the user's, or else one that is probably free.
    """
    environment = dict(os.environ)
    choose_discovery(environment, "localhost")
    guess = 1 + (os.getpid() + time.time_ns() // 1000) % 100
    environment.setdefault("ROS_DOMAIN_ID", str(guess))
    if domain is not None:
        environment["ROS_DOMAIN_ID"] = str(domain)
    return environment


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
