# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sums of hand-made records with known answers."""

import json

import numpy as np
import pytest

from hapticmech_ros.experiment import GraphHealth, NodeHealth, summarise
from hapticmech_ros.experiment.summary import count_changes
from hapticmech_ros.wire.messages import ENERGY_NAMES


def assert_has(found, wanted, rel):
    """Check that a part of a summary has these values; a zero is one exactly."""
    assert {key: found[key] for key in wanted} == pytest.approx(wanted, rel=rel, abs=0.0)


def turned(n, angle):
    return np.tile((0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2)), (n, 1))


def test_constant_error_is_its_own_rms(handmade, scene):
    n = 1001
    record = handmade(
        device_position=np.tile((3e-4, -4e-4, 0.0), (n, 1)), device_orientation=turned(n, 0.02)
    )
    tracking = summarise(record, scene)["tracking"]
    for key in ("rms", "max", "end"):
        assert tracking[f"position_error_{key}_m"] == pytest.approx(5e-4, rel=1e-14)
        assert tracking[f"rotation_error_{key}_rad"] == pytest.approx(0.02, rel=1e-12)


def test_what_comes_before_the_push_does_not_count(handmade, scene):
    times = handmade().times
    early = np.where(times < 0.0, 1.0, 0.0)[:, None] * np.ones(3)
    tracking = summarise(handmade(device_position=early), scene)["tracking"]
    assert tracking["position_error_max_m"] == 0.0


def test_ramp_error(handmade, scene):
    times = handmade().times
    ramp = np.zeros((times.size, 3))
    ramp[:, 1] = 1e-3 * times
    tracking = summarise(handmade(device_position=ramp), scene)["tracking"]
    # Sum of k² for k = 0..900 over 901 samples: rms = end sqrt((2 n + 1) / (6 n)), n = 900.
    assert tracking["position_error_rms_m"] == pytest.approx(9e-3 * np.sqrt(1801 / 5400), rel=1e-12)
    assert tracking["position_error_max_m"] == pytest.approx(9e-3, rel=1e-12)


def test_counts_and_their_changes(handmade, scene):
    times = handmade().times
    count = np.select([times < 2.0, times < 6.0], [1, 2], 0)
    constraints = summarise(handmade(count=count), scene)["constraints"]
    assert constraints["counts_seen"] == [0, 1, 2]
    assert constraints["changes"] == [
        {"time_s": 2.0, "from": 1, "to": 2},
        {"time_s": 6.0, "from": 2, "to": 0},
    ]
    assert count_changes(handmade()) == []
    held = {entry["count"]: entry["held_s"] for entry in constraints["while_held"]}
    # The last sample's period lies beyond the record.
    assert held == pytest.approx({0: 3.0, 1: 2.0, 2: 4.0}, abs=1e-12)


def test_wrench_while_each_count_holds(handmade, scene):
    record = handmade()
    count = np.where(record.analysis_times < 3.0, 1, 2)
    late = record.wrench_times >= 3.0
    wrench = np.zeros((record.wrench_times.size, 6))
    wrench[~late] = (3.0, 0.0, 4.0, 0.0, 0.0, 0.1)
    wrench[late] = (0.0, 12.0, 0.0, 0.3, 0.0, 0.4)
    wrench[record.wrench_times < 0.0] = 99.0
    expected = np.zeros((record.analysis_times.size, 6))
    expected[count == 1] = (3.0, 0.0, 4.0, 0.0, 0.0, 0.2)
    expected[count == 2] = (0.0, 6.0, 0.0, 0.0, 0.0, 0.0)
    summary = summarise(
        handmade(count=count, constraint_wrench=wrench, expected_wrench=expected), scene
    )
    one = {
        "count": 1,
        "samples": 30,
        "force_rms_n": 5.0,
        "torque_rms_nm": 0.1,
        "force_to_expected_ratio": 1.0,
        "torque_to_expected_ratio": 0.5,
        "force_gain_median": 1.0,
        "force_difference_rms_n": 0.0,
    }
    two = {
        "count": 2,
        "samples": 61,
        "force_rms_n": 12.0,
        "force_max_n": 12.0,
        "torque_rms_nm": 0.5,
        "force_to_expected_ratio": 2.0,
        "force_gain_median": 2.0,
        "force_difference_rms_n": 6.0,
    }
    for held, wanted in zip(summary["constraints"]["while_held"], (one, two), strict=True):
        assert_has(held, wanted, 1e-14)
    assert held["torque_to_expected_ratio"] is None


