# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The experiment of several users: records, spans, summary, figures, and the command."""

import json
from pathlib import Path

import numpy as np
import pytest

from commands import ran
from hapticmech_ros import SharedSession, load_scene
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.experiment.figures import coupling_figure, users_figure
from hapticmech_ros.experiment.from_bag import shared_record_from_bag
from hapticmech_ros.experiment.from_session import run_shared_session
from hapticmech_ros.experiment.record import Grips, SharedRecord, grips_of
from hapticmech_ros.experiment.report import tables
from hapticmech_ros.experiment.run import write_shared_results
from hapticmech_ros.experiment.summary import summarise_shared

DURATION = 0.7
POINTS = ("left", "right")


def shortened(duration=DURATION):
    """Return the scene with left letting go at 0.5 s."""
    return load_scene("two_users").with_(
        "hands[0].hand.release_at=[0.5]", f"experiment.duration={duration}"
    )


@pytest.fixture(scope="module")
def scene():
    return shortened()


@pytest.fixture(scope="module")
def record(scene):
    return run_shared_session(scene)


def line(axes, colour, style="-"):
    (found,) = [
        one
        for one in axes.get_lines()
        if one.get_color() == colour and one.get_linestyle() == style
    ]
    return np.asarray(found.get_xdata(), float), np.asarray(found.get_ydata(), float)


def test_all_users_have_one_time_zero_the_first_push_of_any(record):
    pushing = np.array([user.hand_wrench.any(axis=1) for user in record.users.values()]).any(axis=0)
    for user in record.users.values():
        assert np.array_equal(user.times, record.first.times)
        assert np.array_equal(pushing, user.times >= 0.0)
    assert record.first.times[-1] == pytest.approx(DURATION, abs=2e-3)
    assert record.points == POINTS
    assert (record.scene, record.source) == ("two_users", "session")


def test_it_holds_what_the_session_measured(scene, record):
    rows = SharedSession(scene).run(record.first.times.size, every=10)
    assert record.times.size == len(rows["left"])
    for index, (point, run) in enumerate(rows.items()):
        assert np.array_equal(record.wrenches[:, index], run["on_mechanism"])
        assert np.array_equal(record.felt[:, index], run["external"])
        assert np.array_equal(record.users[point].device_position[::10], run["device_position"])
        assert np.array_equal(record.users[point].count[::10], run["count"])
    assert np.abs(record.felt[:, :, 0]).max() > 1.0


def test_what_is_felt_accelerates_as_the_others_do(record):
    """X_ii F_c = Σ X_ij F_j: here no direction is between rigid and free."""
    for index, point in enumerate(POINTS):
        by_each = record.accelerations(point)
        others = by_each.sum(axis=1) - by_each[:, index]
        felt = np.einsum("kab,kb->ka", record.coupling[:, index, index], record.felt[:, index])
        assert np.abs(felt - others).max() < 1e-12 * np.abs(others).max()
    with pytest.raises(InvalidInputError, match="must be one of"):
        record.accelerations("middle")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"users": {}}, "at least one of each"),
        ({"wrenches": np.zeros((1, 3, 6))}, "shape of wrenches"),
        ({"felt": np.zeros((3, 2, 6))}, "shape of felt"),
        ({"coupling": np.zeros((2, 2, 6, 6))}, "shape of coupling"),
        ({"times": np.array([np.nan])}, "finite"),
    ],
)
def test_a_bad_record_is_refused(record, change, words):
    fields = {name: getattr(record, name)[:1] for name in ("times", "wrenches", "felt", "coupling")}
    SharedRecord(record.users, **fields)
    with pytest.raises(InvalidInputError, match=words):
        SharedRecord(**{"users": record.users, **fields, **change})


def test_spans_are_between_releases_and_grabs():
    scene = load_scene("two_users").with_(
        "hands[0].hand.release_at=[1.0, 3.0]",
        "hands[0].hand.grab_at=[2.0]",
        "hands[1].hand.grab_at=[1.5]",
        "hands[1].hand.start_delay=0.75",
    )
    assert grips_of(scene, 2.8) == [
        Grips(0.0, 0.5, ("left",)),
        Grips(0.5, 1.0, ("left",)),
        Grips(1.0, 2.0, ()),
        Grips(2.0, 2.8, ("left", "right")),
    ]


