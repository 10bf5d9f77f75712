# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is felt through the driver of an Inverse3, and how soon a force ends when something dies.

The device is the emulator's, and so is the time after which it idles without messages: what a real
one does is not measured here.
"""

from __future__ import annotations

import json
import random
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import typer

from benchmarks.children import ReportingProcess, finding_benchmarks, wait_until
from benchmarks.haply.emulated import Emulator, Trace
from benchmarks.machine import MachineResults, machine
from benchmarks.push import WAY, time_alone
from benchmarks.reliability.sample import DEVICE as WATCHED
from benchmarks.reliability.sample import Ring
from hapticmech_ros import load_scene
from hapticmech_ros.analysis.study import Sheet, Show, silent
from hapticmech_ros.cli.console import OutOption
from hapticmech_ros.cli.graph import nodes_of
from hapticmech_ros.cli.study import JsonOption, carry_out
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.graph.processes import Graph, private_environment
from hapticmech_ros.haply.emulator import EmulatedInverse3, spoilt
from hapticmech_ros.haply.messages import cursor_of, found_in, parsed
from hapticmech_ros.loading.loader import copy_scene
from hapticmech_ros.numerics.times import NANOSECONDS

DRIVER, CONTROLLER, SERVICE = "haply_device", "teleoperation_controller", "service"
VICTIMS = (DRIVER, CONTROLLER, SERVICE)
NODES = nodes_of((), {"": "haply"})
# Limits: s until there is no force; s that a graph or a hand may take.
MOST_S, PATIENCE_S = 0.020, 30.0
# A force that counts as one, N; and one that is waited for before something dies.
NONE_N, FELT_N = 1e-9, 0.1
# A firm arm that swings the device to and fro, so that there is a force whenever something dies.
SWINGING = (
    "hand={kind: arm, impedance: firm, start_delay: 0.5, waypoints: [{time: 0.0}], "
    "tremor: {frequency: 1.0, xyz: [0.01, 0.0, 0.0]}}"
)
# What a scene's mechanism is pushed with, N, and along which unit vector (that of the circle of the
# door's knob).
PUSH_N, PUSH_AFTER_S = 1.0, 2.0
PUSHED = {"five_bar": (-1.0, 0.0, 0.0), "door": (-0.1739, 0.9848, 0.0)}
# Of these the emulated device is one, for what is felt.
DEVICES = {
    "as assumed": "{preset: inverse3}",
    "no friction": "{preset: inverse3, coulomb_friction: 0.0, actuator_bandwidth: 0.0}",
}
WATCH = [sys.executable, "-m", "benchmarks.reliability.watch"]


@dataclass(frozen=True)
class Felt:
    """A push through the emulated device.

    Attributes:
        scene: that was felt.
        device: what the emulated device is.
        ratio: felt inertia over that of device-free mechanism along the push.
    """

    scene: str
    device: str
    ratio: float


@dataclass(frozen=True)
class HaplyResults(MachineResults):
    """What was measured.

    Attributes:
        ends: s from a kill until there is no force any more, of each trial, by who was killed.
        frames: that were spoilt and read.
        escaped: of these, that led to another error than a refusal, or to a number beyond limits.
        rate: samples per s that the driver took.
        felt: through the emulated device.
    """

    NAME: ClassVar[str] = "bench_haply"
    FAULT: ClassVar[str] = "a limit was missed"

    ends: Mapping[str, Sequence[float]]
    frames: int
    escaped: int
    rate: float
    felt: tuple[Felt, ...]

    @property
    def sound(self) -> bool:
        """Whether every force ended in time, and nothing escaped."""
        return not self.escaped and all(max(of) <= MOST_S for of in self.ends.values())

    def sheets(self) -> Iterator[Sheet]:
        """Yield the ends of forces, and what was felt."""
        rows = []
        for victim, found in self.ends.items():
            p50, p99 = (f"{1e3 * np.percentile(found, q):.1f}" for q in (50, 99))
            late = sum(one > MOST_S for one in found)
            rows.append((victim, str(len(found)), p50, p99, f"{1e3 * max(found):.1f}", str(late)))
        yield Sheet(
            "time without force after kill -9",
            ("killed", "trials", "p50, ms", "p99, ms", "worst, ms", f"above {1e3 * MOST_S:.0f} ms"),
            tuple(rows),
            caption=f"{self.escaped} of {self.frames} spoilt frames escaped; "
            f"{self.rate:.1f} samples/s at 1 kHz",
        )
        yield Sheet(
            "felt inertia over the mechanism's own",
            ("scene", "emulated device", "ratio"),
            tuple((one.scene, one.device, f"{one.ratio:.3f}") for one in self.felt),
        )


class _Rig:
    """A graph with the driver, an emulated service, and a watcher of the driver's samples."""

    def __init__(self, scene: Path, folder: Path, domain: int) -> None:
        self._scene, self._folder, self._number = scene, folder, 0
        self.emulator, self.trace = self._serve(0)
        environment = finding_benchmarks(private_environment(domain))
        parameters = {f"{DRIVER}.uri": self.emulator.uri}
        self.graph = Graph(str(scene), nodes=NODES, parameters=parameters, environment=environment)
        self.ring = Ring(folder / "ring", fresh=True)
        self._watch = ReportingProcess([*WATCH, str(folder / "ring")], environment)

    def _serve(self, port: int) -> tuple[Emulator, Trace]:
        self._number += 1
        path = self._folder / f"{self._scene.stem}_{self._number}.csv"
        return Emulator("--scene", str(self._scene), "--trace", str(path), port=port), Trace(path)

    def renew_service(self) -> None:
        """Serve again where the last service did."""
        self.emulator, self.trace = self._serve(self.emulator.port)

    def wait_for_force(self) -> None:
        """Wait until the device has rendered for a while and gives a force.

        Raises:
            BenchError: it does not.
        """
        since = time.monotonic()

        def given() -> bool:
            times, forces = self.trace.force_since(since)
            lasting = len(times) > 700 and (forces[-500:] > NONE_N).all()
            return bool(lasting and forces[-5:].min() > FELT_N)

        wait_until(given, PATIENCE_S, "a force through the driver", look_again_s=0.05)

    def close(self) -> None:
        self._watch.stop()
        self.graph.stop()
        self.emulator.close()


