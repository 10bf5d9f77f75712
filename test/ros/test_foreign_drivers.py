# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drivers that other people wrote: what each of them says is enough to feel the mechanism.

The driver here is a body that a hand pushes, stepped as time goes on, with CRTK's topics alone and
CRTK's signs. The mechanism, its analyser and the controller are real. What is no motion of a
device, or in another frame: test/nodes/test_controller_alone.py.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped

from benchmarks.children import wait_until
from hapticmech_ros import Simulator, load_scene
from hapticmech_ros.nodes.messages import write_pose
from ros.harness import OTHERS, RATE, WAIT_S, Peer, Statuses, figures, running, scene_like, six
from sampling import only_long

SCENE = load_scene("five_bar")
MASS = np.array([SCENE.device.mass] * 3 + [SCENE.device.inertia] * 3)
PUSH = np.array([-0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
# Of the hand that holds it: a relaxed arm's, N s/m, and a fist's, N m s/rad (docs/devices.md).
DAMPING = np.array([6.45] * 3 + [0.0058] * 3)
PLANE = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])


class Driver:
    """A device and the hand that pushes it, as time goes on.

    Args:
        peer: that speaks for it.
        says: its topics besides ``measured_cp``.
        rate: Hz.
        turn: rad, of its axes about z; it then takes and tells wrenches in these.
    """

    def __init__(self, peer: Peer, says: tuple[str, ...], rate: float, turn: float = 0.0) -> None:
        self._peer, self._period, self._own = peer, 1.0 / rate, turn != 0.0
        kinds: dict[str, Any] = {
            "measured_cv": TwistStamped,
            "measured_cf": WrenchStamped,
            "body/measured_cf": WrenchStamped,
            "hand/measured_cf": WrenchStamped,
        }
        self._publishers = {
            name: peer.node.create_publisher(kinds[name], f"/omega/{name}", 10) for name in says
        }
        self._poses = peer.node.create_publisher(PoseStamped, "/omega/measured_cp", 10)
        servo = "/omega/body/servo_cf" if self._own else "/omega/servo_cf"
        self.commands = peer.listen(servo, WrenchStamped)
        simulator = Simulator(SCENE)
        point = SCENE.operational_points[0].name
        self.pose = simulator.mechanism.frame_pose(simulator.initial_state().q, point)
        self.pose.rotation = self.pose.rotation @ pin.exp3(np.array((0.0, 0.0, turn)))
        self.began = self.pose.copy()
        # Where it was, and when, ns.
        self.path: list[tuple[int, np.ndarray]] = []
        self._twist, self.pushing = np.zeros(6), False
        self._next = time.monotonic()

    def until(self, condition: Callable[[], object], what: str) -> None:
        """Go on until a condition holds."""
        wait_until(condition, 2 * WAIT_S, what, self.go_on, look_again_s=0.0)

    def go_on(self) -> None:
        """Step to the present and say where it is then."""
        peer = self._peer
        peer.run(max(0.0, self._next - time.monotonic()))
        given = np.array(six(self.commands[-1])) if self.commands else np.zeros(6)
        command = given
        if self._own:
            command = np.concatenate([self.pose.rotation @ part for part in (given[:3], given[3:])])
        push = (PUSH if self.pushing else np.zeros(6)) - DAMPING * self._twist
        behind = time.monotonic() - self._next
        # On a busy machine it stands still, as this process does.
        periods = 1 if behind > 0.05 else 1 + int(behind / self._period)
        for _ in range(periods):
            self._twist = self._twist + self._period * PLANE * (push + command) / MASS
            turned = pin.exp3(self._period * self._twist[3:]) @ self.pose.rotation
            place = self.pose.translation + self._period * self._twist[:3]
            self.pose = pin.SE3(turned, place)
        self._next = time.monotonic() + self._period
        told = {
            "measured_cv": peer.twist(*self._twist),
            "measured_cf": peer.wrench(*command),
            "body/measured_cf": peer.wrench(*given),
            "hand/measured_cf": peer.wrench(*push),
        }
        for name, publisher in self._publishers.items():
            publisher.publish(told[name])
        message, now_ns = PoseStamped(), peer.node.get_clock().now().nanoseconds
        self.path.append((now_ns, self.pose.translation.copy()))
        write_pose(message, self.pose, now_ns)
        self._poses.publish(message)


