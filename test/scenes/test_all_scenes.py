# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every shipped scene, taken hold of for two seconds: nothing comes apart, and all is bounded."""

import re
from pathlib import Path

import numpy as np
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.plan.scene_plan import check_scene
from hapticmech_ros.scene import document_of
from oracles.jacobians import Jacobians
from oracles.sessions import whole

SCENES = sorted(shipped_scenes())
PAGE = (Path(__file__).resolve().parents[2] / "docs" / "library.md").read_text(encoding="utf-8")
SPAN = 2.0
# What `scene check` has to say of a scene, on purpose: the guide of the lift is redundant.
WARNINGS = {"scissor_lift": ("redundant closures: guide_pin",)}


# Scenes of the paper and next to them, whose whole experiment is looked at, by bounds of their own:
# between hand and mechanism, m and rad. The hand's 0.5 N on 2000 N/m is 0.25 mm; the click of the
# latch adds as much. In space it pulls with up to 3 N, and the handle's inertia makes turns softer.
NEAR = dict.fromkeys(("five_bar", "four_bar_closing", "two_link"), (1e-3, 1e-2))
NEAR["spatial_arm"] = (1e-3, 5e-2)


def run_of(name):
    return whole(name, None if name in NEAR else SPAN)


@pytest.mark.parametrize("name", SCENES)
def test_the_check_says_what_the_librarys_page_says_and_nothing_else(name):
    found = check_scene(load_scene(name))
    (numbers,) = re.findall(rf"^\| `{name}` \| ([\d |]+) \|$", PAGE, re.MULTILINE)
    rows = sum(rows for _, _, rows, _ in found.closures)
    expected = (found.nv, len(found.closures), rows, found.rank, found.mobility)
    assert [int(part) for part in numbers.split("|")] == [*expected, found.points[0].count]
    assert found.warnings == WARNINGS.get(name, ())
    for point in found.points:
        size = 3 if load_scene(name).task_space == "planar" else 6
        assert point.rank + point.count == size


@pytest.mark.parametrize("name", SCENES)
def test_the_device_can_give_what_is_felt(name):
    """Below its limits all the time, not at them."""
    scene, run = load_scene(name), run_of(name)
    device = run.of(lambda s: s.output.device)
    assert np.isfinite(device).all()
    force, torque = (np.linalg.norm(device[:, part], axis=1) for part in (slice(3), slice(3, 6)))
    assert force.max() + torque.max() > 0.0
    most = 0.5 if name in NEAR else 0.6
    assert force.max() < most * scene.device.force_limit
    assert torque.max() < most * scene.device.torque_limit


@pytest.mark.parametrize("name", SCENES)
def test_loops_stay_closed(name):
    """To the projection's 1e-11 of mechanisms below 1 m."""
    run = run_of(name)
    assert run.of(lambda s: s.mechanism.closure_error).max() < 1e-11


@pytest.mark.parametrize("name", SCENES)
def test_hand_and_mechanism_stay_together(name):
    """A spring of 2000 N/m at 8 N and a motion of 0.2 m/s that is a period late: some mm."""
    run, (apart, away) = run_of(name), NEAR.get(name, (5e-3, 0.05))
    gaps = run.of(lambda s: np.linalg.norm(s.output.error[:3]))
    turned = run.of(lambda s: np.linalg.norm(s.output.error[3:]))
    assert gaps.max() < apart
    assert turned.max() < away


@pytest.mark.parametrize("name", SCENES)
def test_energy_is_accounted_for(name):
    """Energy held and lost is what was done: to rules of second order at 1 ms, and 1e-3 of it."""
    run = run_of(name)
    held, work, lost = run.held(), run.work(), run.lost()
    exchanged = np.abs(np.diff(work)).sum() + lost[-1]
    balance = held - held[0] + lost - work
    assert exchanged > 0.0
    assert np.abs(balance).max() < 1e-3 * exchanged
    assert lost[-1] >= 0.0
    # rk2 at 1 ms on motions of some 3 rad/s: (3e-3)² = 1e-5 of the energy moved.
    assert name not in NEAR or np.ptp(balance) < 1e-5 * np.abs(work).max()
    assert name not in NEAR or lost[-1] > 0.0


# Of X, of its largest entry. 24 freedoms and 18 rows of condition up to 1e2, D's up to 1e4; 26
# freedoms, D and closures of condition up to 1e4 together.
FREE = {
    "stewart_platform": (1e-9, (0.0, 1.2, 2.0, 3.2)),
    "shared_payload": (1e-10, (0.0, 0.8, 1.8, 3.6)),
}


@pytest.mark.parametrize(
    ("name", "error", "time"),
    [(name, error, time) for name, (error, times) in FREE.items() for time in times],
)
def test_the_hand_feels_all_that_moves(name, error, time):
    """X of the session's own states, from axes and arms of joints, and independent coordinates."""
    sample, document = whole(name).at(time), document_of(load_scene(name))
    oracle = Jacobians(document, sample.mechanism.q)
    expected = oracle.inverse_inertia(document["operational_points"][0])
    assert np.abs(sample.analysis.inverse_inertia - expected).max() < error * np.abs(expected).max()


@pytest.mark.parametrize(("name", "least"), [("stewart_platform", 0.01), ("shared_payload", 0.03)])
def test_nothing_is_rigid_on_the_way_of_what_is_free(name, least):
    """Springs hold the platform where it is: asides of 30 mm, down by 10 mm."""
    run = whole(name)
    assert set(run.count) == {0}
    assert np.abs(run.of(lambda s: s.output.joint_constraint)).max() == 0.0
    moved = run.of(lambda s: s.point.pose.translation)
    assert np.ptp(moved, axis=0).min() > least