def test_a_few_samples_that_ring_do_not_change_the_typical_gain(handmade, scene):
    record = handmade()
    wrench = np.zeros((record.wrench_times.size, 6))
    wrench[:, 0] = 1.9
    wrench[:, 1] = 0.7  # across what is expected: no part of the gain
    wrench[30:35, 0] = 50.0
    expected = np.zeros((record.analysis_times.size, 6))
    expected[:, 0] = np.where(record.analysis_times < 4.0, 2.0, 0.1)
    summary = summarise(handmade(constraint_wrench=wrench, expected_wrench=expected), scene)
    (held,) = summary["constraints"]["while_held"]
    assert held["force_gain_median"] == pytest.approx(0.95, rel=1e-12)
    assert held["force_to_expected_ratio"] > 2.0


def test_a_gain_needs_something_expected(handmade, scene):
    (held,) = summarise(handmade(), scene)["constraints"]["while_held"]
    assert held["force_gain_median"] is None


def test_what_steps_made_from_nothing_and_how_many_were_inaccurate(handmade, scene):
    """The surplus of the record's own time; steps since the mechanism's start, as its account."""
    n = handmade().energy_times.size
    told = {
        "surplus": np.linspace(0.5, -0.25, n),
        "refined": np.arange(n) + 7.0,
        "inaccurate": np.floor(np.arange(n) / 10.0),
    }
    energy = summarise(handmade(**told), scene)["energy"]
    assert energy["surplus_j"] == pytest.approx(-0.75, rel=1e-12)
    assert (energy["steps_refined"], energy["steps_inaccurate"]) == (n + 6, (n - 1) // 10)
    assert all(isinstance(energy[f"steps_{key}"], int) for key in ("refined", "inaccurate"))


def test_energy_that_leaks(handmade, scene):
    n = handmade().energy_times.size
    work = np.concatenate((np.linspace(0.0, 2.0, 51), np.linspace(2.0, 1.0, n - 51)))
    kinetic = work.copy()
    kinetic[70] -= 0.03
    energy = summarise(handmade(work_in=work, kinetic=kinetic), scene)["energy"]
    wanted = {
        "balance_error_max_j": 0.03,
        "exchanged_j": 3.0,
        "balance_error_relative": 0.01,
        "work_in_j": 1.0,
    }
    assert_has(energy, wanted, 1e-12)


def test_closure_error(handmade, scene):
    error = np.zeros(101)
    error[50], error[0] = 1e-9, 1.0
    summary = summarise(handmade(closure_error=error), scene)
    assert summary["closure_error_max_m_or_rad"] == 1e-9
    open_scene = scene.model_copy(update={"closures": ()})
    assert summarise(handmade(), open_scene)["closure_error_max_m_or_rad"] is None


def test_rate_of_a_graph(handmade, scene):
    times = handmade().times
    kept = np.ones(times.size, dtype=bool)
    kept[[300, 301, 500]] = False
    rows = {
        name: getattr(handmade(), name)[kept]
        for name in (
            "device_position",
            "device_orientation",
            "point_position",
            "point_orientation",
            "hand_wrench",
        )
    }
    health = GraphHealth(
        {
            "haptic_device": NodeHealth(
                "ok",
                "rendering",
                {"missed_deadlines": 2, "loop_latency_p50_us": 510.0, "loop_latency_max_us": 4000},
            ),
            "mechanism_simulator": NodeHealth("warning", "late", {"missed_deadlines": 3}),
        }
    )
    graph = summarise(handmade(source="graph", times=times[kept], **rows), scene, health)["graph"]
    wanted = {
        "nominal_rate_hz": 100.0,
        "measured_gaps": 2,
        "missed_deadlines": 5,
        "loop_latency_p50_us": 510.0,
    }
    assert_has(graph, wanted, 1e-14)
    assert graph["loop_latency_p99_us"] is None
    assert graph["measured_rate_hz"] == pytest.approx(99.7, rel=1e-12)
    assert graph["measured_interval_max_ms"] == pytest.approx(30.0, rel=1e-9)
    assert graph["nodes"]["mechanism_simulator"]["level"] == "warning"


def test_is_json_even_where_nothing_is_known(handmade, scene):
    none = np.zeros(0)
    energies = dict.fromkeys(ENERGY_NAMES, none)
    record = handmade(source="graph", energy_times=none, **energies)
    summary = summarise(record, scene)
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["energy"]["balance_error_max_j"] is None
    assert summary["graph"]["missed_deadlines"] is None
    assert summary["graph"]["nodes"] == {}
    assert "graph" not in summarise(handmade(), scene)


def test_joints_answer_the_push_as_physics_expects(session_record, scene):
    """The paper's law: the constraint wrench balances the hand's push along n_c, count by count."""
    constraints = summarise(session_record, scene)["constraints"]
    assert constraints["counts_seen"] == [1, 2]
    one, two = constraints["while_held"]
    assert two["force_rms_n"] > 1.2 * one["force_rms_n"]
    for held in (one, two):
        # Spring and damper follow the push but for transients of 50 ms in 2 s.
        assert held["force_to_expected_ratio"] == pytest.approx(1.0, abs=0.02)
        assert held["torque_to_expected_ratio"] == pytest.approx(1.0, abs=0.02)
