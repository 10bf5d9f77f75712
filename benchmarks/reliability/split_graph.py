# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A graph on both sides of an emulated network, and what its devices went through."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path as FilePath
from types import MappingProxyType

import numpy as np
import psutil
from numpy.typing import NDArray

from benchmarks.children import ReportingProcess, finding_benchmarks, output_to, wait_until
from benchmarks.reliability.emulated_network import DEVICE, REST, EmulatedNetwork
from hapticmech_ros.graph.processes import (
    private_environment,
    ros_arguments,
    start_process,
    stop_processes,
)
from hapticmech_ros.wire.messages import DeviceStateMessage

Array = NDArray[np.float64]
START_TIMEOUT_S = 60.0
_WATCH = (sys.executable, "-m", "benchmarks.reliability.device_watch")
NODE = (sys.executable, "-m", "hapticmech_ros.nodes.entry")
_RUN = (sys.executable, "-m", "hapticmech_ros", "run")
_NOT_DEVICE = ("mechanism_simulator", "nullspace_analyser", "teleoperation_controller")
_AT = {name: DeviceStateMessage.layout.slice(name) for name in DeviceStateMessage.layout}


@dataclass(frozen=True)
class Watched:
    """What a device went through.

    Attributes:
        time: (n,) of its samples, s of the machine's clock.
        position: (n, 3) that it measured, m.
        force: (n,) size of what its actuators applied, N.
        obeys: (n,) whether the device obeyed servo_cf.
        round_trip: (n,) s, as the device told it.
        from_hand: (m,) E_h at view rate, J, with energies' times ``energy_time`` (m,).
        dissipated: (m,) J, by passivity control.
        to_mechanism: (m,) E_m, J.
        reports: what each process printed at the end.
        said: last diagnostics.
    """

    time: Array
    position: Array
    force: Array
    obeys: NDArray[np.bool_]
    round_trip: Array
    energy_time: Array
    from_hand: Array
    to_mechanism: Array
    dissipated: Array
    reports: Mapping[str, str]
    said: tuple[str, ...]

    def figure(self, node: str, name: str) -> str:
        """Return a figure of a node's last report."""
        told = "\n".join(self.reports.values())
        found = re.search(rf"^{node}: .*?[;,] {name} ([^,\n]*)", told, re.MULTILINE)
        return found[1] if found else ""

    def engaged(self) -> float:
        """Return for which share of the samples the device obeyed, from the first on."""
        first = int(np.argmax(self.obeys)) if self.obeys.any() else 0
        return float(np.mean(self.obeys[first:]))

    def zero_after(self, start: float, stop: float) -> float:
        """Return how long (s) after a time the last force left, before another time (s)."""
        pushed = (self.time < stop) & (self.force > 0.0)
        return float(self.time[pushed].max() - start) if pushed.any() else 0.0

    def back_after(self, start: float) -> float:
        """Return how long (s) after a time (s) the device renders; infinite if it does not."""
        renders = (self.time > start) & self.obeys & (self.force > 0.0)
        return float(self.time[renders].min() - start) if renders.any() else np.inf


# Processes by name: on which side, and by which command.
Processes = Mapping[str, tuple[str, Sequence[str]]]


def of_one_user(
    scene: str = "five_bar",
    parameters: Mapping[str, object] | None = None,
    device: Sequence[str] = NODE,
) -> Processes:
    """Return the device on one side, and the rest of the graph, composed, on the other.

    Args:
        scene: name or path.
        parameters: ``node.parameter`` or ``parameter``, of all nodes.
        device: how the device's process is started, before its arguments.
    """
    given = ros_arguments({"scene": scene, **(parameters or {})})
    return {
        "rest": (REST, [*NODE, ",".join(_NOT_DEVICE), *given]),
        "device": (DEVICE, [*device, "haptic_device", *given]),
    }


def of_two_users(
    scene: str, near: str, far: str, settings: Mapping[str, object] = MappingProxyType({})
) -> Processes:
    """Return one user's device on one side, and the other one's, with all else, on the other.

    By the commands of docs/network.md; a node that ends is started again.

    Args:
        scene: path of a scene with ``hands``.
        near: point of the user beside the mechanism.
        far: point of the user on the other side.
        settings: ``node.parameter`` or ``parameter``, of all nodes.
    """
    near_nodes = [word for name in (near, *_NOT_DEVICE) for word in ("--only", name)]
    given = [word for name, value in settings.items() for word in ("--set", f"{name}={value}")]
    run = [*_RUN, scene, "--respawn", *given]
    return {
        "rest": (REST, [*run, "--composed", *near_nodes]),
        "device": (DEVICE, [*run, "--only", f"{far}/haptic_device"]),
    }


