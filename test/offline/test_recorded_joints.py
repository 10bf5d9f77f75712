# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint states of other people's robots: used and said so, or refused in words of the bag."""

import math

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from commands import ran
from hapticmech_ros import load_scene
from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.errors import BagError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.offline import analyse_states, states_from_bag
from hapticmech_ros.wire.topics import JOINT_STATES

STORE = get_typestore(Stores.ROS2_JAZZY)
EPOCH_NS = 1_700_000_000_000_000_000
MS = 1_000_000
TOPIC = "/joint_states"
LINK = """
  - name: {name}
    parent: {parent}
    inertial: {{mass: 0.3, com: [0.1, 0, 0], inertia: {{ixx: 3.0e-3, iyy: 3.0e-3, izz: 3.0e-3}}}}
    joint: {{name: {joint}, type: revolute, axis: [0, 0, 1], origin: {{xyz: [{x}, 0, 0]}}}}
"""
SCENE = f"""
format: hapticmech-scene/1
name: coupled
links:{LINK.format(name="upper", parent="world", joint="shoulder", x=0)}\
{LINK.format(name="fore", parent="upper", joint="elbow", x=0.2)}\
{LINK.format(name="jaw", parent="fore", joint="leader", x=0.2)}\
{LINK.format(name="other", parent="fore", joint="follower", x=0.2)}
couplings:
  - {{name: gear, joint: follower, leader: leader, ratio: -2.0, offset: 0.1}}
operational_points:
  - {{name: palm, link: fore, origin: {{xyz: [0.2, 0, 0]}}}}
hand: {{kind: constant_wrench, force: [0, 0, 0], torque: [0, 0, 0]}}
"""


@pytest.fixture(scope="module")
def path_of_scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("scene") / "coupled.yaml"
    path.write_text(SCENE, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def mechanism(path_of_scene):
    return Mechanism(load_scene(str(path_of_scene)))


def positions(k):
    t = 0.01 * k
    jaw = 0.2 + 0.1 * math.sin(t)
    arm = {"shoulder": 0.4 * math.sin(t), "elbow": 0.8 + 0.3 * math.cos(t)}
    return arm | {"leader": jaw, "follower": -2.0 * jaw + 0.1}


def rates(k):
    t = 0.01 * k
    jaw = 0.1 * math.cos(t)
    arm = {"shoulder": 0.4 * math.cos(t), "elbow": -0.3 * math.sin(t)}
    return arm | {"leader": jaw, "follower": -2.0 * jaw}


def write(path, messages):
    """Write a bag of (stamp after the start in ms, positions, rates or None) by name."""
    types = STORE.types
    with BagWriter(path) as writer:
        writer.add_topic(TOPIC, JOINT_STATES.type)
        for ms, q, v in messages:
            stamp_ns = EPOCH_NS + int(ms * MS)
            stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))
            message = types[JOINT_STATES.type](
                types["std_msgs/msg/Header"](stamp, ""),
                list(q),
                np.array(list(q.values()), dtype=float),
                np.array([v[name] for name in q] if v else [], dtype=float),
                np.zeros(0),
            )
            writer.write(TOPIC, stamp_ns, STORE.serialize_cdr(message, JOINT_STATES.type))
    return path


def some(k, *names):
    return {name: positions(k)[name] for name in names}


@pytest.fixture
def read(tmp_path, mechanism):
    return lambda messages: states_from_bag(write(tmp_path / "bag", messages), mechanism, TOPIC)


@pytest.fixture(scope="module")
def whole(tmp_path_factory, mechanism):
    path = tmp_path_factory.mktemp("whole") / "bag"
    messages = ((10 * k, positions(k), rates(k)) for k in range(40))
    return states_from_bag(write(path, messages), mechanism, TOPIC)


def test_of_a_whole_recording_nothing_is_said(whole):
    assert whole.notes == ()
    assert len(whole.q) == 40


def test_rates_that_are_not_numbers_are_0_and_said(read, whole, mechanism):
    nan = dict.fromkeys(positions(0), math.nan)
    found = read((10 * k, positions(k), nan) for k in range(40))
    one, other = analyse_states(mechanism, found), analyse_states(mechanism, whole)
    assert (one.inverse_inertia == other.inverse_inertia).all()
    assert (found.v == 0.0).all()
    assert "shoulder, elbow, leader, follower taken as 0 in 40 of 40 states" in found.notes[0]


def test_a_coupled_joint_that_nobody_measures_follows(read, whole):
    found = read((10 * k, some(k, "elbow", "leader", "shoulder"), rates(k)) for k in range(40))
    assert np.abs(found.q - whole.q).max() < 1e-15
    assert np.abs(found.v - whole.v).max() < 1e-15
    assert found.notes == ("follower is in no message: it follows from leader",)


