# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controller alone: the core's answer to the measurements, and silence when any is missing."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray

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
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.session.sample import Sample
from hapticmech_ros.wire.messages import OperationalModelMessage
from ros.harness import Peer, Statuses, allowing, figures, refuses, running, scene_like, six

SCENE = load_scene("five_bar")
# Answers are compared with the core's at the scene's rate; who answers has no deadlines of its own.
AS_THE_SCENE = {"control_rate": 0.0}
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
    """Publishes everything the controller needs, by CRTK: all at the scene's start.

    What devices tell in one message, ``device/state``, is answered in lockstep as in a session.
    """

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.commanded = True
        self.device_force = peer.publisher("device/hand/measured_cf", WrenchStamped)
        self.device_twist = peer.publisher("device/measured_cv", TwistStamped)
        self.device_pose = peer.publisher("device/measured_cp", PoseStamped)
        self.sender = peer.publisher("analysis/handle/operational_model", Float64MultiArray)
        self.commands = peer.listen("device/servo_cf", WrenchStamped)
        self.to_mechanism = peer.listen("mechanism/handle/servo_cf", WrenchStamped)

    def off(self, expected: np.ndarray, commands: list[WrenchStamped]) -> float:
        """Return by how much the last command is not what is expected."""
        return float(np.abs(np.array(six(commands[-1])) - expected).max())

    def send(self, offset: float = 0.0, mechanism: bool = True) -> None:
        """Publish one round of measurements, the device ``offset`` m aside in y; wait a little."""
        peer = self.peer
        now = peer.node.get_clock().now().nanoseconds
        if mechanism:
            found = start().analysis
            s, grasp = found.spectrum.s, flat_grasps(SCENE)[0]
            point = PointMeasurement(start().point.pose, np.zeros(6), np.zeros(6))
            told = OperationalModelMessage.of(now, count=1, directions=s.size, grasp=grasp)
            model = flat_operational_model(operational_model_of(found), point)
            told.operational_model.values[:] = model
            told.s[:], told.commanded = s, self.commanded
            self.sender.publish(Float64MultiArray(data=told.values.tolist()))
        self.device_force.publish(peer.wrench(*HAND))
        self.device_twist.publish(peer.twist(*[0.0] * 6))
        # The pose triggers the answer: the rest has to be there before it.
        peer.run(0.002)
        pose = PoseStamped()
        write_pose(pose, aside(offset), now)
        self.device_pose.publish(pose)
        peer.run(0.003)


