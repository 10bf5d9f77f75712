# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recording analysed: the same as each of its states, whatever kind of message they came in."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from benchmarks.accuracy import cases
from commands import ran
from hapticmech_ros import Session, load_scene
from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.errors import BagError, HapticMechError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.offline import RecordedStates, analyse_states, states_from_bag
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene.mechanism import Origin
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.state import StateLayout, WireState, coordinate_names
from hapticmech_ros.wire.topics import JOINT_STATES, STATE

TICKS = 400
EPOCH_NS = 1_700_000_000_123_456_789
STORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture(scope="module", params=["five_bar", "spatial_arm"])
def scene(request):
    return load_scene(request.param)


@pytest.fixture(scope="module")
def samples(scene):
    session = Session(scene)
    return [session.tick() for _ in range(TICKS)]


@pytest.fixture(scope="module")
def bag(scene, samples, tmp_path_factory):
    """Return a bag with both kinds of messages; joint states name joints the other way round."""
    mechanism = Mechanism(scene)
    layout, names = StateLayout(mechanism), coordinate_names(mechanism)
    encode = FlatArray(layout.fields).encode
    types, points = STORE.types, len(mechanism.point_names)
    path = tmp_path_factory.mktemp("bags") / "run"
    with BagWriter(path) as writer:
        writer.add_topic("/left/mechanism/state", STATE.type)
        writer.add_topic("/left/mechanism/measured_js", JOINT_STATES.type)
        for index, sample in enumerate(samples):
            state, stamp_ns = sample.mechanism, EPOCH_NS + index * 1_000_000
            wire = WireState(
                stamp_ns,
                state.active,
                state.q,
                state.v,
                np.zeros((points, 6)),
                flat_grasps(mechanism.scene),
                (True,) * points,
            )
            writer.write("/left/mechanism/state", stamp_ns, encode(layout.pack(wire)))
            stamp = types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
            message = types[JOINT_STATES.type](
                types["std_msgs/msg/Header"](stamp, "world"),
                [*reversed(names), "of another robot"],
                np.append(mechanism.coordinates(state.q)[::-1], 3.0),
                np.append(state.v[::-1], 4.0),
                np.zeros(0),
            )
            data = STORE.serialize_cdr(message, JOINT_STATES.type)
            writer.write("/left/mechanism/measured_js", stamp_ns, data)
    return path


def test_every_state_is_what_was_recorded(scene, samples, bag):
    found = states_from_bag(bag, Mechanism(scene), namespace="left")
    assert found.topic == "/left/mechanism/state"
    assert found.stamps_ns.tolist() == [EPOCH_NS + k * 1_000_000 for k in range(TICKS)]
    for index, sample in enumerate(samples):
        assert np.abs(found.q[index] - sample.mechanism.q).max() < 1e-15 * 8
        assert found.v[index].tolist() == sample.mechanism.v.tolist()
        assert tuple(found.active[index].tolist()) == sample.mechanism.active


def test_joint_states_say_the_same(scene, bag):
    mechanism = Mechanism(scene)
    own = states_from_bag(bag, mechanism, namespace="left")
    joints = states_from_bag(bag, mechanism, "/left/mechanism/measured_js")
    assert np.abs(joints.q - own.q).max() < 1e-14
    assert (joints.v == own.v).all()
    assert (joints.active == np.array(mechanism.initially_active)).all()


def _embedded(square, rows):
    full = np.zeros((6, 6))
    full[np.ix_(rows, rows)] = square
    return full


def test_it_is_the_analysis_of_each_state(scene, samples, bag):
    mechanism, told = Mechanism(scene), []
    states = states_from_bag(bag, mechanism, namespace="left")
    found = analyse_states(mechanism, states, show=lambda done, total: told.append((done, total)))
    assert told[-1] == (TICKS, TICKS)
    analyser = Analyser(mechanism)
    for index in range(0, TICKS, 37):
        state = samples[index].mechanism
        terms = mechanism.evaluate(state.q, state.v, state.active)
        expected = analyser.analyse(terms)
        assert np.abs(found.s[index] - expected.spectrum.s).max() < 1e-9
        pairs = (
            (found.inverse_inertia, expected.inverse_inertia),
            (found.constraint_projector, expected.constraint_projector),
            (found.wrench_projector, expected.wrench_projector),
            (found.free_acceleration, expected.free_acceleration),
            (found.twist, terms.points[0].twist),
            (found.position, terms.points[0].pose.translation),
        )
        for one, other in pairs:
            assert np.abs(one[index] - other).max() < 1e-9 * max(np.abs(other).max(), 1.0)
        rigid = found.count[index]
        one, other = (
            columns[:, columns.shape[1] - rigid :]
            for columns in (found.wrenches[index], expected.spectrum.wrenches)
        )
        apart = one @ np.linalg.pinv(one) - _embedded(other @ np.linalg.pinv(other), expected.rows)
        assert np.abs(apart).max(initial=0.0) < 1e-7
        assert np.linalg.norm(found.quaternion[index]) == pytest.approx(1.0, abs=1e-12)
    assert found.count.tolist() == [sample.count for sample in samples]
    assert found.times[-1] == pytest.approx((TICKS - 1) * 1e-3, abs=1e-12)


