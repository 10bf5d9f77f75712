# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism alone: what it tells at the start, and loops that open and close."""

from geometry_msgs.msg import PoseStamped, WrenchStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, UInt8MultiArray
from std_srvs.srv import SetBool

from hapticmech_ros import Simulator, load_scene
from hapticmech_ros.nodes.messages import LATCHED
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.messages import MechanismEnergy
from ros.harness import Peer, running


def test_publishes_joint_states_pose_and_closures(domain: int, peer: Peer) -> None:
    joints = peer.listen("mechanism/measured_js", JointState)
    poses = peer.listen("mechanism/handle/measured_cp", PoseStamped)
    with running("mechanism_simulator", domain):
        peer.until(lambda: len(joints) > 20 and len(poses) > 20, "state")
        closures = peer.listen("mechanism/closures", UInt8MultiArray, LATCHED)
        peer.until(lambda: closures, "the latched closures")
    start = Simulator(load_scene("five_bar")).initial_state()
    assert list(joints[-1].name) == ["joint1", "joint2", "joint3", "joint4"]
    assert list(joints[-1].position) == start.q.tolist()
    assert list(closures[-1].data) == [1]
    assert closures[-1].layout.dim[0].label == "ground_pin"
    assert poses[-1].header.frame_id == "world"


def test_closures_open_and_close_by_service(domain: int, peer: Peer) -> None:
    energies = peer.listen("mechanism/energy", Float64MultiArray)
    with running("mechanism_simulator", domain):
        closures = peer.listen("mechanism/closures", UInt8MultiArray, LATCHED)
        peer.until(lambda: closures, "the latched closures")

        def switched(on: bool) -> SetBool.Response:
            request = SetBool.Request(data=on)
            return peer.call(SetBool, "mechanism/closures/ground_pin", request)

        assert switched(False).success
        peer.until(lambda: list(closures[-1].data) == [0], "the open loop")
        assert switched(True).success
        peer.until(lambda: list(closures[-1].data) == [1], "the closed loop")
        switched(False)
        push = peer.publisher("mechanism/handle/external_cf", WrenchStamped)

        peer.until(
            lambda: bool(energies) and read(MechanismEnergy, energies[-1].data).work_in > 0.02,
            "the push",
            doing=lambda: push.publish(peer.wrench(-2.0, 1.0, 0.0, 0.0, 0.0, 0.0)),
        )
        refused = switched(True)
        assert not refused.success
        assert "distance of closure ground_pin" in refused.message
        assert list(closures[-1].data) == [0]
