# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controller alone: the core's answer to the measurements, and silence when any is missing."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import PoseStamped, TwistStamped

from benchmarks.reliability.fake_graph import FakeGraph
from hapticmech_ros import Session, load_scene
from hapticmech_ros.control import ControlArchitecture, DeviceMeasurement, PointMeasurement
from hapticmech_ros.control.clutch import Clutch, engage
from hapticmech_ros.control.measurements import (
    ControlOutput,
    flat_operational_model,
    operational_model_of,
)
from hapticmech_ros.control.tuning import tuned
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.nodes.messages import write_pose
from hapticmech_ros.nodes.teleoperation_controller import TeleoperationController
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.session.sample import Sample
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.messages import OperationalModelMessage
from nodes.stand_ins import heard, push, say
from ros.harness import scene_like, six

SCENE = load_scene("five_bar")
POSES, MODELS = "/device/measured_cp", "/analysis/handle/operational_model"
HAND = (-0.5, 0.2, 0.0, 0.0, 0.0, -0.0025)


@cache
def start() -> Sample:
    """Return the first sample of a session, whose device and mechanism the tests here have."""
    return Session(SCENE).tick()


def aside(offset: float) -> pin.SE3:
    """Return the pose of a device that is so far beside its start in y, m."""
    pose = start().point.pose
    return pin.SE3(pose.rotation, pose.translation + np.array([0.0, offset, 0.0]))


def answer(
    offset: float = 0.0, clutch: Clutch | None = None, gains: Controller = SCENE.controller
) -> ControlOutput:
    """Return the core's answer to what :class:`World` publishes, with all ramps at their ends."""
    control, pose, none = ControlArchitecture(SCENE), start().point.pose, np.zeros(6)
    control.apply_gains(gains)
    return control.compute(
        10.0,
        clutch or engage(0.0, pose, pose),
        DeviceMeasurement(aside(offset), none, np.array(HAND)),
        PointMeasurement(pose, none, none),
        operational_model_of(start().analysis),
    )


class World:
    """Tells the controller everything that it needs, by CRTK: all at the scene's start.

    What devices tell in one message, ``device/state``, is answered in lockstep as in a session.
    """

    def __init__(self, scene: str = "five_bar") -> None:
        self.graph = FakeGraph(scene, actors=[TeleoperationController])
        self.host = self.graph.hosts["teleoperation_controller"]
        self.commands, self.to_mechanism = heard(
            self.graph, "/device/servo_cf", "/mechanism/handle/servo_cf"
        )
        self.commanded = True

    def model(self) -> bytes:
        """Return what the analyser tells now."""
        found = start().analysis
        s, grasp = found.spectrum.s, flat_grasps(SCENE)[0]
        point = PointMeasurement(start().point.pose, np.zeros(6), np.zeros(6))
        now = self.graph.now_ns
        told = OperationalModelMessage.of(now, count=1, directions=s.size, grasp=grasp)
        told.operational_model.values[:] = flat_operational_model(
            operational_model_of(found), point
        )
        told.s[:], told.commanded = s, self.commanded
        return bytes(FlatArray(OperationalModelMessage.layout).encode(told.values))

    def run(self, seconds: float, offset: float = 0.0, mechanism: bool = True) -> None:
        """Tell measurements each period for a while, of a device ``offset`` m aside in y."""
        pose = PoseStamped()
        for _ in range(round(1000 * seconds)):
            if mechanism:
                self.graph.put(MODELS, self.model())
            push(self.graph, "/device/hand/measured_cf", HAND)
            say(self.graph, "/device/measured_cv", TwistStamped())
            write_pose(pose, aside(offset), 0)
            # It triggers the answer: the rest has to be there before it.
            say(self.graph, POSES, pose)
            self.graph.run(1e-3)


def off(expected: np.ndarray, commands: list) -> float:
    """Return by how much the last command is not what is expected."""
    return float(np.abs(np.array(six(commands[-1])) - expected).max())


def test_answers_as_the_core_does_and_changes_gains_without_a_step() -> None:
    names = {"position_stiffness": 0.0, "constraint_stiffness": 0.0}
    expected = answer(1e-3)
    last = answer(1e-3, gains=tuned(SCENE.controller, names)).device
    assert np.abs(expected.device - last).max() > 0.5
    world = World()
    # In steps that are no jump of a device.
    for offset in np.linspace(0.0, 1e-3, 6):
        world.run(0.2, offset)
    # Poses travel as quaternions: rounding of 1e-16 rad times stiffnesses of thousands.
    assert off(expected.device, world.commands) < 1e-10
    assert off(expected.mechanism, world.to_mechanism) < 1e-10
    passed, actor = len(world.commands), world.host.actor
    actor.apply_parameters(actor.parameters.model_copy(update=names))
    world.run(1.0, 1e-3)
    assert off(last, world.commands) < 1e-9
    way = np.array([six(one) for one in world.commands[passed - 1 :]])[:, :3]
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    assert steps.max() < 0.01 * np.linalg.norm(expected.device - last)


def test_falls_silent_without_the_mechanism_and_comes_back_without_a_jump() -> None:
    world = World()
    world.run(0.5)
    world.run(0.02, mechanism=False)
    # So the device need not wait for its timeout.
    assert six(world.commands[-1]) == [0.0] * 6
    silent = len(world.commands)
    world.run(0.1, mechanism=False)
    assert len(world.commands) == silent
    assert "waiting" in world.host.actor.status()[1]
    pose = start().point.pose
    at_first = answer(clutch=engage(10.0, pose, pose, SCENE.controller.engagement_ramp)).device
    # The device is elsewhere when the mechanism comes back: 10 mm would be 3 N and more.
    world.run(1.0, 0.01)
    assert off(answer().device, world.commands) < 1e-9
    # Forces act from the first command on.
    first = np.array(six(world.commands[silent]))
    assert np.abs(first - at_first).max() < 0.1 * np.abs(at_first).max()


def test_leaves_the_device_alone_until_the_mechanism_hears_it() -> None:
    world = World()
    world.commanded = False
    world.run(0.05)
    assert len(world.to_mechanism) > 20
    assert all(six(message) == [0.0] * 6 for message in world.to_mechanism)
    assert not world.commands
    world.commanded = True
    world.run(0.1)
    assert len(world.commands) > 20
    world.commanded = False
    world.run(0.005)
    seen = len(world.commands)
    world.run(0.05)
    assert len(world.commands) == seen


def test_bad_measurements_are_refused() -> None:
    world, pose, number = World(), PoseStamped(), 0
    for x, w, how in (
        (math.nan, 1.0, {}),
        (0.0, 0.5, {}),
        (0.0, 0.0, {}),
        (0.0, 1.0, {"late_s": 2.0}),
        (0.0, 1.0, {"frame": "tool0"}),
    ):
        pose.pose.position.x, pose.pose.orientation.w = x, w
        say(world.graph, POSES, pose, **how)
        number += 1
        assert world.host.refused == number
    good = world.model()
    for bad in (good[:-8], good[: -8 * 130] + np.full(130, math.nan).tobytes()):
        world.graph.put(MODELS, bad)
    assert world.host.refused == number + 2
    world.graph.run(0.05)
    assert not world.commands


def test_a_loop_without_delay_margin_is_warned_of(tmp_path) -> None:
    weak = "controller.joint_constraint={stiffness: 200000.0, damping: 400.0, local: false}"
    world = World(scene_like(tmp_path, "five_bar", weak))
    warning = world.host.actor.status()[2]["loop_warning"]
    assert warning.startswith("at handle the loop is unstable even without delay")
    assert "times the controller's stiffness and damping" in warning
