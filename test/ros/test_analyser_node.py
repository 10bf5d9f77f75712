"""The analyser alone: what it says of a joint state is what the core says, and nothing kills it."""

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, UInt8, UInt8MultiArray

from hapticmech_ros import Mechanism, analyse, load_scene
from hapticmech_ros.mechanism.assembly import consistent_initial_state
from hapticmech_ros.wire.layouts import unpack_rendering
from ros.harness import Peer, refuses, running

pytestmark = pytest.mark.ros
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NAMES = ["joint1", "joint2", "joint3", "joint4"]


def _state(peer: Peer, q: list[float], v: list[float], names: list[str] = NAMES) -> JointState:
    message = JointState(name=names, position=q, velocity=v)
    message.header.stamp = peer.now()
    return message


def test_rendering_equals_the_core_analysis(domain: int, peer: Peer) -> None:
    mechanism = Mechanism(load_scene("five_bar"))
    q, _ = consistent_initial_state(mechanism)
    v = np.array([0.3, -0.2, 0.1, 0.4])
    expected = analyse(mechanism, q, v=v)
    renderings = peer.listen("analysis/handle/rendering", Float64MultiArray)
    counts = peer.listen("analysis/handle/constraint_count", UInt8)
    matrices = peer.listen("analysis/handle/inverse_inertia", Float64MultiArray)
    wrenches = peer.listen("analysis/handle/constraint_wrenches", Float64MultiArray)
    with running("nullspace_analyser", domain, view_rate=1000.0):
        states = peer.publisher("mechanism/measured_js", JointState)

        def answered() -> bool:
            states.publish(_state(peer, q.tolist(), v.tolist()))
            return bool(renderings and counts and matrices and wrenches)

        peer.until(answered, "an analysis")
    found = unpack_rendering(renderings[-1].data)
    # The same code on the same bits, in another process: equal, not merely close.
    assert np.array_equal(found.model.inverse_inertia, expected.inverse_inertia)
    assert np.array_equal(found.model.constraint_projector, expected.constraint_projector)
    assert np.array_equal(found.model.balanced_share, expected.balanced_share)
    assert np.array_equal(found.model.free_acceleration, expected.free_acceleration)
    assert np.array_equal(found.s, expected.spectrum.s)
    assert counts[-1].data == found.count == 1
    dims = matrices[-1].layout.dim
    assert [(d.label, d.size, d.stride) for d in dims] == [("row", 6, 36), ("column", 6, 6)]
    assert np.array_equal(np.reshape(matrices[-1].data, (6, 6)), expected.inverse_inertia)
    column = np.array(wrenches[-1].data)
    pull = expected.inverse_inertia @ column
    # The published direction is in the null space: X n is rounding, seen against |X| |n|.
    scale = np.abs(expected.inverse_inertia) @ np.abs(column)
    assert np.abs(pull).max() < 1e-13 * scale.max()


def test_bad_joint_states_are_refused(domain: int, peer: Peer) -> None:
    renderings = peer.listen("analysis/handle/rendering", Float64MultiArray)
    statuses = peer.statuses()
    with running("nullspace_analyser", domain, diagnostics_period=0.02) as process:
        states = peer.publisher("mechanism/measured_js", JointState)
        closures = peer.publisher("mechanism/closures", UInt8MultiArray, LATCHED)
        stale = _state(peer, [0.0] * 4, [0.0] * 4)
        stale.header.stamp.sec -= 3
        for bad in (
            _state(peer, [float("nan"), 0.0, 0.0, 0.0], [0.0] * 4),
            _state(peer, [0.0] * 3, [0.0] * 4),
            _state(peer, [0.0] * 4, []),
            _state(peer, [0.0] * 4, [0.0] * 4, ["a", "b", "c", "d"]),
            stale,
            JointState(),
        ):
            refuses(peer, statuses, "nullspace_analyser", states, bad)
        wrong = UInt8MultiArray(data=[1, 0, 1])
        refuses(peer, statuses, "nullspace_analyser", closures, wrong)
        assert process.poll() is None
    assert not renderings


def test_closures_topic_switches_the_loop(domain: int, peer: Peer) -> None:
    mechanism = Mechanism(load_scene("five_bar"))
    q, _ = consistent_initial_state(mechanism)
    expected = analyse(mechanism, q, active=(False,))
    renderings = peer.listen("analysis/handle/rendering", Float64MultiArray)
    with running("nullspace_analyser", domain):
        closures = peer.publisher("mechanism/closures", UInt8MultiArray, LATCHED)
        closures.publish(UInt8MultiArray(data=[0]))
        states = peer.publisher("mechanism/measured_js", JointState)

        def opened() -> bool:
            states.publish(_state(peer, q.tolist(), [0.0] * 4))
            if not renderings:
                return False
            found = unpack_rendering(renderings[-1].data)
            return np.array_equal(found.model.inverse_inertia, expected.inverse_inertia)

        peer.until(opened, "the analysis of the open chain")