def test_the_summary_is_of_each_user_and_each_span(scene, record):
    summary = json.loads(json.dumps(summarise_shared(record, scene), allow_nan=False))
    assert tuple(summary["users"]) == POINTS
    assert [user["operational_point"] for user in summary["users"].values()] == list(POINTS)
    (held, free) = summary["spans"]
    assert (held["holding"], free["holding"]) == (["left", "right"], ["right"])
    assert (held["begin_s"], held["end_s"], free["begin_s"]) == (0.0, 0.5, 0.5)
    left = record.users["left"]
    during = (left.times >= 0.0) & (left.times < 0.5)
    moved = np.linalg.norm(left.device_position - left.device_position[0], axis=1)[during].max()
    found = held["users"]["left"]
    assert found["displacement_max_m"] == pytest.approx(moved, rel=1e-12)
    force = np.linalg.norm(left.hand_wrench[during, :3], axis=1)
    assert found["hand_force_rms_n"] == pytest.approx(np.sqrt(np.mean(force**2)), rel=1e-12)
    assert found["counts_seen"] == [1]
    assert free["users"]["left"]["hand_force_rms_n"] < 0.2 * found["hand_force_rms_n"]
    assert found["mass_least_kg"] == pytest.approx(3.69, abs=0.15)
    assert set(found["acceleration_rms_m_per_s2"]) == set(POINTS)
    titles = [table.title for table in tables(summary)]
    assert titles[:2] == ["two_users, left (session)", "two_users, right (session)"]
    assert len(titles) == 3


def test_the_figure_of_users_draws_what_they_did(scene, record):
    figure = users_figure(record, scene, record)
    columns = np.array(figure.axes).reshape(4, 2).T
    for (moved, force, constraint, count), (point, user) in zip(
        columns, record.users.items(), strict=True
    ):
        assert moved.get_title() == point
        for colour, axis in (("#0072B2", 0), ("#D55E00", 1)):
            shift = user.device_position[:, axis] - user.device_position[0, axis]
            assert np.array_equal(line(moved, colour)[1], 1e3 * shift)
            assert np.array_equal(line(force, colour)[1], user.hand_wrench[:, axis])
            assert np.array_equal(line(constraint, colour)[1], user.constraint_wrench[:, axis])
        assert np.array_equal(line(count, "#0072B2")[1], user.count)
        words = [text.get_text() for text in moved.texts]
        assert words == ["left lets go"]
    assert columns[0][0].get_ylabel() == "displacement (mm)"
    assert columns[0][3].get_xlabel().endswith("(s)")
    assert figure.texts[0].get_text().startswith("two_users. What each user does")


def test_the_figure_of_couplings_draws_what_each_does_to_the_other(scene, record):
    figure = coupling_figure(record, scene)
    rows = np.array(figure.axes).reshape(3, 2)
    for index, (force, acceleration, mobility) in enumerate(rows.T):
        other, point = 1 - index, POINTS[index]
        assert force.get_title() == f"{POINTS[other]} → {point}"
        assert np.array_equal(line(force, "#0072B2")[1], record.felt[:, index, 0])
        assert np.array_equal(line(force, "#0072B2", "--")[1], record.wrenches[:, other, 0])
        found = record.accelerations(point)
        assert np.array_equal(line(acceleration, "#D55E00")[1], found[:, other, 1])
        assert np.array_equal(line(acceleration, "#D55E00", "--")[1], found[:, index, 1])
        sizes = np.linalg.svd(record.coupling[:, index, other, :2, :2], compute_uv=False)
        assert line(mobility, "#CC79A7")[1] == pytest.approx(sizes[:, 0])
        assert line(mobility, "#CC79A7", "--")[1] == pytest.approx(sizes[:, 1])
        assert mobility.get_ylim()[0] == 0.0
        assert mobility.get_xlabel().endswith("(s)")
    assert rows[1, 0].get_ylabel() == "acceleration (m/s²)"


def test_results_are_written_for_each_user(tmp_path, scene, record):
    summary = write_shared_results(record, scene, tmp_path, reference=record)
    own = [f"{point}/fig5{letter}.png" for point in POINTS for letter in "abc"]
    assert summary["figures"] == ["users.png", "coupling.png", *own]
    for name in summary["figures"]:
        assert (tmp_path / name).stat().st_size > 20_000
    for point in POINTS:
        assert summary["users"][point]["agreement"]["device_deviation_max_mm"] == 0.0
    assert json.loads((tmp_path / "summary.json").read_text()) == summary


def test_the_command_does_it(tmp_path):
    out = tmp_path / "out"
    arguments = ["experiment", "two_users", "--duration", "0.2", "--out", str(out)]
    found = ran(*arguments)
    assert "two_users, right (session)" in found
    assert {path.name for path in out.iterdir()} == {
        *("left", "right", "users.png", "coupling.png", "summary.json")
    }
    with pytest.raises(InvalidInputError, match="each is set in the scene"):
        ran(*arguments, "--push", "1,0,0")


@pytest.mark.parametrize(
    ("make", "error", "rule"),
    [
        (lambda scene: shared_record_from_bag(Path("nowhere"), scene), BagError, "no bag at"),
        (
            lambda scene: run_shared_session(scene, 0.0),
            InvalidInputError,
            "duration: must be a positive",
        ),
    ],
)
def test_of_no_bag_and_durations_errors_tell(scene, make, error, rule):
    with pytest.raises(error, match=rule):
        make(scene)
