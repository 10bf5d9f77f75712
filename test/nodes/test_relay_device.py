# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The relay to a driver of ros2_control: a fake with forcedimension_ros2's topics and types."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from benchmarks.drivers import PUSH, SCENE, Body
from benchmarks.push import WAY, time_alone
from benchmarks.reliability.fake_graph import ACTORS, FakeGraph
from hapticmech_ros import load_scene
from hapticmech_ros.device import NO_WRENCH
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.relay_device import RelayDevice
from ros.harness import scene_like

STATES, EFFORTS = "/fd/joint_states", "/fd/fd_controller/commands"
SIX = [f"fd_{name}" for name in ("x", "y", "z", "roll", "pitch", "yaw")]
PERIOD = 0.001


class Driver:
    """A body behind joint states and efforts; the controller keeps the last efforts.

    Args:
        graph: with the relay.
        yaw: rad, of its base in the world.
        axes: how many it tells, of ``SIX``.
        place: (3,) of it in the world at the start, m.
    """

    def __init__(self, graph, yaw=0.0, axes=6, place=(0.1, -0.05, 0.02)):
        scene = load_scene("five_bar")
        mass = np.array([scene.device.mass] * 3 + [scene.device.inertia] * 3)
        self.body = Body(mass, pin.SE3(np.eye(3), np.array(place)), PERIOD)
        self.graph, self.base, self.axes = graph, pin.rpy.rpyToMatrix(0.0, 0.0, yaw), axes

    @property
    def efforts(self):
        """(6,) in the axes of the world."""
        message = self.graph.last.get(EFFORTS)
        if message is None:
            return np.zeros(6)
        if isinstance(message, bytes):
            message = deserialize_message(message, Float64MultiArray)
        given = np.zeros(6)
        given[: len(message.data)] = message.data
        return np.concatenate((self.base @ given[:3], self.base @ given[3:]))

    def tell(self, **other):
        """Tell where it is, and let the graph go on by a period."""
        pose, twist = self.body.pose, self.body.twist
        turned = self.base.T @ pose.rotation
        position = [*(self.base.T @ pose.translation), *pin.rpy.matrixToRpy(turned)]
        velocity = [*(self.base.T @ twist[:3]), *(self.base.T @ twist[3:])]
        # Others' joints come with it, in an order of their own.
        message = JointState(
            name=["gripper", *reversed(SIX[: self.axes])],
            position=[9.9, *reversed(position[: self.axes])],
            velocity=[9.9, *reversed(velocity[: self.axes])],
        )
        for name, value in other.items():
            setattr(message, name, value)
        self.graph.put(STATES, serialize_message(message))

    def go_on(self, push=NO_WRENCH, periods=1):
        for _ in range(periods):
            self.tell()
            self.graph.run(1e-3)
            self.body.step(self.efforts + push)


def graph_of(tmp_path, device="{force_sensor: estimated}", **parameters):
    path = scene_like(tmp_path, "five_bar", f"device={device}")
    given = {"axes": " ".join(SIX), "torques": True, **parameters}
    actors = [RelayDevice, *ACTORS[1:4]]
    return FakeGraph(path, actors=actors, parameters={"relay_device": given})


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_the_mechanism_is_felt_through_it(tmp_path, yaw):
    graph = graph_of(tmp_path, mounting_yaw=yaw)
    driver = Driver(graph, yaw)
    driver.go_on(periods=1000)
    start, ticks = driver.body.pose.translation[0], 0
    while start - driver.body.pose.translation[0] < WAY:
        driver.go_on(PUSH)
        ticks += 1
        assert ticks < 5000
    assert (ticks * PERIOD / time_alone(SCENE, PUSH)) ** 2 == pytest.approx(1.0, abs=0.02)


def test_three_axes_give_no_torque_and_keep_their_orientation(tmp_path):
    graph = graph_of(tmp_path, "{preset: omega_3}", axes=" ".join(SIX[:3]), torques=False)
    driver = Driver(graph, axes=3)
    driver.go_on(PUSH, 300)
    message = graph.last[EFFORTS]
    if isinstance(message, bytes):
        message = deserialize_message(message, Float64MultiArray)
    assert len(message.data) == 3
    assert any(message.data)


def test_without_joint_states_efforts_are_zero_and_nothing_is_told(tmp_path):
    graph = graph_of(tmp_path)
    driver = Driver(graph)
    driver.go_on(PUSH, 300)
    assert driver.efforts.any()
    graph.run(0.04)
    assert not driver.efforts.any()
    graph.last.pop("/device/state")
    graph.run(0.04)
    assert "/device/state" not in graph.last
    well, sentence, _ = graph.hosts["relay_device"].actor.status()
    assert not well
    assert "no joint states" in sentence
    # Back again, wherever it is now.
    driver.body.pose.translation = driver.body.pose.translation + 0.05
    driver.go_on(PUSH, 300)
    assert driver.efforts.any()
    assert np.linalg.norm(driver.efforts[:3]) < 5.0


def test_how_long_it_may_be_silent_is_a_parameter_that_can_change(tmp_path):
    graph = graph_of(tmp_path)
    driver = Driver(graph)
    driver.go_on(PUSH, 300)
    actor = graph.hosts["relay_device"].actor
    for timeout, lost in ((0.1, False), (0.005, True)):
        driver.go_on(PUSH)
        actor.apply_parameters(actor.parameters.model_copy(update={"command_timeout": timeout}))
        for _ in range(40):
            graph.tick()
        assert ("no joint states" in actor.status()[1]) == lost


@pytest.mark.parametrize(
    ("other", "named"),
    [
        ({"name": SIX[:5]}, "fd_yaw"),
        ({"velocity": [0.0]}, "velocity"),
        ({"position": [np.nan] * 7}, "position"),
        ({"position": [1e9] * 7}, "position"),
        ({"velocity": [np.inf] * 7}, "velocity"),
    ],
)
def test_states_that_are_none_are_refused(tmp_path, other, named):
    graph = graph_of(tmp_path)
    Driver(graph).tell(**other)
    graph.tick()
    host = graph.hosts["relay_device"]
    assert host.refused == 1
    assert named in host.last_refusal


def test_states_of_other_joints_are_not_for_it(tmp_path):
    graph = graph_of(tmp_path)
    Driver(graph).tell(name=["gripper", "finger"])
    graph.tick()
    assert graph.hosts["relay_device"].refused == 0


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"axes": "a b"}, "axes"),
        ({"axes": "a b b"}, "axes"),
        ({"axes": "a b c", "torques": True}, "6 joints"),
        ({"axes": " ".join(SIX), "torques": False}, "device.actuated"),
    ],
)
def test_axes_that_do_not_fit_are_refused(tmp_path, given, named):
    with pytest.raises(InvalidInputError, match=named):
        graph_of(tmp_path, **given)
