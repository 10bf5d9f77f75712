# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controller alone: the core's answer to the measurements, and silence when any is missing."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
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
from hapticmech_ros.nodes.inputs import SampleAge
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


@pytest.fixture(autouse=True)
def nothing_is_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the machine's clock, which goes on faster than the graph's where others work too."""
    monkeypatch.setattr(SampleAge, "beyond", lambda *_: 0)


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

    def __init__(self, scene: str = "five_bar", **parameters: object) -> None:
        given = {"teleoperation_controller": parameters}
        self.graph = FakeGraph(scene, actors=[TeleoperationController], parameters=given)
        self.host = self.graph.hosts["teleoperation_controller"]
        self.commands, self.to_mechanism = heard(
            self.graph, "/device/servo_cf", "/mechanism/handle/servo_cf"
        )
        # Of all that the device tells.
        self.commanded, self.frame = True, "world"

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

    def run(
        self, seconds: float, offset: float = 0.0, mechanism: bool = True, speed: float = 0.0
    ) -> None:
        """Tell measurements each period for a while, of a device ``offset`` m aside in y.

        It says that it moves at ``speed``, m/s.
        """
        pose, twist = PoseStamped(), TwistStamped()
        twist.twist.linear.x = speed
        for _ in range(round(1000 * seconds)):
            if mechanism:
                self.graph.put(MODELS, self.model())
            push(self.graph, "/device/hand/measured_cf", HAND, self.frame)
            say(self.graph, "/device/measured_cv", twist, self.frame)
            write_pose(pose, aside(offset), 0)
            # It triggers the answer: the rest has to be there before it.
            say(self.graph, POSES, pose, self.frame)
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
    for offset in np.linspace(0.0, 1e-3, 11):
        world.run(0.1, offset)
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


@pytest.mark.parametrize(
    ("offset", "speed", "said"),
    [
        (0.2, 0.0, "the device has moved by 200 mm more or less than its twist"),
        (0.0, 0.3, "more or less than its twist implies"),
        (0.0, 8.0, "8 m/s, device.motion.speed is 5; are these millimetres?"),
    ],
    ids=["elsewhere", "stands-still", "too-fast"],
)
def test_what_is_no_motion_of_a_device_is_not_felt(offset: float, speed: float, said: str) -> None:
    world = World()
    world.run(0.5)
    actor = world.host.actor
    engagements, seen = actor.engagements, len(world.commands)
    world.run(0.1, offset, speed=speed)
    assert int(actor.status()[2]["motion_faults"]) > 0
    if speed:
        assert actor.status()[1].startswith("disengaged: the device")
        assert said in actor.status()[1]
        seen = len(world.commands)
        world.run(0.5, speed=speed)
        assert not any(any(six(command)) for command in world.commands[seen:])
    # It goes on where the device is now.
    world.run(1.0, offset)
    assert actor.engagements > engagements
    assert max(np.abs(six(command)[:3]).max() for command in world.commands[seen:]) < 1.0


@pytest.mark.parametrize(
    ("frame", "remedy"),
    [
        ("MTMR_base", "if its axes are the world's, let device_frame be 'MTMR_base'"),
        ("/world", "without the slash of tf's old spelling"),
    ],
)
def test_what_is_told_in_another_frame_is_refused_with_what_mends_it(
    frame: str, remedy: str
) -> None:
    world = World()
    world.frame = frame
    world.run(0.05)
    sentence = world.host.actor.status()[1]
    assert f"{POSES} (refused: frame_id: must be 'world'" in sentence
    assert remedy in sentence
    assert f"(got '{frame}')" in sentence
    assert not world.commands


def test_a_frame_that_is_told_is_taken() -> None:
    world = World(device_frame="MTMR_base")
    world.frame = "MTMR_base"
    world.run(0.1)
    assert len(world.commands) > 20


def test_a_loop_without_delay_margin_is_warned_of(tmp_path) -> None:
    weak = "controller.joint_constraint={stiffness: 200000.0, damping: 400.0, local: false}"
    world = World(scene_like(tmp_path, "five_bar", weak))
    warning = world.host.actor.status()[2]["loop_warning"]
    assert warning.startswith("at handle the loop is unstable even without delay")
    assert "times the controller's stiffness and damping" in warning