class SplitGraph(AbstractContextManager["SplitGraph"]):
    """A graph of which a part runs in one namespace, and the rest in the other.

    Args:
        network: between them.
        folder: for logs and what was watched.
        processes: of the graph.
        domain: ROS_DOMAIN_ID.
        watched: namespaces of the devices, by the side where each is.
    """

    def __init__(
        self,
        network: EmulatedNetwork,
        folder: FilePath,
        processes: Processes,
        domain: int = 7,
        watched: Mapping[str, str] = MappingProxyType({"": DEVICE}),
    ) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        self._files = {name: folder / f"watch_{name}.npz" for name in watched}
        self._processes: dict[str, subprocess.Popen[str]] = {}
        self._watchers: dict[str, ReportingProcess] = {}
        environment = finding_benchmarks(private_environment(domain))
        # Namespaces are hosts: nothing of loopback only, and no network but the emulated one.
        environment.pop("FASTRTPS_DEFAULT_PROFILES_FILE", None)
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
        # rclpy and transports as the nodes have them.
        beside = {**environment, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
        with ExitStack() as stack:
            stack.callback(stop_processes, self._processes)
            # They end first.
            for name, side in watched.items():
                command = network.command(side, [*_WATCH, str(self._files[name]), name])
                self._watchers[name] = stack.enter_context(ReportingProcess(command, beside))
            for name, (side, words) in processes.items():
                self._log(name).unlink(missing_ok=True)
                with output_to(self._log(name)):
                    started = start_process(network.command(side, words), environment)
                self._processes[name] = started
            self._stack = stack.pop_all()

    def _log(self, name: str) -> FilePath:
        return self._folder / f"{name}.log"

    def wait(self) -> float:
        """Wait until the devices say that they render, from now on; return the time.

        Raises:
            BenchError: one does not.
        """
        # Each says so again with all diagnostics.
        said = [(one, len(one.of("rendering"))) for one in self._watchers.values()]

        def rendering() -> bool:
            for one, _ in said:
                one.check()
            return all(len(one.of("rendering")) > before for one, before in said)

        wait_until(rendering, START_TIMEOUT_S, "the devices to render")
        return time.time()

    def kill_nodes(self, name: str) -> float:
        """End what a process has started as crashes would; return when, s of the clock.

        Raises:
            RuntimeError: it has started nothing.
        """
        if not (started := psutil.Process(self._processes[name].pid).children()):
            raise RuntimeError(f"{name} has started nothing")
        for process in started:
            process.kill()
        return time.time()

    def stop(self) -> None:
        """End every process, those that watch first."""
        self._stack.close()

    def watched(self) -> dict[str, Watched]:
        """End all, and return what the devices went through, by their namespaces.

        Raises:
            RuntimeError: a process had ended by itself.
        """
        started = {**self._processes, **{n: one.process for n, one in self._watchers.items()}}
        ended = [name for name, process in started.items() if process.poll() is not None]
        self.stop()
        if ended:
            raise RuntimeError(f"{', '.join(ended)} ended by themselves: see {self._folder}")
        return {name: self._read(file) for name, file in self._files.items()}

    def _read(self, file: FilePath) -> Watched:
        with np.load(file) as found:
            states, energies, said = found["states"], found["energies"], found["said"]
        return Watched(
            states[:, 0] + 1e-9 * states[:, 1],
            states[:, _AT["position"]],
            np.linalg.norm(states[:, _AT["applied"]][:, :3], axis=1),
            states[:, _AT["obeys"]][:, 0] != 0.0,
            states[:, _AT["round_trip"]][:, 0],
            energies[:, 0] + 1e-9 * energies[:, 1],
            energies[:, 2],
            energies[:, 4],
            energies[:, 6],
            {name: self._log(name).read_text("utf-8") for name in self._processes},
            tuple(str(text) for text in said),
        )

    def __exit__(self, *error: object) -> None:
        self.stop()


def run_for(
    graph: SplitGraph, seconds: float, events: Sequence[tuple[float, Callable[[], float]]] = ()
) -> list[float]:
    """Let a graph run once it renders; return the times (s) that the events return.

    Args:
        graph: started.
        seconds: s, from rendering on.
        events: what to do, which returns when it was done, and when, s from rendering on.
    """
    start, made = graph.wait(), []
    for at, event in sorted(events, key=lambda pair: pair[0]):
        time.sleep(max(start + at - time.time(), 0.0))
        made.append(event())
    time.sleep(max(start + seconds - time.time(), 0.0))
    return made
