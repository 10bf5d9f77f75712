# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m benchmarks.drivers``: what is felt through drivers that speak CRTK only.

A hand pushes a body that a driver simulates, and that knows of the graph what a driver knows. The
mechanism, its analyser and the controller are the nodes' own, in simulated time and without a
middleware: no delay but that of the driver's samples.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import typer
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.serialization import serialize_message

from benchmarks.push import LONGEST_S, WAY, time_alone
from benchmarks.reliability.fake_graph import ACTORS, FakeGraph
from hapticmech_ros import Simulator, load_scene
from hapticmech_ros.analysis.study import Sheet
from hapticmech_ros.cli import run_app
from hapticmech_ros.loading.loader import copy_scene
from hapticmech_ros.nodes.messages import set_stamp, wrench_message, write_pose
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import turned
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import OperationalModelMessage
from hapticmech_ros.wire.wrench import decode_wrench

SCENE = "five_bar"
PUSH = np.array([-0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
FREE = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Kind:
    """A driver.

    Attributes:
        name: of the kind.
        says: its topics besides ``measured_cp``.
        sensor: ``force_sensor`` of the scene.
        rate: of its samples, Hz.
        turn: of its axes about z, rad; it then takes and tells wrenches in these.
    """

    name: str
    says: tuple[str, ...]
    sensor: str = "estimated"
    rate: float = 1000.0
    turn: float = 0.0


_BOTH = ("measured_cv", "measured_cf")
KINDS = (
    Kind("with a force sensor", (*_BOTH, "hand/measured_cf"), "measured"),
    Kind("without a force sensor", _BOTH),
    Kind("without `measured_cf`", ("measured_cv",)),
    Kind("poses only", ()),
    Kind("`body/` only", ("measured_cv", "body/measured_cf"), turn=2.0),
    Kind("at 200 Hz", _BOTH, rate=200.0),
    Kind("at 200 Hz, without `measured_cf`", ("measured_cv",), rate=200.0),
    Kind("the hand unknown", _BOTH, "absent"),
)


@dataclass(frozen=True)
class Felt:
    """What was felt through a driver.

    Attributes:
        kind: name of the driver's kind.
        engaged_after: time from the first pose to the first command, s.
        drift: way of the device in a second in which nobody pushes, m.
        inertia: felt, relative to the mechanism's own along the push.
        apart: largest distance of device and operational point during the push, m.
    """

    kind: str
    engaged_after: float
    drift: float
    inertia: float
    apart: float


class Body:
    """The device that a driver drives.

    Args:
        mass: (6,) kg and kg m².
        pose: at the start, at rest.
        period: of a step, s.
    """

    def __init__(self, mass: Array, pose: pin.SE3, period: float) -> None:
        self.pose, self.twist, self._mass, self._period = pose, np.zeros(6), mass, period

    def step(self, wrench: Array) -> None:
        """Move on by a step under a wrench (6,), N and N m, world axes."""
        self.twist = self.twist + self._period * FREE * wrench / self._mass
        rotation = pin.exp3(self._period * self.twist[3:]) @ self.pose.rotation
        self.pose = pin.SE3(rotation, self.pose.translation + self._period * self.twist[:3])


def felt(kind: Kind) -> Felt:
    """Push through a driver of a kind, and return what was felt."""
    axes = "body" if kind.turn else "world"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.yaml"
        copy_scene(SCENE, path, [f"device.force_sensor={kind.sensor}", f"device.servo_axes={axes}"])
        graph = FakeGraph(str(path), actors=ACTORS[1:4])
    return _Trial(graph, kind).run()


class _Trial:
    """A driver of a kind at a graph."""

    def __init__(self, graph: FakeGraph, kind: Kind) -> None:
        self._graph, self._kind = graph, kind
        scene = load_scene(SCENE)
        self._period = scene.simulation.period
        simulator = Simulator(scene)
        self._point = scene.operational_points[0].name
        pose = simulator.mechanism.frame_pose(simulator.initial_state().q, self._point)
        pose.rotation = pose.rotation @ pin.exp3(np.array((0.0, 0.0, kind.turn)))
        mass = np.array([scene.device.mass] * 3 + [scene.device.inertia] * 3)
        self._body = Body(mass, pose, self._period)
        self._began = pose.translation.copy()
        self._ticks = 0
        self._told = np.zeros(6)

    def run(self) -> Felt:
        graph = self._graph
        while "/device/servo_cf" not in graph.last and self._time < LONGEST_S:
            self._go_on(np.zeros(6))
        engaged = self._time
        for _ in range(round(1.0 / self._period)):
            self._go_on(np.zeros(6))
        drift = float(np.linalg.norm(self._body.pose.translation - self._began))
        start, since, apart = self._body.pose.translation[0], self._time, 0.0
        while start - self._body.pose.translation[0] < WAY and self._time < since + LONGEST_S:
            self._go_on(PUSH)
            told = decode(graph.last[f"/analysis/{self._point}/operational_model"])
            place = told[OperationalModelMessage.layout.slice("position")]
            away = place - self._body.pose.translation
            apart = max(apart, float(np.linalg.norm(away[:2])))
        ratio = (self._time - since) / time_alone(SCENE, PUSH)
        return Felt(self._kind.name, engaged, drift, ratio**2, apart)

    @property
    def _time(self) -> float:
        return self._ticks * self._period

    def _go_on(self, push: Array) -> None:
        """Tell a sample if one is due, let the graph answer, and move on."""
        if self._ticks % round(1.0 / (self._kind.rate * self._period)) == 0:
            self._tell(push)
        self._graph.tick()
        self._graph.tick()
        self._ticks += 1
        self._told = self._commanded()
        self._body.step(push + self._told)

    def _commanded(self) -> Array:
        """Return the wrench that the driver was commanded last (6,), world axes."""
        own = bool(self._kind.turn)
        message = self._graph.last.get("/device/body/servo_cf" if own else "/device/servo_cf")
        if message is None:
            return np.zeros(6)
        data = message if isinstance(message, bytes) else serialize_message(message)
        wrench = decode_wrench(data).values
        return turned(wrench, self._body.pose.rotation) if own else wrench

    def _tell(self, push: Array) -> None:
        """Say where the body is, last, and what else the driver says."""
        now, pose = self._graph.now_ns, self._body.pose
        own = turned(self._told, pose.rotation.T)
        values = {"measured_cf": self._told, "body/measured_cf": own, "hand/measured_cf": push}
        for name in self._kind.says:
            if name == "measured_cv":
                self._put(name, self._twist(now))
                continue
            self._put(name, wrench_message(values[name], now))
        place = PoseStamped()
        write_pose(place, pose, now)
        self._put("measured_cp", place)

    def _twist(self, now: int) -> TwistStamped:
        message, twist = TwistStamped(), self._body.twist.tolist()
        message.header.frame_id = "world"
        set_stamp(message.header.stamp, now)
        for part, values in ((message.twist.linear, twist[:3]), (message.twist.angular, twist[3:])):
            part.x, part.y, part.z = values
        return message

    def _put(self, name: str, message: object) -> None:
        self._graph.put(f"/device/{name}", serialize_message(message))


def table(found: Sequence[Felt]) -> str:
    """Return what was felt as a table for a document."""
    headings = (
        *("driver", "engaged after, ms", "drift in 1 s, µm"),
        *("felt inertia / the mechanism's own", "device and point apart, mm"),
    )
    rows = (
        (
            one.kind,
            f"{1e3 * one.engaged_after:.0f}",
            f"{1e6 * one.drift:.1f}",
            f"{one.inertia:.3f}",
            f"{1e3 * one.apart:.2f}",
        )
        for one in found
    )
    return Sheet("what is felt", headings, tuple(rows)).markdown()


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command()
def drivers() -> None:
    """Push a five-bar through drivers of every kind, and print what is felt."""
    print(table([felt(kind) for kind in KINDS]))


if __name__ == "__main__":
    run_app(app)
