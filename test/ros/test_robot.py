# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot in MuJoCo that follows the mechanism, over ROS: by torques, rates and positions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.robot.law import OperationalLaw, inertia_ratio, loop_rates
from ros.harness import RATE, WAIT_S, Peer, refused, running, six

ROBOT = str(Path(__file__).resolve().parents[2] / "examples/iiwa14.yaml")
SCENE, POINT = "two_link", "handle"
LIMITS = "320 320 176 176 110 40 40"
QUICK = {"diagnostics_period": 0.1}
# N s/m, by which the handle is brought to rest; m/s, at which it is.
BRAKE, REST = 5.0, 0.002
TRIES = 5
# Hz: three nodes and a peer take half as much of a processor as at 250 Hz.
CALM = 100.0


class Watched:
    """What a test sees of mechanism and robot."""

    def __init__(self, peer: Peer, processes: dict[str, Any]) -> None:
        self.peer, self.processes = peer, processes
        self.statuses = peer.statuses()
        self._model = Mechanism(load_scene(ROBOT))
        self._names = list(self._model.tree.joint_names)
        self.poses = peer.listen(f"mechanism/{POINT}/measured_cp", PoseStamped)
        self.twists = peer.listen(f"mechanism/{POINT}/measured_cv", TwistStamped)
        self.joints = peer.listen("robot/joint_states", JointState)
        self.felt = peer.listen(f"mechanism/{POINT}/external_cf/robot", WrenchStamped)
        self.orders = peer.listen("robot/commands", Float64MultiArray)

    @property
    def handle(self) -> np.ndarray:
        place = self.poses[-1].pose.position
        return np.array((place.x, place.y, place.z))

    @property
    def rests(self) -> bool:
        return max(map(abs, self.joints[-1].velocity)) < 1e-3

    @property
    def velocity(self) -> np.ndarray:
        return np.array(six(self.twists[-1]))[:3]

    @property
    def q(self) -> np.ndarray:
        at = [self.joints[-1].name.index(name) for name in self._names]
        return np.array(self.joints[-1].position)[at]

    @property
    def tool(self) -> np.ndarray:
        return self._model.frame_pose(self.q, "tool").translation.copy()

    def figure(self, name: str) -> str:
        """Return a figure of the follower's diagnostics."""
        return self.statuses.figure("robot_follower", name)

    def follows(self) -> bool:
        received = self.poses and self.twists and self.joints
        return bool(received) and int(self.figure("followed") or 0) > 0


@contextmanager
def graph(domain: int, interface: str, **options: object) -> Iterator[dict[str, object]]:
    """Run mechanism, robot and follower; yield their processes."""
    kind, rate = options.pop("command_type", "array"), options.pop("control_rate", CALM)
    wall = {"wall": options.pop("wall")} if "wall" in options else {}
    same = {"control_rate": rate, **QUICK}
    joints = {"interface": interface, "command_type": kind, **same}
    # A busy machine delays processes by up to 60 ms: rates that bear 125 ms.
    patient = {"joint_timeout": 0.2, "target_timeout": 0.3, "wrench_timeout": 0.3}
    slow = {"linear_rate": 4.0, "angular_rate": 4.0}
    given = {"robot": ROBOT, "torque_limits": LIMITS, **patient, **slow, **joints, **options}
    with (
        running("mechanism_simulator", domain, SCENE, **same) as mechanism,
        running("simulated_robot", domain, ROBOT, command_timeout=0.5, **wall, **joints) as robot,
        running("robot_follower", domain, SCENE, **given),
    ):
        yield {"mechanism": mechanism, "robot": robot}


@contextmanager
def following(domain: int, peer: Peer, interface: str, **options: object) -> Iterator[Watched]:
    """Run them until the robot follows."""
    with graph(domain, interface, **options) as processes:
        seen = Watched(peer, processes)
        peer.until(seen.follows, "a robot that follows")
        yield seen