@contextmanager
def graph(domain: int, folder: Path, sensor: str, axes: str = "world") -> Iterator[None]:
    """Run the other three nodes for a device whose hand is known in a way."""
    device = f"device.force_sensor={sensor}", f"device.servo_axes={axes}"
    scene = scene_like(folder, "five_bar", *device, "device.safety.command_timeout=0.5")
    names = ("measured_cp", "measured_cv", "measured_cf", "hand/measured_cf", "servo_cf")
    if axes == "body":
        names += ("body/servo_cf", "body/measured_cf")
    remaps = {f"device/{name}": f"/omega/{name}" for name in names}
    with running(OTHERS, domain, scene, remaps, input_timeout=0.2):
        yield


def apart(driver: Driver, points: list[PoseStamped]) -> list[float]:
    """Return how far points were from where the driver was then, m, in the last half of its way."""
    times = np.array([when for when, _ in driver.path], dtype=float)
    ways = np.array([where for _, where in driver.path])
    half = (ways[0, 0] + ways[-1, 0]) / 2.0
    found = []
    for point in points:
        when = point.header.stamp.sec * 1e9 + point.header.stamp.nanosec
        x, y = (float(np.interp(when, times, ways[:, axis])) for axis in range(2))
        if times[0] <= when <= times[-1] and x < half:
            found.append(math.hypot(point.pose.position.x - x, point.pose.position.y - y))
    return found


@pytest.mark.alone
@pytest.mark.parametrize(
    ("sensor", "says", "rate", "turn"),
    # Others are felt in one process in every run: test/benchmarks/test_drivers.py.
    [
        ("measured", ("measured_cv", "measured_cf", "hand/measured_cf"), RATE, 0.0),
        ("estimated", ("measured_cv", "body/measured_cf"), RATE, 2.0),
        *only_long(
            ("estimated", ("measured_cv", "measured_cf"), RATE, 0.0),
            ("estimated", ("measured_cv",), RATE, 0.0),
            ("estimated", (), RATE, 0.0),
            ("absent", ("measured_cv", "measured_cf"), RATE, 0.0),
            ("estimated", ("measured_cv", "measured_cf"), 200.0, 0.0),
        ),
    ],
)
def test_the_mechanism_is_felt(
    domain: int,
    peer: Peer,
    tmp_path: Path,
    sensor: str,
    says: tuple[str, ...],
    rate: float,
    turn: float,
) -> None:
    with graph(domain, tmp_path, sensor, "body" if turn else "world"):
        points = peer.listen("mechanism/handle/measured_cp", PoseStamped)
        driver = Driver(peer, says, rate, turn)
        # Until the springs have come in.
        driver.until(lambda: len(driver.commands) > rate, "a second of commands")
        # Nobody pushes: it stays where it is.
        assert np.abs(driver.pose.translation - driver.began.translation).max() < 1e-3
        driver.pushing = True
        goal = driver.began.translation[0] - 0.02
        driver.until(lambda: driver.pose.translation[0] < goal, "way")
    found = apart(driver, points)
    assert len(found) > 5
    # The mechanism comes along. Without knowing of the hand, the springs alone pull it.
    assert np.median(found) < (0.003 if sensor == "absent" else 0.0008)


def test_what_a_driver_lacks_is_said_by_its_own_names(
    domain: int, peer: Peer, statuses: Statuses, tmp_path: Path
) -> None:
    sentence = partial(statuses.sentence, "teleoperation_controller")

    with graph(domain, tmp_path, "measured"):
        both = "/device/state or /omega/measured_cp"
        peer.until(lambda: both in sentence(), "what a device needs", 2 * WAIT_S)
        driver = Driver(peer, ("measured_cv", "measured_cf"), 200.0)
        driver.until(lambda: sentence() == "waiting for /omega/hand/measured_cf", "its name")
    assert not driver.commands
    assert figures(statuses["teleoperation_controller"])["engagements"] == "0"
