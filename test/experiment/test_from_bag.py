# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A bag made of a session's samples gives the session's record."""

import copy
import dataclasses

import numpy as np
import pytest

from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.experiment import compare, record_from_bag
from hapticmech_ros.experiment.summary import count_changes
from oracles.running import varied

VIEW = ("constraint_wrench", "kinetic", "potential", "work_in", "damping_loss", "closure_error")
CONTROL = (
    "device_position",
    "device_orientation",
    "point_position",
    "point_orientation",
    "hand_wrench",
    "s",
    "joint_positions",
)
# Times: whole ns since the push against products of ticks and period, 3 s at most.
TIME_TOLERANCE = 2e-15
# The device's rotation is a product of a matrix for each of 4 steps in 1,376 periods, each rounded
# to 1.1e-16: by the root of their number it is 8e-15 off a rotation, of which a message's
# quaternion and that of the matrix make different ones.
DEVICE_TURNED = 8e-15


def halved(data, part, factor=0.5):
    """Return a message's data with a part of it halved, or multiplied by another factor."""
    changed = np.array(data)
    changed[part] *= factor
    return changed


def assert_same(record, session):
    assert record.source == "graph"
    assert record.times == pytest.approx(session.times, abs=TIME_TOLERANCE)
    assert record.wrench_times == pytest.approx(session.times[::10], abs=TIME_TOLERANCE)
    for name in CONTROL:
        # Points are interpolated, at shares of 0 or next to it; joints go by the neutral pose.
        found, expected = getattr(record, name), getattr(session, name)
        bound = DEVICE_TURNED if name == "device_orientation" else 4e-15
        assert np.abs(found - expected).max() <= bound, name
    for name in VIEW:
        assert (getattr(record, name) == getattr(session, name)[::10]).all(), name
    assert (record.count == session.count).all()
    assert np.abs(record.expected_wrench - session.expected_wrench).max() < 1e-15
    changes, expected = count_changes(record), count_changes(session)
    assert [(c["from"], c["to"]) for c in changes] == [(1, 2)]
    assert changes[0]["time_s"] == pytest.approx(expected[0]["time_s"], abs=TIME_TOLERANCE)


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_bag_of_a_session_gives_its_record(make_bag, scene, session_record, storage):
    record = record_from_bag(make_bag(storage), scene)
    assert_same(record, session_record)
    agreement = compare(record, session_record)
    assert agreement["device_deviation_max_mm"] < 1e-11
    assert agreement["point_deviation_max_deg"] < 1e-12
    assert agreement["count_change_difference_max_s"] < 1e-14


def test_under_a_namespace(make_bag, scene, session_record):
    bag = make_bag(namespace="/lab/left")
    assert_same(record_from_bag(bag, scene, namespace="lab/left"), session_record)
    assert_same(record_from_bag(bag, scene, namespace="/lab/left/"), session_record)
    with pytest.raises(BagError, match=r"missing topics: .*the bag has the namespace /lab/left"):
        record_from_bag(bag, scene)


def test_deadlines_of_their_own_are_interpolated(make_bag, scene, session_record):
    """The mechanism's stamps lie half a period later: the record is at the device's times."""

    def later(topic, time_ns, message):
        if not topic.startswith("analysis"):
            return message
        message = copy.deepcopy(message)
        seconds, rest = divmod(round(message.data[1]) + 1_000_000, 10**9)
        message.data[:2] = message.data[0] + seconds, rest
        return message

    record = record_from_bag(make_bag(change=later), scene)
    # The device's first sample precedes the point's first one, and is left out.
    assert record.times == pytest.approx(session_record.times[1:], abs=TIME_TOLERANCE)
    middle = (session_record.point_position[1:] + session_record.point_position[:-1]) / 2
    assert record.point_position == pytest.approx(middle, abs=1e-15)
    assert (record.device_position == session_record.device_position[1:]).all()


def test_order_of_arrival_and_repeats_do_not_matter(make_bag, messages, scene, session_record):
    repeats = [item for item in messages if item[0] == "device/state"][5:50][::-1]
    assert_same(record_from_bag(make_bag(extra=repeats), scene), session_record)


