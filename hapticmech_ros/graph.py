"""The graph as processes: starts the nodes, watches them, and always ends them. Imports no ROS."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from types import TracebackType

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.share import shared

# A node answers a signal within its longest wait; what does not end by then is killed.
STOP_TIMEOUT_S = 5.0
_PR_SET_PDEATHSIG = 1


class NodeDiedError(HapticMechError):
    """A node's process ended by itself."""


class Graph:
    """The four nodes, in a process each, or composed in one.

    Use as a context manager: leaving it stops every process.

    Args:
        scene: name of a shipped scene, or path of a file.
        composed: run all nodes in one process.
        namespace: put all topics and nodes under this name.
        parameters: further parameters, ``node.parameter`` or just ``parameter`` for all nodes.
        environment: of the processes; this one's if left out.
    """

    def __init__(
        self,
        scene: str,
        composed: bool = False,
        namespace: str = "",
        parameters: Mapping[str, object] | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self._environment = dict(os.environ if environment is None else environment)
        arguments = ros_arguments({"scene": scene, **(parameters or {})}, namespace)
        groups = [",".join(NODES)] if composed else list(NODES)
        self.processes: dict[str, subprocess.Popen[str]] = {}
        try:
            for group in groups:
                command = [sys.executable, "-m", "hapticmech_ros.nodes.entry", group, *arguments]
                self.processes[group] = start_process(command, self._environment)
        except BaseException:
            self.stop()
            raise

    def check(self) -> None:
        """Raise NodeDiedError if a node has ended."""
        for name, process in self.processes.items():
            code = process.poll()
            if code is not None:
                raise NodeDiedError(f"{name} ended by itself with exit code {code}")

    def stop(self) -> dict[str, int]:
        """End every process, SIGINT first, and return exit codes by name."""
        return {name: stop_process(process) for name, process in self.processes.items()}

    def __enter__(self) -> Graph:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        # All are asked first, so that they end together.
        for process in self.processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        self.stop()


def ros_arguments(parameters: Mapping[str, object], namespace: str = "") -> list[str]:
    """Return ``--ros-args`` that set parameters and a namespace."""
    arguments = ["--ros-args"]
    for name, value in parameters.items():
        node, _, parameter = name.rpartition(".")
        text = f"'{value}'" if isinstance(value, str) else str(value).lower()
        arguments += ["-p", f"{node + ':' if node else ''}{parameter}:={text}"]
    if namespace:
        arguments += ["-r", f"__ns:=/{namespace.strip('/')}"]
    return arguments


def start_process(
    command: Sequence[str], environment: Mapping[str, str], pipe_output: bool = False
) -> subprocess.Popen[str]:
    """Start a process that ends with this one, whatever ends this one."""
    return subprocess.Popen(
        list(command),
        env=dict(environment),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE if pipe_output else None,
        text=True,
        preexec_fn=_end_with_parent,
    )


def stop_process(process: subprocess.Popen[str]) -> int:
    """End a process: SIGINT, then SIGTERM, then SIGKILL; return its exit code."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        if process.poll() is None:
            process.send_signal(number)
        try:
            return process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            continue
    return process.wait()


def private_environment(domain: int | None = None) -> dict[str, str]:
    """Return an environment for a ROS graph of its own: on this machine, away from other graphs.

    Fast DDS then talks UDP over loopback, unless the user has chosen profiles of his own.

    Args:
        domain: ROS_DOMAIN_ID; if left out, the user's, or else one that is probably free.
    """
    environment = dict(os.environ)
    profiles = shared("config/dds/loopback_udp.xml")
    if profiles is not None:
        environment.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(profiles))
    guess = 1 + (os.getpid() + time.time_ns() // 1000) % 100
    environment.setdefault("ROS_DOMAIN_ID", str(guess))
    if domain is not None:
        environment["ROS_DOMAIN_ID"] = str(domain)
    return environment


def _end_with_parent() -> None:
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
