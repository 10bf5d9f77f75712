# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The architecture beside proxies: what each gets right, in order."""

import json

import numpy as np
import pytest

from commands import ran
from hapticmech_ros import load_scene
from hapticmech_ros.analysis import comparison
from hapticmech_ros.analysis.comparison import (
    FREE,
    FULL,
    GAIN_MARGIN,
    PROXY,
    SOFT,
    STIFF,
    ProxyControl,
    compare,
    side_by_side,
    stiffest_gains,
    stiffest_proxy,
)
from hapticmech_ros.analysis.experience import directions
from hapticmech_ros.control.loop_stability import LoopTerms, spectral_radius
from hapticmech_ros.errors import InvalidInputError


@pytest.fixture(scope="module")
def columns():
    return {one.variant: one for one in side_by_side(load_scene("five_bar"))}


def test_only_the_architecture_feels_as_heavy_as_the_mechanism(columns):
    """A proxy adds the device and its spring: 10 times the error, and more."""
    for variant in (FULL, STIFF):
        assert max(columns[variant].errors) < 0.02
    for variant in (PROXY, SOFT):
        assert columns[variant].errors[2] > 10.0 * columns[FULL].errors[2]
        assert columns[variant].errors[0] > 10.0 * columns[FULL].errors[0]


def test_without_joint_constraints_joints_are_not_felt(columns):
    """The device moves by its own mass, and the hand takes it off the mechanism."""
    lacking = columns[FREE]
    assert (lacking.count, lacking.largest_delay, lacking.experience.kept) == (0, None, False)
    assert lacking.softest_held < 0.01 * columns[FULL].softest_held
    assert columns[FULL].count == columns[FULL].constraints == 1


def test_delay_margins_of_sessions_agree_with_eigenvalues(columns):
    for variant in (PROXY, SOFT):
        assert columns[variant].largest_delay == columns[variant].predicted_delay
    for variant in (FULL, STIFF):
        # What is left over a late loop grows by little in the time that is watched.
        found = columns[variant]
        assert abs(found.largest_delay - found.predicted_delay) <= 1
        # Its walls are the device's own: a proxy's margin of 2 at one period is used up by another.
        assert found.largest_delay > 15
    assert columns[PROXY].largest_delay == 1


@pytest.mark.parametrize(
    ("factor", "stable"), [(0.99 * GAIN_MARGIN, True), (1.01 * GAIN_MARGIN, False)]
)
@pytest.mark.parametrize("delay", [0, 1, 5])
def test_the_stiffest_gains_leave_a_margin_of_two(delay, factor, stable):
    scene = load_scene("five_bar")
    loop = np.array([[1.0 / scene.device.mass]])
    stiffness, damping = (factor * gain for gain in stiffest_gains(scene, loop, delay))
    late = stiffness * loop, damping * loop
    terms = LoopTerms(late, (np.zeros_like(loop), np.zeros_like(loop)))
    radius = spectral_radius(terms, 1e-3, delay)
    assert (radius < 1.0) is stable


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda scene: ProxyControl(scene, 1.0, -1.0), r"damping.*0 or more.*got -1"),
        (
            lambda scene: stiffest_proxy(scene, directions(scene).analysis, -1),
            r"delay.*0 or more.*got -1",
        ),
        (lambda scene: compare([scene.name], [-3]), r"delay.*got -3"),
        (lambda scene: compare([scene.name], [1], 0), r"processes.*1 or more.*got 0"),
    ],
)
def test_what_cannot_be_compared_is_refused(call, message):
    with pytest.raises(InvalidInputError, match=message):
        call(load_scene("five_bar"))


def test_the_command_writes_table_file_and_picture(tmp_path, monkeypatch):
    # What it measures is another test's.
    monkeypatch.setattr(comparison, "WATCHED_S", 0.2)
    short = ["--set", "experiment.duration=0.2"]
    words = ["feel", "compare", "two_link", "--processes", "1", *short, "--out", str(tmp_path)]
    ran(*words)
    rows = json.loads((tmp_path / "comparison.json").read_text(encoding="utf-8"))
    assert [row["variant"] for row in rows] == [FULL, STIFF, FREE, PROXY, SOFT]
    assert (tmp_path / "comparison.png").stat().st_size > 5000