def test_answers_as_the_core_does_and_changes_gains_without_a_step(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    names = {"position_stiffness": 0.0, "constraint_stiffness": 0.0}
    near = answer(2e-4)
    first, last = answer(1e-3).device, answer(1e-3, gains=tuned(SCENE.controller, names)).device
    assert np.abs(first - last).max() > 0.5
    # On a busy machine this process may stand still for long: a timeout would engage anew, at the
    # moved pose.
    scene = allowing(tmp_path, command_timeout=1.0)
    with running("teleoperation_controller", domain, scene, input_timeout=1.0, **AS_THE_SCENE):
        world = World(peer)
        peer.until(lambda: world.commands, "the controller to engage", doing=world.send)
        # Poses travel as quaternions: rounding of 1e-16 rad times stiffnesses of thousands.
        peer.until(
            lambda: (
                world.off(near.device, world.commands) < 1e-10
                and world.off(near.mechanism, world.to_mechanism) < 1e-10
            ),
            "the core's answer, once the ramp has ended",
            doing=lambda: world.send(2e-4),
        )

        def arrived(wanted: np.ndarray) -> bool:
            world.send(1e-3)
            return world.off(wanted, world.commands) < 1e-9

        peer.until(lambda: arrived(first), "an answer with the scene's gains")
        passed = len(world.commands)
        assert peer.set_parameters("teleoperation_controller", **names).successful
        peer.until(lambda: arrived(last), "an answer with the new gains")
        way = np.array([six(one) for one in world.commands[passed - 1 :]])[:, :3]
        # 0.3 s in samples some milliseconds apart; a machine that stalls skips a part of the way.
        assert len(way) > 5
        steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
        assert np.median(steps) < 0.1 * np.linalg.norm(first - last)
        assert steps[0] < 0.5 * np.linalg.norm(first - last)


def test_falls_silent_without_the_mechanism_and_comes_back_without_a_jump(
    domain: int, peer: Peer, statuses: Statuses
) -> None:
    # The test's own sends are 10 ms and more apart.
    with running("teleoperation_controller", domain, input_timeout=0.1, **AS_THE_SCENE):
        world = World(peer)

        peer.until(lambda: len(world.commands) > 60, "the controller to engage", doing=world.send)

        # So the device need not wait for its timeout.
        peer.until(
            lambda: six(world.commands[-1]) == [0.0] * 6,
            "a last command of zero",
            doing=lambda: world.send(0.0, mechanism=False),
        )
        silent = len(world.commands)
        for _ in range(10):
            world.send(0.0, mechanism=False)
        assert len(world.commands) == silent
        peer.until(
            lambda: "waiting" in statuses.sentence("teleoperation_controller"),
            "the status to say so",
        )
        still, pose = answer().device, start().point.pose
        ramp = SCENE.controller.engagement_ramp
        at_first = answer(clutch=engage(10.0, pose, pose, ramp)).device
        # The device is elsewhere when the mechanism comes back: 10 mm would be 3 N and more.
        peer.until(
            lambda: world.off(still, world.commands) < 1e-9,
            "the controller to engage anew, without an offset",
            doing=lambda: world.send(0.01),
        )
    # Forces act from the first command on.
    first = np.array(six(world.commands[silent]))
    assert np.abs(first - at_first).max() < 0.1 * np.abs(at_first).max()


def test_leaves_the_device_alone_until_the_mechanism_hears_it(domain: int, peer: Peer) -> None:
    with running("teleoperation_controller", domain):
        world = World(peer)
        world.commanded = False

        peer.until(
            lambda: len(world.to_mechanism) > 20,
            "commands to the mechanism",
            doing=world.send,
        )
        assert all(six(message) == [0.0] * 6 for message in world.to_mechanism)
        assert not world.commands
        world.commanded = True

        peer.until(lambda: len(world.commands) > 20, "commands to the device", doing=world.send)
        world.commanded = False
        for _ in range(5):
            world.send()
        seen = len(world.commands)
        for _ in range(10):
            world.send()
        assert len(world.commands) == seen


def test_bad_measurements_are_refused(domain: int, peer: Peer, statuses: Statuses) -> None:
    with running("teleoperation_controller", domain, diagnostics_period=0.02) as process:
        world = World(peer)
        stale = peer.pose()
        stale.header.stamp.sec -= 2
        unknown = peer.pose(frame="tool0")
        for bad in (peer.pose(math.nan), peer.pose(w=0.5), stale, unknown, PoseStamped()):
            refuses(peer, statuses, "teleoperation_controller", world.device_pose, bad)
        for bad_data in ([1.0, 2.0], [math.nan] * 144):
            bad = Float64MultiArray(data=bad_data)
            refuses(peer, statuses, "teleoperation_controller", world.sender, bad)
        assert process.poll() is None
    assert not world.commands


def test_a_loop_without_delay_margin_is_warned_of(
    domain: int, peer: Peer, statuses: Statuses, tmp_path: Path
) -> None:
    weak = "controller.joint_constraint={stiffness: 200000.0, damping: 400.0, local: false}"
    scene = scene_like(tmp_path, "five_bar", weak)
    with running("teleoperation_controller", domain, scene=scene, **AS_THE_SCENE):
        peer.until(lambda: "teleoperation_controller" in statuses, "diagnostics")
        warning = figures(statuses["teleoperation_controller"])["loop_warning"]
        assert warning.startswith("at handle the loop is unstable even without delay")
        assert "times the controller's stiffness and damping" in warning