@pytest.mark.parametrize(
    ("interface", "kind"),
    [("effort", "array"), ("velocity", "array"), ("position", "trajectory")],
)
def test_the_robot_moves_by_as_much_as_the_mechanism(
    domain: int, peer: Peer, interface: str, kind: str
) -> None:
    with following(domain, peer, interface, command_type=kind, wrench_topic="robot/wrench") as seen:
        push = peer.publisher(f"mechanism/{POINT}/external_cf", WrenchStamped)

        def braked() -> bool:
            """Bring the handle to rest, and return whether it is."""
            push.publish(peer.wrench(*(-BRAKE * seen.velocity), 0.0, 0.0, 0.0))
            return float(np.linalg.norm(seen.velocity)) < REST

        # Again where a pause of the machine let the robot begin anew, from where it was then, and
        # across: along its stretched arm the handle is pushed in vain.
        x, y = 0.4, -0.4
        for _ in range(TRIES):
            x, y = -y, x
            peer.until(lambda: braked() and seen.rests, "rest of both", 3 * WAIT_S)
            before, handle, tool = seen.figure("engagements"), seen.handle, seen.tool

            def together(way: np.ndarray = handle - tool) -> bool:
                """Brake the handle, and return whether the robot is where it is."""
                apart = float(np.linalg.norm(seen.handle - seen.tool - way))
                return braked() and apart < 0.002

            peer.until(
                lambda start=handle: np.linalg.norm(seen.handle - start) > 0.02,
                "a handle that is pushed",
                doing=lambda x=x, y=y: push.publish(peer.wrench(x, y, 0.0, 0.0, 0.0, 0.0)),
            )
            peer.until(
                lambda before=before: together() or seen.figure("engagements") != before,
                "a robot that has caught up",
                3 * WAIT_S,
            )
            if seen.figure("engagements") == before:
                break
        assert seen.figure("engagements") == before
        assert np.linalg.norm(seen.tool - tool) > 0.01
        assert int(seen.figure("saturated")) == 0


