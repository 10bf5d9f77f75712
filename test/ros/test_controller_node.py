# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controller alone: the core's answer to the measurements, and silence when any is missing."""

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control import ControlArchitecture, DeviceMeasurement, PointMeasurement
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.control.measurements import (
    InFlight,
    flat_device,
    flat_operational_model,
    operational_model_of,
)
from hapticmech_ros.control.tuning import tuned
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.nodes.messages import write_pose
from hapticmech_ros.scene import document_of
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.wire.messages import DeviceStateMessage, OperationalModelMessage
from ros.harness import Peer, allowing, figures, refuses, running, six

pytestmark = pytest.mark.ros
SCENE = load_scene("five_bar")
# Answers are compared with the core's at the scene's rate; who answers has no deadlines of its own.
AS_THE_SCENE = {"control_rate": 0.0}
HAND = (-0.5, 0.2, 0.0, 0.0, 0.0, -0.0025)


class World:
    """Publishes everything the controller needs: device and mechanism at the scene's start."""

    def __init__(self, peer: Peer, device: str = "device", packed: bool = False) -> None:
        self.peer = peer
        self.packed = packed
        self.commanded = True
        self.grasp = flat_grasps(SCENE)[0]
        self.sample = Session(SCENE).tick()
        self.model = operational_model_of(self.sample.analysis)
        self.pose = self.sample.point.pose
        self.device_force = peer.publisher(f"{device}/hand/measured_cf", WrenchStamped)
        self.device_twist = peer.publisher(f"{device}/measured_cv", TwistStamped)
        self.device_pose = peer.publisher(f"{device}/measured_cp", PoseStamped)
        if packed:
            self.state = peer.publisher("device/state", Float64MultiArray)
        self.sender = peer.publisher("analysis/handle/operational_model", Float64MultiArray)
        self.commands = peer.listen(f"{device}/servo_cf", WrenchStamped)
        self.to_mechanism = peer.listen("mechanism/handle/servo_cf", WrenchStamped)

    def send(self, offset: float = 0.0, mechanism: bool = True) -> None:
        """Publish one round of measurements, the device ``offset`` m aside in y; wait a little."""
        peer = self.peer
        now = peer.node.get_clock().now().nanoseconds
        if mechanism:
            s = self.sample.analysis.spectrum.s
            point = PointMeasurement(self.pose, np.zeros(6), np.zeros(6))
            told = OperationalModelMessage.of(now, count=1, directions=s.size, grasp=self.grasp)
            told.operational_model.values[:] = flat_operational_model(self.model, point)
            told.s[:], told.commanded = s, self.commanded
            self.sender.publish(Float64MultiArray(data=told.values.tolist()))
        moved = pin.SE3(self.pose.rotation, self.pose.translation + np.array([0.0, offset, 0.0]))
        if self.packed:
            peer.run(0.002)
            measured = DeviceMeasurement(moved, np.zeros(6), np.array(HAND))
            values = DeviceStateMessage.of(now, sample=flat_device(measured), obeys=True).values
            self.state.publish(Float64MultiArray(data=values.tolist()))
            peer.run(0.003)
            return
        self.device_force.publish(peer.wrench(*HAND))
        self.device_twist.publish(peer.twist(*[0.0] * 6))
        # The pose triggers the answer: the rest has to be there before it.
        peer.run(0.002)
        self.device_pose.publish(_pose(moved, now))
        peer.run(0.003)