def _ends(rig: _Rig, victim: str) -> float:
    """Kill somebody, and return how long there was a force, s; start him again."""
    rig.wait_for_force()
    if victim == SERVICE:
        before, killed_ns = rig.ring.count, time.time_ns()
        rig.emulator.kill()
        time.sleep(0.3)
        # Its device has gone with it: what counts is what the driver tells.
        found = rig.ring.since(before)
        told_ns = found["stamp_ns"][found["force"] > NONE_N].max(initial=killed_ns)
        rig.renew_service()
        return float(told_ns - killed_ns) / NANOSECONDS
    killed = time.monotonic()
    rig.graph.kill(victim)
    time.sleep(0.3)
    times, forces = rig.trace.force_since(killed)
    given = times[forces > NONE_N]
    rig.graph.restart(victim)
    return float(given[-1] - killed) if len(given) else 0.0


def _escaped(frames: int) -> int:
    """Return how many of so many spoilt frames were neither understood nor refused."""
    scene = load_scene("five_bar").with_(device={"preset": "inverse3"})
    device = EmulatedInverse3(scene, np.eye(3))
    status = dict.fromkeys(("calibrated", "power_supply", "ready", "started"), True)
    one = {"device_id": "A", "state": device.state(), "status": status, "config": {}}
    grip = {"device_id": "B", "state": {"orientation": device.orientation()}}
    text = json.dumps({"inverse3": [one], "wireless_verse_grip": [grip]})
    chance, escaped = random.Random(1), 0
    for _ in range(frames):
        try:
            frame = parsed(spoilt(text, chance))
            found_in(frame, "")
            cursor = cursor_of(frame, "A")
            within = cursor is None or (
                np.abs(cursor.position).max() <= 1.0 and np.abs(cursor.velocity).max() <= 20.0
            )
            escaped += not within
        except HapticMechError:
            pass
        except Exception:  # noqa: BLE001 - what is looked for
            escaped += 1
    return escaped


def _felt(scene: str, device: str, label: str, folder: Path, domain: int) -> Felt:
    """Push a scene through the emulated device, and return what is felt."""
    push = PUSH_N * np.array(PUSHED[scene])
    alone = time_alone(scene, np.append(push, np.zeros(3)))
    numbers = ", ".join(f"{value:.6f}" for value in push)
    hand = f"hand={{kind: constant_wrench, force: [{numbers}], start_delay: {PUSH_AFTER_S}}}"
    path = folder / f"{scene}_{label.replace(' ', '_')}.yaml"
    copy_scene(scene, path, [f"device={device}", hand, "task=position"])
    with closing(_Rig(path, folder, domain)) as rig:

        def took() -> float:
            """Return how long the push took for the way, s; zero as long as it has not."""
            found = rig.trace.look()
            pushed = found[np.linalg.norm(found[:, 7:10], axis=1) > 0.5 * PUSH_N]
            moved = (pushed[:, 1:4] - pushed[:1, 1:4]) @ push / PUSH_N
            there = pushed[moved >= WAY, 0]
            return float(there[0] - pushed[0, 0]) if there.size else 0.0

        what = f"{scene} to move by {WAY:g} m through the driver"
        taken = wait_until(took, PATIENCE_S, what, look_again_s=0.05)
    return Felt(scene, label, (taken / alone) ** 2)


def run_benchmark(kills: int, frames: int, show: Show = silent, domain: int = 87) -> HaplyResults:
    """Kill, spoil and push.

    Args:
        kills: of driver, controller and service, each.
        frames: to spoil.
        show: called with what was done.
        domain: of ROS.
    """
    escaped = _escaped(frames)
    show(f"{frames} frames read")
    ends: dict[str, list[float]] = {victim: [] for victim in VICTIMS}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene = folder / "five_bar_haply.yaml"
        copy_scene("five_bar", scene, ["device={preset: inverse3}", "task=position", SWINGING])
        with closing(_Rig(scene, folder, domain)) as rig:
            rig.wait_for_force()
            before, begun = rig.ring.count, time.monotonic()
            time.sleep(5.0)
            received = rig.ring.since(before)["topic"] == WATCHED
            rate = float(received.sum()) / (time.monotonic() - begun)
            show(f"{rate:.1f} samples/s")
            for number in range(kills):
                for victim in VICTIMS:
                    ends[victim].append(_ends(rig, victim))
                    show(f"{number}: {victim} {1e3 * ends[victim][-1]:.1f} ms")
        felt = tuple(
            _felt(one, device, label, folder, domain)
            for one in PUSHED
            for label, device in DEVICES.items()
        )
    return HaplyResults(machine(), ends, frames, escaped, rate, felt)


def haply(
    kills: Annotated[int, typer.Option(min=1, help="of driver, controller and service")] = 100,
    frames: Annotated[int, typer.Option(min=1, help="to spoil and read")] = 100_000,
    quick: Annotated[bool, typer.Option(help="two kills of each, 5,000 frames")] = False,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Kill what stands behind a Haply Inverse3, spoil its frames, and push scenes through it."""
    if quick:
        kills, frames = 2, 5_000
    carry_out(lambda show: run_benchmark(kills, frames, show), out, json_only)