def test_the_hand_feels_what_the_robot_touches(domain: int, peer: Peer) -> None:
    model = Mechanism(load_scene(ROBOT))
    start = np.array([0.0, 0.785398, 0.0, -1.570796, 0.0, 0.785398, 0.0])
    tool = model.frame_pose(start, "tool").translation
    # A wall 15 mm from the tool, in whose way the mechanism goes.
    wall = f"{tool[0] + 0.025} 0 0 -1 0 0"
    with following(
        domain, peer, "effort", wall=wall, control_rate=RATE, wrench_topic="robot/wrench"
    ) as seen:
        push = peer.publisher(f"mechanism/{POINT}/external_cf", WrenchStamped)

        peer.until(
            lambda: any(six(message)[0] < -0.2 for message in seen.felt),
            "the wall to be felt",
            doing=lambda: push.publish(peer.wrench(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
        )
        assert all(math.isfinite(value) for message in seen.felt for value in six(message))
        assert max(abs(six(message)[0]) for message in seen.felt) <= 20.0


def test_a_wrench_is_felt_in_the_axes_that_it_names(domain: int, peer: Peer) -> None:
    """2 N down: of a sensor that tells the base's axes, and of one with a frame of nobody."""
    with graph(domain, "effort", wrench_topic="ft/wrench") as processes:
        seen = Watched(peer, processes)
        sensor = peer.publisher("ft/wrench", WrenchStamped)

        def told(frame: str) -> None:
            sensor.publish(peer.wrench(0.0, 0.0, -2.0, 0.0, 0.0, 0.0, frame=frame))

        peer.until(
            lambda: bool(seen.felt) and abs(six(seen.felt[-1])[2] + 2.0) < 0.05,
            "2 N down",
            3 * WAIT_S,
            doing=lambda: told("world"),
        )
        assert max(np.abs(six(seen.felt[-1])[:2])) < 0.05

        peer.until(
            lambda: "nonsense" in seen.figure("last_refusal"),
            "a refusal",
            doing=lambda: told("nonsense"),
        )
        said = seen.figure("last_refusal")
        assert "must be one of world, link1, " in said
        assert "wrench_frame names the one that is meant" in said


def test_a_simulated_robot_whose_motion_is_lost_begins_anew(domain: int, peer: Peer) -> None:
    """Torques that no robot bears: it is silent for a while, and then at rest where it was."""
    with running("simulated_robot", domain, ROBOT, **QUICK):
        joints = peer.listen("robot/joint_states", JointState)
        torques = peer.publisher("robot/commands", Float64MultiArray)
        statuses = peer.statuses()
        peer.until(lambda: joints, "a robot")
        peer.until(
            lambda: int(statuses.figure("simulated_robot", "failures") or 0) > 0,
            "a motion that is lost",
            doing=lambda: torques.publish(Float64MultiArray(data=[1e6, -1e6] * 3 + [1e6])),
        )

        def failures() -> str:
            """Count failures once the robot has moved, and reported, without commands."""
            joints.clear()
            peer.until(lambda: len(joints) > 50, "a robot again")
            statuses.clear()
            peer.until(lambda: "simulated_robot" in statuses, "its report")
            return statuses.figure("simulated_robot", "failures")

        assert failures() == failures()
        assert max(map(abs, joints[-1].velocity)) < 0.1
        assert max(map(abs, joints[-1].position)) < math.pi


def test_without_a_target_the_robot_stands_and_without_its_joints_its_weight_is_carried(
    domain: int, peer: Peer
) -> None:
    model = Mechanism(load_scene(ROBOT))
    with following(domain, peer, "effort") as seen:
        seen.processes["mechanism"].kill()
        peer.until(lambda: int(seen.figure("target_stale") or 0) > 0, "a stale target")
        peer.until(lambda: seen.statuses["robot_follower"].level != b"\x00", "a warning")
        assert "target" in seen.statuses["robot_follower"].message
        peer.until(lambda: seen.rests, "a robot at rest")
        before = seen.tool
        peer.run(0.5)
        assert np.linalg.norm(seen.tool - before) < 1e-3
        assert all(np.isfinite(order.data).all() for order in seen.orders)
        # Joint 2 carries the arm.
        assert abs(seen.orders[-1].data[1]) > 10.0
        seen.processes["robot"].kill()
        peer.until(lambda: int(seen.figure("joints_stale") or 0) > 0, "stale joint states")

        def carries_the_weight() -> bool:
            weight = pin.computeGeneralizedGravity(model.model, model.model.createData(), seen.q)
            return np.allclose(seen.orders[-1].data, weight, rtol=1e-7, atol=1e-9)

        peer.until(carries_the_weight, "torques that carry the weight")


def _is_tared_at_rest_only(seen: Watched) -> None:
    peer = seen.peer
    peer.until(lambda: seen.rests, "rest")
    answers = []

    peer.until(
        lambda: "are needed" not in answers[-1].message,
        "samples of the sensor",
        doing=lambda: answers.append(peer.call(Trigger, "robot/tare_wrench", Trigger.Request())),
    )
    assert (answers[-1].success, answers[-1].message) == (True, "the sensor is tared")
    push = peer.publisher(f"mechanism/{POINT}/external_cf", WrenchStamped)

    peer.until(
        lambda: max(map(abs, seen.joints[-1].velocity)) > 0.1,
        "a robot that moves",
        3 * WAIT_S,
        doing=lambda: push.publish(peer.wrench(1.0, 1.0, 0.0, 0.0, 0.0, 0.0)),
    )
    refused = peer.call(Trigger, "robot/tare_wrench", Trigger.Request())
    assert not refused.success
    assert "the robot moves" in refused.message


def test_rates_follow_delay_and_payload_and_change_while_it_follows(
    domain: int, peer: Peer
) -> None:
    """R8 and R9 of the iiwa with 1 kg at the tool, and a delay that is found to be longer."""
    law = OperationalLaw(Mechanism(load_scene(ROBOT)))
    state = law.state(law.posture, 0.0 * law.posture)
    ratio = inertia_ratio(state, 1.0, np.array([0.0, 0.0, 0.05]))
    ruled = {"linear_rate": -1.0, "angular_rate": -1.0, "observer_rate": -1.0}
    told = {**ruled, "loop_delay": 0.05, "unknown_payload": 1.0, "payload_centre": "0 0 0.05"}

    def acts(delay: float) -> bool:
        rates = loop_rates(delay, ratio)
        wanted = {"linear_rate": rates.law, "observer_rate": rates.observer}
        return all(seen.figure(name) == f"{rate:.3g}" for name, rate in wanted.items())

    with following(
        domain, peer, "effort", wrench_topic="robot/wrench", gain_ramp=0.1, **told
    ) as seen:
        peer.until(lambda: acts(0.05), "rates of the rule")
        assert peer.set_parameters("robot_follower", loop_delay=0.1).successful
        peer.until(lambda: acts(0.1), "rates of the longer delay")
        for changed, rule in (
            ({"observer_rate": 0.0}, "must stay above 0 while the robot follows"),
            ({"observer_rate": 20.0}, "must be 0 or -1 with linear_rate -1"),
            ({"linear_rate": 20.0}, "must be -1 with observer_rate -1"),
            ({"angular_rate": -0.5}, "must be 0 or more, or -1"),
            ({"loop_delay": 0.0}, "must be above 0 for rates of -1"),
        ):
            refused(peer, "robot_follower", (rule,), **changed)
        assert acts(0.1)
        assert seen.figure("engagements") == "1"
        _is_tared_at_rest_only(seen)