def test_states_come_in_order_of_their_stamps(tmp_path):
    mechanism = Mechanism(load_scene("two_link"))
    layout = StateLayout(mechanism)
    points = len(mechanism.point_names)
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/mechanism/state", STATE.type)
        for stamp in (3_000_000, 1_000_000, 2_000_000):
            q = np.full(mechanism.nq, stamp * 1e-6)
            held = flat_grasps(mechanism.scene)
            wire = WireState(stamp, (), q, q, np.zeros((points, 6)), held, (True,) * points)
            writer.write("/mechanism/state", 0, FlatArray(layout.fields).encode(layout.pack(wire)))
    found = states_from_bag(tmp_path / "bag", mechanism)
    assert found.stamps_ns.tolist() == [1_000_000, 2_000_000, 3_000_000]
    assert found.q[:, 0].tolist() == [1.0, 2.0, 3.0]


def test_what_is_not_of_the_mechanism_is_refused(scene, bag):
    """Each names the bag, and what is wrong with it."""
    mechanism = Mechanism(scene)
    other = Mechanism(load_scene("two_link"))
    (andrews,) = [Mechanism(case.scene) for case in cases() if case.name == "andrews"]
    with pytest.raises(BagError, match="no messages on /mechanism/measured_js"):
        states_from_bag(bag, mechanism)
    with pytest.raises(BagError, match="mechanism/state"):
        states_from_bag(bag, other, namespace="left")
    with pytest.raises(BagError, match="must name"):
        states_from_bag(bag, andrews, "/left/mechanism/measured_js")
    states = states_from_bag(bag, mechanism, namespace="left")
    with pytest.raises(InvalidInputError, match="nowhere"):
        analyse_states(mechanism, states, "nowhere")


def test_another_kind_of_message(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/numbers", "std_msgs/msg/UInt8")
        writer.write(
            "/numbers",
            0,
            STORE.serialize_cdr(STORE.types["std_msgs/msg/UInt8"](1), "std_msgs/msg/UInt8"),
        )
    with pytest.raises(BagError, match="is std_msgs/msg/UInt8, should be"):
        states_from_bag(tmp_path / "bag", Mechanism(load_scene("two_link")), "/numbers")


def test_a_state_that_cannot_be_analysed_is_numbered():
    mechanism = Mechanism(load_scene("five_bar"))
    q = np.zeros((3, mechanism.nq))
    q[1] = np.nan
    states = RecordedStates(
        np.arange(3),
        q,
        np.zeros((3, mechanism.nv)),
        np.ones((3, 1), dtype=bool),
        np.array([flat_grasps(mechanism.scene)] * 3),
        "/here",
    )
    with pytest.raises(HapticMechError, match="state 1 of 3"):
        analyse_states(mechanism, states)


def test_the_command_writes_a_table_and_a_picture(scene, bag, tmp_path):
    out = tmp_path / "out"
    done = ran("analyse", str(bag), "--scene", scene.name, "--namespace", "left", "--out", str(out))
    assert "400 states of /left/mechanism/state" in done.replace("\n", " ")
    with np.load(out / "analysis.npz") as table:
        assert table["inverse_inertia"].shape == (TICKS, 6, 6)
        assert table["count"].shape == (TICKS,)
    assert (out / "analysis.png").read_bytes().startswith(b"\x89PNG")


def test_a_point_held_elsewhere_on_the_way_is_analysed_where_it_was():
    scene = load_scene("five_bar")
    mechanism, session = Mechanism(scene), Session(scene)
    before = mechanism.scene
    samples, grasps = [], []
    for index in range(60):
        if index in (20, 40):
            session.set_operational_point(
                ("link1", "link3")[index == 40], Origin(xyz=(0.02, 0.01, 0.0))
            )
        samples.append(session.tick())
        grasps.append(flat_grasps(session.simulator.scene))
    states = RecordedStates(
        np.arange(60) * 1_000_000,
        np.array([sample.mechanism.q for sample in samples]),
        np.array([sample.mechanism.v for sample in samples]),
        np.ones((60, 1), dtype=bool),
        np.array(grasps),
        "mechanism/state",
    )
    for _ in range(2):  # the mechanism is left as it was found
        found = analyse_states(mechanism, states)
        for index, sample in enumerate(samples):
            expected = sample.analysis.inverse_inertia
            error = np.abs(found.inverse_inertia[index] - expected).max()
            # By two kernels, whose sums are in another order.
            assert error < 1e-12 * np.abs(expected).max()
            assert np.abs(found.position[index] - sample.point.pose.translation).max() < 1e-15
    assert mechanism.scene == before
