# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The record of a session."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from commands import ran
from hapticmech_ros import load_scene
from hapticmech_ros.cli import app
from hapticmech_ros.errors import InaccurateStepError, InvalidInputError
from hapticmech_ros.experiment import SessionRecorder, run_session
from hapticmech_ros.experiment.from_session import UnfinishedRunError
from hapticmech_ros.session import Session
from oracles.running import varied


def test_time_zero_is_the_first_push(session_record, scene):
    record = session_record
    pushing = record.hand_wrench.any(axis=1)
    assert (pushing == (record.times >= 0.0)).all()
    assert record.times[0] == pytest.approx(-scene.hand.start_delay, abs=1e-12)
    assert record.times[-1] == pytest.approx(2.5, abs=1e-12)
    assert record.source == "session"
    assert record.point == "handle"


@pytest.mark.parametrize("sensor", ["estimated", "absent"])
def test_without_a_sensor_time_zero_is_where_the_hand_starts(scene, sensor):
    coarse = {"force_sensor": sensor, "position_resolution": 1e-6}
    record = run_session(varied(scene, device=coarse), 0.05)
    assert record.times[0] == pytest.approx(-scene.hand.start_delay, abs=1e-12)
    assert record.times[-1] == pytest.approx(0.05, abs=1e-12)


def test_holds_what_the_session_measured(session_record, samples):
    assert session_record.times.size == len(samples)
    for index in (0, 126, 700, len(samples) - 1):
        sample, (kinetic, _) = samples[index]
        assert (session_record.device_position[index] == sample.device.pose.translation).all()
        assert (session_record.point_position[index] == sample.point.pose.translation).all()
        assert (session_record.constraint_wrench[index] == sample.output.joint_constraint).all()
        assert session_record.count[index] == sample.count
        assert session_record.kinetic[index] == kinetic
        balanced = sample.analysis.wrench_projector @ sample.hand_wrench
        assert (session_record.expected_wrench[index] == -balanced).all()


def test_feedforward_leaves_less_to_expect(scene):
    with_it = varied(scene, controller={"joint_constraint": {"feedforward": 0.75}})
    records = [run_session(one, 0.01) for one in (scene, with_it)]
    plain, fed = (record.expected_wrench[record.times >= 0.0][0] for record in records)
    assert np.abs(plain).max() > 1e-3
    assert fed == pytest.approx(0.25 * plain, rel=1e-12)


def test_tells_progress(scene):
    told = []
    run_session(scene, 0.15, told.append)
    assert told[-1] == 1.0
    assert told == sorted(told)
    assert 50 <= len(told) <= 202


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), float("inf")])
def test_refuses_durations(scene, duration):
    with pytest.raises(InvalidInputError, match="duration: must be a positive"):
        run_session(scene, duration)


def test_refuses_unknown_points_and_empty_records(scene):
    with pytest.raises(InvalidInputError, match="operational point"):
        run_session(scene, 0.1, point="nose")
    with pytest.raises(InvalidInputError, match="samples: must be at least one"):
        SessionRecorder(Session(scene)).record()


def test_a_hand_that_never_pushes_starts_after_its_delay(scene):
    idle = {"force": (0.0, 0.0, 0.0), "torque": (0.0, 0.0, 0.0)}
    record = run_session(varied(scene, hand=idle), 0.01)
    assert record.times[0] == pytest.approx(-0.25, abs=1e-12)


def _numbers(by_joint):
    return {name: value[0] for name, value in by_joint.items()}


# A spring that is too stiff for the step, and nothing that watches it.
TOO_STIFF = (
    "links[0].joint.stiffness=1e5",
    "simulation.accuracy={tolerance: 0.0}",
    "simulation.integrator=rk4",
)


@pytest.mark.parametrize("name", ["two_link", "two_users"])
def test_a_run_that_an_error_ends_leaves_what_there_was(tmp_path, name):
    changes = [part for change in TOO_STIFF for part in ("--set", change)]
    with pytest.raises(UnfinishedRunError, match=r"^at [0-9.]+ s: ") as caught:
        ran("experiment", name, "--out", tmp_path / "out", *changes)
    written = json.loads((tmp_path / "out" / "failure.json").read_text())
    assert written["error"] == str(caught.value)
    assert written["time_s"] == caught.value.time > 0.0
    scene = load_scene(name, changes=TOO_STIFF)
    assert set(written["last_state"]["q"]) == {link.joint.name for link in scene.links}
    assert written["joint"] in written["last_state"]["q"]
    # What grew without bound is not the last good state, and a scene can start there.
    assert 0.0 <= written["last_state_time_s"] < written["time_s"]
    for kind, largest in (("q", scene.limits.joint_position), ("v", scene.limits.joint_velocity)):
        numbers = np.concatenate(list(written["last_state"][kind].values()))
        assert np.abs(numbers).max() <= largest
    scene.with_(initial_state={k: _numbers(v) for k, v in written["last_state"].items()})
    record = caught.value.record
    assert record is not None
    times = getattr(record, "first", record).times
    assert times.size == round(caught.value.time / scene.simulation.period)
    # The last state is where the record ends.
    last = np.concatenate(list(written["last_state"]["q"].values()))
    assert np.isfinite(last).all()


def test_a_record_until_an_error_is_that_of_a_run_without_it(scene):
    session = Session(scene)
    recorder = SessionRecorder(session)
    for _ in range(20):
        recorder.add(session.tick())
    failure = recorder.unfinished(InvalidInputError("something", 1, "must be 2"))
    np.testing.assert_array_equal(failure.record.joint_positions, recorder.record().joint_positions)
    assert failure.time == pytest.approx(20 * session.period)
    q = np.concatenate(list(failure.positions.values()))
    np.testing.assert_array_equal(q, session.mechanism.q)


def test_the_joint_of_an_inaccurate_step_is_told(scene):
    recorder = SessionRecorder(Session(scene))
    assert recorder.unfinished(InaccurateStepError("joint3", 1.0, 2.0)).joint == "joint3"


def test_a_folder_has_the_results_of_the_last_run_only(tmp_path):
    arguments = ["experiment", "two_link", "--duration", "0.2", "--out", str(tmp_path)]
    bad = [part for change in TOO_STIFF for part in ("--set", change)]
    files = []
    for further in (bad, [], bad):
        CliRunner().invoke(app, [*arguments, *further])
        files.append({path.name for path in tmp_path.iterdir()})
    assert files[0] == files[2] == {"failure.json"}
    assert files[1] == {"fig5a.png", "fig5b.png", "fig5c.png", "summary.json"}
