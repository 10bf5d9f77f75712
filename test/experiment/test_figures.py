# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures: files, and that what is drawn is what was recorded."""

import dataclasses

import numpy as np
import pytest

from hapticmech_ros.experiment.figure_style import LEAST_RATIO, at_least, mark_changes, new_figure
from hapticmech_ros.experiment.figures import (
    FIGURES,
    count_figure,
    trajectory_figure,
    wrench_figure,
    write_figures,
)
from hapticmech_ros.experiment.from_session import run_session
from hapticmech_ros.loading import load_scene
from oracles.running import varied


@pytest.fixture(scope="module")
def spatial():
    scene = load_scene("spatial_arm")
    return scene, run_session(scene, 0.3)


def line(axes, label):
    (found,) = [item for item in axes.get_lines() if item.get_label() == label]
    return np.asarray(found.get_xdata(), float), np.asarray(found.get_ydata(), float)


def size_of_png(path):
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


@pytest.mark.parametrize("kind", ["planar", "planar with reference", "spatial"])
def test_writes_pngs_of_sensible_size(tmp_path, scene, session_record, spatial, kind):
    if kind == "spatial":
        scene, session_record = spatial
    reference = session_record if kind.endswith("reference") else None
    paths = write_figures(session_record, scene, tmp_path, reference)
    assert [path.name for path in paths] == ["fig5a.png", "fig5b.png", "fig5c.png"]
    for path in paths:
        width, height = size_of_png(path)
        assert 1000 <= width <= 2000
        assert 600 <= height <= 1400
        assert path.stat().st_size > 20_000


def test_5a_draws_the_count(session_record, scene):
    figure = count_figure(session_record, scene)
    top, bottom = figure.axes
    times, count = line(top, "session")
    assert (times == session_record.analysis_times).all()
    assert (count == session_record.count).all()
    for index in range(3):
        drawn = np.asarray(bottom.get_lines()[index].get_ydata())
        assert (drawn == np.maximum(session_record.s[:, index], 1e-3)).all()
    assert top.get_ylabel() == "joint constraints (1)"
    assert bottom.get_xlabel().endswith("(s)")
    assert figure.texts[0].get_text().startswith("Fig. 5a. Number of virtual joint constraints")


def test_5b_draws_both_trajectories(session_record, scene):
    figure = trajectory_figure(session_record, scene)
    main, _, error = figure.axes
    for label, positions in (
        ("operational point", session_record.point_position),
        ("hand on the device", session_record.device_position),
    ):
        x, y = line(main, label)
        assert (np.column_stack((x, y)) == 1e3 * positions[:, :2]).all()
    for label, index in (("start", 0), ("end", -1)):
        x, y = line(main, label)
        assert (x[0], y[0]) == tuple(1e3 * session_record.device_position[index, :2])
    assert main.get_aspect() == 1.0
    assert (main.get_xlabel(), main.get_ylabel()) == ("x (mm)", "y (mm)")
    x, y = line(main, "reach of the links to the ground pin")
    assert np.hypot(x - 90.0, y) == pytest.approx(np.full(x.size, 105.0), rel=1e-12)
    times, distance = line(error, "distance (mm)")
    assert (times == session_record.times).all()
    apart = session_record.device_position - session_record.point_position
    assert distance == pytest.approx(1e3 * np.linalg.norm(apart, axis=1), rel=1e-14)


def test_5b_draws_three_views_of_space(spatial):
    scene, record = spatial
    *views, _ = trajectory_figure(record, scene).axes
    for axes, plane in zip(views, ((0, 1), (0, 2), (1, 2)), strict=True):
        x, y = line(axes, "operational point")
        assert (np.column_stack((x, y)) == 1e3 * record.point_position[:, list(plane)]).all()
        assert axes.get_xlabel() == f"{'xyz'[plane[0]]} (mm)"


def test_5b_does_without_a_mechanism_and_changes(handmade, scene):
    record = handmade(joint_times=np.zeros(0), joint_positions=np.zeros((0, 4)))
    labels = [item.get_label() for item in trajectory_figure(record, scene).axes[0].get_lines()]
    assert "mechanism at the start" not in labels
    assert "operational point" in labels