@pytest.mark.parametrize("packed", [True, False], ids=["packed", "crtk"])
def test_answers_as_the_core_does(domain: int, peer: Peer, packed: bool, tmp_path: Path) -> None:
    control = ControlArchitecture(SCENE)
    start = Session(SCENE).tick()
    model = operational_model_of(start.analysis)
    pose = start.point.pose
    moved = pin.SE3(pose.rotation, pose.translation + np.array([0.0, 2e-4, 0.0]))
    clutch = engage(0.0, pose, pose)
    told = np.zeros(6)
    # What the mechanism was told last is in flight when a device that corrects commands is answered
    # again, and half of what it is told now of the hand: the answer to measurements that stay comes
    # to stay too.
    hand = control.task * np.array(HAND)
    for _ in range(100 if packed else 1):
        period = SCENE.simulation.period
        expected = control.compute(
            10.0,
            clutch,
            DeviceMeasurement(moved, np.zeros(6), np.array(HAND)),
            PointMeasurement(pose, np.zeros(6), np.zeros(6)),
            model,
            InFlight(1.5 * period, period * (told + 0.5 * hand)) if packed else None,
        )
        told = expected.mechanism
    # On a busy machine this process may stand still for long: a timeout would engage anew, at the
    # moved pose.
    scene = allowing(tmp_path, command_timeout=1.0)
    with running("teleoperation_controller", domain, scene, input_timeout=1.0, **AS_THE_SCENE):
        world = World(peer, packed=packed)

        def engaged() -> bool:
            world.send(0.0)
            return len(world.commands) > 0

        def answered() -> bool:
            world.send(2e-4)
            # Poses travel as quaternions: rounding of 1e-16 rad times stiffnesses of thousands.
            device = np.array(six(world.commands[-1])) - expected.device
            mechanism = np.array(six(world.to_mechanism[-1])) - expected.mechanism
            return bool(max(np.abs(device).max(), np.abs(mechanism).max()) < 1e-10)

        peer.until(engaged, "the controller to engage")
        peer.until(answered, "the core's answer, once the ramp has ended")


def test_a_real_driver_takes_the_devices_place_by_remapping(domain: int, peer: Peer) -> None:
    names = ("measured_cp", "measured_cv", "hand/measured_cf", "servo_cf")
    remaps = {f"device/{name}": f"/omega/{name}" for name in names}
    with running("teleoperation_controller", domain, remaps=remaps):
        world = World(peer, "/omega")

        def engaged() -> bool:
            world.send()
            return len(world.commands) > 20

        peer.until(engaged, "commands to the driver")


def test_falls_silent_without_the_mechanism_and_comes_back_without_a_jump(
    domain: int, peer: Peer
) -> None:
    statuses = peer.statuses()
    # The test's own sends are 10 ms and more apart.
    with running("teleoperation_controller", domain, input_timeout=0.1, **AS_THE_SCENE):
        world = World(peer)

        def engaged() -> bool:
            world.send()
            return len(world.commands) > 60

        peer.until(engaged, "the controller to engage")

        def last_word_is_zero() -> bool:
            world.send(0.0, mechanism=False)
            return six(world.commands[-1]) == [0.0] * 6

        # So the device need not wait for its timeout.
        peer.until(last_word_is_zero, "a last command of zero")
        silent = len(world.commands)
        for _ in range(10):
            world.send(0.0, mechanism=False)
        assert len(world.commands) == silent
        peer.until(
            lambda: "waiting" in statuses.get("teleoperation_controller", _none()).message,
            "the status to say so",
        )
        control, none = ControlArchitecture(SCENE), np.zeros(6)
        still, at_first = (
            control.compute(
                10.0,
                clutch,
                DeviceMeasurement(world.pose, none, np.array(HAND)),
                PointMeasurement(world.pose, none, none),
                world.model,
            ).device
            for clutch in (
                engage(0.0, world.pose, world.pose),
                engage(10.0, world.pose, world.pose, control.gains.engagement_ramp),
            )
        )

        # The device is elsewhere when the mechanism comes back: 10 mm would be 3 N and more.
        def back() -> bool:
            world.send(0.01)
            return bool(np.abs(np.array(six(world.commands[-1])) - still).max() < 1e-9)

        peer.until(back, "the controller to engage anew, without an offset")
    # Forces act from the first command on.
    first = np.array(six(world.commands[silent]))
    assert np.abs(first - at_first).max() < 0.1 * np.abs(at_first).max()


