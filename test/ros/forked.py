# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processes of tests, forked from one that has imported what nodes need.

A node takes half a second of a processor to import its libraries and kernels, and tests start
hundreds. Here one process for each worker imports them once, without rclpy and without a thread of
its own, and forks for each node: what runs is a process of its own, with its own arguments,
environment, signals and exit code, as after ``exec``. How processes begin is tested elsewhere, by
executables and commands that are started as people start them.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import runpy
import selectors
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TextIO

from hapticmech_ros.graph.processes import _end_with_parent, start_process
from hapticmech_ros.system.discovery import choose_discovery

# Bytes of a request: arguments and an environment.
_LARGEST = 1 << 17
NODES = "hapticmech_ros.nodes.entry"
# All that nodes import except rclpy, which starts threads as it is imported.
IMPORTED = ("control", "device", "loading", "operational", "robot", "simulation")

# What a process reads once, as it begins: where packages and libraries are, and what comes first.
AT_THE_BEGINNING = ("PYTHON", "LD_", "AMENT_")


class Forked:
    """A forked process; as ``subprocess.Popen``.

    Args:
        origin: that has forked it.
        pid: its id.
        command: that it runs.
        output: what it writes, if that is piped.
    """

    def __init__(
        self, origin: Origin, pid: int, command: Sequence[str], output: TextIO | None
    ) -> None:
        self._origin = origin
        self.pid, self.args, self.stdout = pid, list(command), output
        self.returncode: int | None = None

    def poll(self) -> int | None:
        return self._look(0.0)

    def wait(self, timeout: float | None = None) -> int:
        found = self._look(timeout)
        if found is None:
            raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        return found

    def _look(self, timeout: float | None) -> int | None:
        if self.returncode is None:
            self.returncode = self._origin.code_of(self.pid, timeout)
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class Origin:
    """The process that forks, from the side of a test."""

    def __init__(self) -> None:
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        os.set_inheritable(theirs.fileno(), True)
        # Before NumPy is there, as nodes do.
        self._environment = dict(os.environ)
        as_nodes = {"OPENBLAS_NUM_THREADS": "1", "PYDANTIC_DISABLE_PLUGINS": "__all__"}
        self._process = subprocess.Popen(
            [sys.executable, __file__, str(theirs.fileno())],
            env=self._environment | as_nodes,
            stdin=subprocess.DEVNULL,
            close_fds=True,
            pass_fds=(theirs.fileno(),),
            preexec_fn=_end_with_parent,
        )
        theirs.close()
        self._codes: dict[int, int] = {}

    def begins_as(self, environment: Mapping[str, str]) -> bool:
        """Return whether a process with an environment would begin as this one did."""
        return _read_first(environment) == _read_first(self._environment)

    def fork(
        self, command: Sequence[str], environment: Mapping[str, str], pipe_output: bool
    ) -> Forked:
        """Start ``python -m MODULE ARGUMENTS`` in a process of its own."""
        request = {
            "arguments": command[2:],
            "environment": dict(environment),
            "cwd": str(Path.cwd()),
        }
        reader, writer = os.pipe() if pipe_output else (-1, 1)
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        socket.send_fds(self._channel, [json.dumps(request).encode()], [writer, 2])
        output = None
        if pipe_output:
            os.close(writer)
            output = os.fdopen(reader, encoding="utf-8")
        while "begun" not in (told := self._receive()):
            self._codes[told["pid"]] = told["code"]
        # The system gives a number again after a while.
        self._codes.pop(told["begun"], None)
        return Forked(self, told["begun"], command, output)

    def code_of(self, pid: int, timeout: float | None) -> int | None:
        """Return the exit code of a process, within a time (s); None while it runs."""
        end = None if timeout is None else time.monotonic() + timeout
        while pid not in self._codes:
            left = None if end is None else max(0.0, end - time.monotonic())
            self._channel.settimeout(left)
            try:
                told = self._receive()
            except (BlockingIOError, TimeoutError):
                return None
            finally:
                self._channel.settimeout(None)
            self._codes[told["pid"]] = told["code"]
        return self._codes[pid]

    def _receive(self) -> dict[str, int]:
        told = self._channel.recv(_LARGEST)
        if not told:
            raise RuntimeError("the process that forks has ended")
        found: dict[str, int] = json.loads(told)
        return found


def _read_first(environment: Mapping[str, str]) -> dict[str, str]:
    return {k: value for k, value in environment.items() if k.startswith(AT_THE_BEGINNING)}


@cache
def _origin() -> Origin:
    return Origin()


def start(command: Sequence[str], environment: Mapping[str, str], pipe_output: bool = False) -> Any:
    """Start a process; as ``graph.start_process``, but forked where it runs nodes."""
    runs_nodes = list(command[:3]) == [sys.executable, "-m", NODES]
    if not runs_nodes or not _origin().begins_as(environment):
        return start_process(command, environment, pipe_output)
    chosen = dict(environment)
    choose_discovery(chosen)
    return _origin().fork(command, chosen, pipe_output)


def _serve(channel: socket.socket) -> list[str]:
    """Fork for each request until the channel closes; return what to run, in each child."""
    for name in IMPORTED:
        importlib.import_module(f"hapticmech_ros.{name}")
    if len(list(Path("/proc/self/task").iterdir())) != 1:
        raise RuntimeError("there is a thread, which would be missing after a fork")
    # A signal that comes while Python forks would be lost if Python were to handle it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    gc.collect()
    gc.freeze()
    with selectors.DefaultSelector() as selector:
        selector.register(channel, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                if key.fileobj is not channel:
                    _, status = os.waitpid(key.data, 0)
                    selector.unregister(key.fileobj)
                    os.close(key.fd)
                    code = os.waitstatus_to_exitcode(status)
                    channel.send(json.dumps({"pid": key.data, "code": code}).encode())
                    continue
                told, outputs, _, _ = socket.recv_fds(channel, _LARGEST, 2)
                if not told:
                    sys.exit()
                parent, request = os.getpid(), json.loads(told)
                pid = os.fork()
                if not pid:
                    channel.close()
                    for other in list(selector.get_map().values()):
                        if other.fileobj is not channel:
                            os.close(other.fd)
                    _begin(request, outputs, parent)
                    return list(request["arguments"])
                for output in outputs:
                    os.close(output)
                selector.register(os.pidfd_open(pid), selectors.EVENT_READ, pid)
                channel.send(json.dumps({"begun": pid}).encode())


def _begin(request: Mapping[str, Any], outputs: Sequence[int], parent: int) -> None:
    """Become what was asked for, up to what it runs."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    _end_with_parent()
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)
    os.environ.clear()
    os.environ.update(request["environment"])
    os.chdir(request["cwd"])
    for number, output in enumerate(outputs, 1):
        os.dup2(output, number)
        os.close(output)


if __name__ == "__main__":
    # This file's folder is no place to import from.
    del sys.path[0]
    module, *arguments = _serve(socket.socket(fileno=int(sys.argv[1])))
    sys.argv[1:] = arguments
    runpy.run_module(module, run_name="__main__", alter_sys=True)