def test_5c_draws_the_wrench_and_what_is_expected(session_record, scene):
    figure = wrench_figure(session_record, scene)
    top, bottom = figure.axes
    for axes, label, column, scale in (
        (top, "$F_x$", 0, 1.0),
        (top, "$F_y$", 1, 1.0),
        (bottom, "$M_z$", 5, 1e3),
    ):
        times, values = line(axes, label)
        assert (times == session_record.wrench_times).all()
        assert (values == scale * session_record.constraint_wrench[:, column]).all()
    _, norm = line(top, "norm")
    assert norm.max() == np.linalg.norm(session_record.constraint_wrench[:, :3], axis=1).max()
    _, expected = line(top, "expected")
    assert (expected == np.linalg.norm(session_record.expected_wrench[:, :3], axis=1)).all()
    assert (top.get_ylabel(), bottom.get_ylabel()) == ("force (N)", "torque (N mm)")


@pytest.mark.parametrize("draw", FIGURES.values())
def test_marks_where_the_count_changes(session_record, scene, draw):
    marked = [
        item.get_xdata()[0]
        for axes in draw(session_record, scene).axes
        for item in axes.get_lines()
        if item.get_linestyle() == ":" and len(item.get_xdata()) == 2
    ]
    change = session_record.analysis_times[np.flatnonzero(np.diff(session_record.count))[0] + 1]
    assert marked
    assert set(marked) == {change}


@pytest.mark.parametrize(("feedforward", "said"), [(0.0, False), (0.5, True)])
def test_feedforward_is_said_in_the_caption(session_record, scene, feedforward, said):
    fed = varied(scene, controller={"joint_constraint": {"feedforward": feedforward}})
    caption = wrench_figure(session_record, fed).texts[0].get_text()
    assert ("fed forward" in " ".join(caption.split())) == said


@pytest.mark.parametrize("draw", FIGURES.values())
def test_figures_are_of_the_scene_and_the_papers_of_its_own_only(session_record, scene, draw):
    def caption(of):
        return draw(session_record, of).texts[0].get_text()

    assert caption(scene).startswith("Fig. 5")
    assert caption(scene.with_(name="mine")).startswith("mine. ")
    assert caption(scene.with_("hand.force=[0.4, 0, 0]")).startswith("five_bar. ")


def test_rounding_fills_no_axis(handmade, scene):
    record = handmade()
    noise = 1e-16 * np.sin(np.arange(6.0 * len(record.constraint_wrench))).reshape(-1, 6)
    quiet = dataclasses.replace(record, constraint_wrench=noise)
    for axes in wrench_figure(quiet, scene).axes:
        low, high = axes.get_ylim()
        assert high - low >= 1e-6
    still = dataclasses.replace(
        record,
        device_position=record.point_position + 1e-19,
        device_orientation=record.point_orientation,
    )
    error = trajectory_figure(still, scene).axes[-1]
    assert error.get_ylim()[1] >= 1e-6


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_axes_keep_what_is_more_than_rounding(scale):
    axes = new_figure(4.0, 4.0, "").subplots()
    axes.set_yscale(scale)
    axes.plot([0.0, 1.0], [2.0, 2.0 + 1e-13])
    at_least(axes)
    low, high = axes.get_ylim()
    assert low < 2.0 < high
    if scale == "log":
        assert high / low == pytest.approx(LEAST_RATIO)
    axes.plot([0.0, 1.0], [1.0, 3.0])
    axes.set_ylim(1.0, 3.0)
    at_least(axes)
    assert axes.get_ylim() == (1.0, 3.0)


def test_labels_of_changes_do_not_hide_each_other(handmade):
    times = handmade().analysis_times
    count = (np.floor((times - times[0]) / 0.06 / np.ptp(times)) % 2).astype(int)
    record = handmade(count=count)
    figure = new_figure(8.0, 4.0, "")
    axes = figure.subplots()
    axes.set_xlim(times[0], times[-1])
    mark_changes(axes, record, label=True)
    figure.canvas.draw()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert len(boxes) >= 8
    assert len(axes.get_lines()) == 16
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_where_start_and_end_are_one_place_both_are_seen(session_record, scene):
    main = trajectory_figure(session_record, scene).axes[0]
    marks = {item.get_label(): item for item in main.get_lines()}
    assert marks["start"].get_fillstyle() == "none"
    assert marks["start"].get_markersize() > 2.0 * marks["end"].get_markersize()