def test_leaves_the_device_alone_until_the_mechanism_hears_it(domain: int, peer: Peer) -> None:
    with running("teleoperation_controller", domain):
        world = World(peer)
        world.commanded = False

        def answered() -> bool:
            world.send()
            return len(world.to_mechanism) > 20

        peer.until(answered, "commands to the mechanism")
        assert all(six(message) == [0.0] * 6 for message in world.to_mechanism)
        assert not world.commands
        world.commanded = True

        def engaged() -> bool:
            world.send()
            return len(world.commands) > 20

        peer.until(engaged, "commands to the device")
        world.commanded = False
        for _ in range(5):
            world.send()
        seen = len(world.commands)
        for _ in range(10):
            world.send()
        assert len(world.commands) == seen


def test_bad_measurements_are_refused(domain: int, peer: Peer) -> None:
    statuses = peer.statuses()
    with running("teleoperation_controller", domain, diagnostics_period=0.02) as process:
        world = World(peer)
        stale = peer.pose()
        stale.header.stamp.sec -= 2
        unknown = peer.pose()
        unknown.header.frame_id = "tool0"
        for bad in (peer.pose(math.nan), peer.pose(w=0.5), stale, unknown, PoseStamped()):
            refuses(peer, statuses, "teleoperation_controller", world.device_pose, bad)
        for bad_data in ([1.0, 2.0], [math.nan] * 144):
            bad = Float64MultiArray(data=bad_data)
            refuses(peer, statuses, "teleoperation_controller", world.sender, bad)
        assert process.poll() is None
    assert not world.commands


def _pose(pose: pin.SE3, now: int) -> PoseStamped:
    message = PoseStamped()
    write_pose(message, pose, now)
    return message


class _none:
    message = ""


def test_gains_change_while_it_renders_without_a_step(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    aside = 1e-3
    names = {"position_stiffness": 0.0, "constraint_stiffness": 0.0}
    start = Session(SCENE).tick()
    pose, model = start.point.pose, operational_model_of(start.analysis)
    moved = pin.SE3(pose.rotation, pose.translation + np.array([0.0, aside, 0.0]))

    def answer(gains: Controller) -> np.ndarray:
        control = ControlArchitecture(SCENE)
        control.apply_gains(gains)
        device = DeviceMeasurement(moved, np.zeros(6), np.array(HAND))
        seen = PointMeasurement(pose, np.zeros(6), np.zeros(6))
        return control.compute(10.0, engage(0.0, pose, pose), device, seen, model).device

    first, last = answer(SCENE.controller), answer(tuned(SCENE.controller, names))
    assert np.abs(first - last).max() > 0.5
    scene = allowing(tmp_path, command_timeout=1.0)
    with running("teleoperation_controller", domain, scene, input_timeout=1.0, **AS_THE_SCENE):
        world = World(peer)

        def engaged() -> bool:
            world.send()
            return bool(world.commands)

        def arrived(wanted: np.ndarray) -> bool:
            world.send(aside)
            return bool(np.abs(np.array(six(world.commands[-1])) - wanted).max() < 1e-9)

        peer.until(engaged, "the controller to engage")
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


def test_a_loop_without_delay_margin_is_warned_of(domain: int, peer: Peer, tmp_path: Path) -> None:
    document = document_of(SCENE)
    document["controller"]["joint_constraint"].update(stiffness=2e5, damping=400.0, local=False)
    weak = tmp_path / "weak.yaml"
    weak.write_text(yaml.safe_dump(document), encoding="utf-8")
    statuses = peer.statuses()
    with running("teleoperation_controller", domain, scene=str(weak), **AS_THE_SCENE):
        peer.until(lambda: "teleoperation_controller" in statuses, "diagnostics")
        warning = figures(statuses["teleoperation_controller"])["loop_warning"]
        assert warning.startswith("at handle the loop is unstable even without delay")
        assert "times the controller's stiffness and damping" in warning