def test_so_does_one_that_follows_a_curve(tmp_path):
    path, curve = tmp_path / "cam.yaml", "polycoef: [0.1, -2.0, 0.3, 0.0, 0.0]"
    path.write_text(SCENE.replace("ratio: -2.0, offset: 0.1", curve), encoding="utf-8")
    mechanism = Mechanism(load_scene(str(path)))
    sent = ((10 * k, some(k, "elbow", "leader", "shoulder"), rates(k)) for k in range(40))
    found = states_from_bag(write(tmp_path / "bag", sent), mechanism, TOPIC)
    at = mechanism.tree.joint_names.index
    leader, speed = found.q[:, at("leader")], found.v[:, at("leader")]
    assert found.q[:, at("follower")] == pytest.approx(0.1 - 2.0 * leader + 0.3 * leader**2)
    assert found.v[:, at("follower")] == pytest.approx((0.6 * leader - 2.0) * speed)


def two_publishers(apart_ms):
    for k in range(40):
        yield 10 * k, some(k, "elbow", "shoulder"), rates(k)
        if k % 2 == 0:
            yield 10 * k + apart_ms, some(k, "leader", "follower"), rates(k)


def test_two_publishers_with_a_part_each_are_put_together(read, whole):
    found = read(two_publishers(3))
    # The first one has no jaws yet.
    assert len(found.q) == 59
    stamps, here, there = np.intersect1d(found.stamps_ns, whole.stamps_ns, return_indices=True)
    assert len(stamps) == 39
    assert (found.q[here, :2] == whole.q[there, :2]).all()
    newest = [(k - 1) // 2 * 2 for k in range(1, 40)]
    assert (found.q[here, 2:] == whole.q[newest, 2:]).all()
    assert found.notes[0].endswith("known yet: 1")
    assert "(leader, follower | shoulder, elbow)" in found.notes[1]
    assert found.notes[1].endswith("up to 17 ms old")


def test_parts_with_the_same_stamp_are_one_state(read, whole):
    found = read(two_publishers(0))
    assert found.stamps_ns.tolist() == whole.stamps_ns.tolist()
    assert (found.q[::2] == whole.q[::2]).all()


@pytest.mark.parametrize("every", [1, 10])
def test_a_second_sender_of_zeros_is_told(read, every):
    def messages():
        for k in range(100):
            yield 10 * k, positions(k), rates(k)
            if k % every == every // 2:
                yield 10 * k + 1, dict.fromkeys(positions(k), 0.0), None

    notes = read(messages()).notes
    (warning,) = [note for note in notes if note.startswith("warning")]
    assert "elbow jumps by 1.1 rad in 1 ms and back" in warning
    assert "two senders" in warning


@pytest.mark.parametrize(
    "motion",
    [
        lambda k: 0.4 * math.sin(0.2 * k),
        lambda k: 1e-4 * (k % 2),
        lambda k: 0.02 * math.sin(1e4 * k),
        lambda k: 0.1 * abs(k % 20 - 10),
    ],
    ids=["sine", "last digit", "noise", "zigzag"],
)
def test_a_motion_of_one_sender_is_no_jump(read, motion):
    assert (
        read((k, positions(0) | {"shoulder": motion(k)}, rates(0)) for k in range(200)).notes == ()
    )


def test_messages_of_another_robot_make_no_state(read):
    def messages():
        for k in range(10):
            yield 10 * k, positions(k), rates(k)
            yield 10 * k + 1, {"wheel": 1.0}, None

    found = read(messages())
    assert len(found.q) == 10
    assert found.notes == ()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda q: {name: q[name] for name in ("elbow", "leader")}, "must name shoulder, with a"),
        (lambda q: q | {"leader": math.nan, "follower": math.nan}, "must name leader, follower"),
        (lambda q: {"wheel": 1.0}, "must name shoulder, elbow, leader, follower"),
    ],
)
def test_joints_of_which_nothing_is_known_are_named(read, change, told):
    with pytest.raises(BagError, match=rf"{TOPIC}: joints: {told}"):
        read((k, change(positions(k)), None) for k in range(5))


def test_a_position_that_gets_lost_is_named(read):
    lost = positions(3) | {"elbow": math.nan}
    messages = [*((k, positions(k), None) for k in range(3)), (3, lost, None)]
    with pytest.raises(
        BagError, match=rf"position of elbow: must be finite.*{EPOCH_NS + 3 * MS} ns"
    ):
        read(messages)


def test_the_command_says_it(tmp_path, path_of_scene):
    bag = write(tmp_path / "bag", ((10 * k, positions(k), None) for k in range(5)))
    given = ["analyse", str(bag), "--scene", str(path_of_scene), "--topic", TOPIC]
    done = ran(*given, "--out", str(tmp_path / "out"))
    assert "taken as 0 in 5 of 5 states" in done