def test_lost_messages_leave_gaps(make_bag, scene, session_record):
    lost = {"device/state": 11, "analysis/handle/operational_model": 13}
    seen = dict.fromkeys(lost, 0)

    def lose(topic, time_ns, message):
        if topic not in lost:
            return message
        seen[topic] += 1
        return None if seen[topic] % lost[topic] == 0 else message

    record = record_from_bag(make_bag(change=lose), scene)
    kept = np.isin(np.round(session_record.times * 1e3), np.round(record.times * 1e3))
    assert record.times.size == pytest.approx(session_record.times.size * 10 / 11, abs=2)
    assert (record.device_position == session_record.device_position[kept]).all()
    # Linear interpolation over 4 ms at accelerations below 0.5 m/s².
    apart = np.abs(record.point_position - session_record.point_position[kept]).max()
    assert apart < 0.5 * 0.004**2 / 8


def test_cuts_before_the_hold_and_after_the_duration(make_bag, scene, session_record):
    quick = varied(scene, hand={"start_delay": 0.1})
    record = record_from_bag(make_bag(), quick, duration=1.0)
    assert (record.times[0], record.times[-1]) == pytest.approx((-0.1, 1.0), abs=1e-12)
    assert (record.wrench_times[0], record.wrench_times[-1]) == pytest.approx(
        (-0.09, 0.99), abs=1e-12
    )
    assert (record.analysis_times[-1], record.energy_times[-1]) == pytest.approx(
        (1.0, 0.99), abs=1e-12
    )


def test_names_what_is_missing_or_of_another_type(make_bag, messages, scene):
    bag = make_bag(without=("device/state", "mechanism/energy"))
    with pytest.raises(BagError, match=r"missing topics: /device/state, /mechanism/energy$"):
        record_from_bag(bag, scene)
    _, kind, time_ns, message = next(m for m in messages if m[0] == "mechanism/measured_js")
    bag = make_bag(without=("device/state",), extra=[("/device/state", kind, time_ns, message)])
    with pytest.raises(BagError, match=r"another type: /device/state \(is .*JointState"):
        record_from_bag(bag, scene)


def test_joint_states_are_only_welcome(make_bag, scene):
    record = record_from_bag(make_bag(without=("mechanism/measured_js",)), scene)
    assert record.joint_positions.shape == (0, 4)


@pytest.mark.parametrize(
    ("topic", "spoil", "message"),
    [
        (
            "analysis/handle/operational_model",
            lambda m: dataclasses.replace(m, data=m.data[:-1]),
            "operational_model, message 0: .*must hold 151 numbers",
        ),
        (
            "mechanism/energy",
            lambda m: dataclasses.replace(m, data=m.data * np.inf),
            "energy, message 0: .*must be finite",
        ),
        (
            "controller/joint_constraint_cf",
            lambda m: dataclasses.replace(
                m, wrench=dataclasses.replace(m.wrench, force=type(m.wrench.force)(np.nan, 0, 0))
            ),
            "joint_constraint_cf, message 0 in order of time: holds a value that is not finite",
        ),
        (
            "device/state",
            lambda m: dataclasses.replace(m, data=halved(m.data, slice(5, 9))),
            "state, message 0: length of quaternion: quaternion must have unit length",
        ),
        (
            "mechanism/measured_js",
            lambda m: dataclasses.replace(m, position=m.position[:-1]),
            "coordinates in mechanism/measured_js: must be 4",
        ),
        (
            "analysis/handle/operational_model",
            lambda m: None,
            r"topics without messages: /analysis/handle/operational_model$",
        ),
        (
            "device/state",
            lambda m: dataclasses.replace(m, data=halved(m.data, slice(15, None), 0.0)),
            "the hand never pushed",
        ),
    ],
)
def test_refuses_messages_that_break_rules(make_bag, scene, topic, spoil, message):
    def change(name, time_ns, original):
        return spoil(original) if name == topic else original

    with pytest.raises(BagError, match=message), np.errstate(invalid="ignore"):
        record_from_bag(make_bag(change=change), scene)


@pytest.mark.parametrize(
    ("bag", "point", "error", "rule"),
    [
        (".", "nose", InvalidInputError, "operational point"),
        ("nowhere", "", BagError, "no bag at"),
        (".", "", BagError, "cut short"),
    ],
)
def test_unknown_point_and_no_bag(scene, tmp_path, bag, point, error, rule):
    with pytest.raises(error, match=rule):
        record_from_bag(tmp_path / bag, scene, point=point)
