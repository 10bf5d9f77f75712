# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The adaptive reference against closed forms and equations written by hand."""

import numpy as np
import pytest

from benchmarks.accuracy import cases
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import Simulator
from oracles import governor, pendulum
from oracles.generator import blank
from oracles.planar_linkages import five_bar, five_bar_bent
from oracles.reference import reference_motion
from oracles.running import with_start

CASES = {case.name: case for case in cases()}


def spinning_top(rates):
    """Return a free body without forces, two of its moments of inertia alike."""
    document = blank()
    document["links"] = [
        {
            "name": "top",
            "joint": {"name": "free", "type": "free"},
            "inertial": {"mass": 2.0, "inertia": {"ixx": 0.02, "iyy": 0.02, "izz": 0.035}},
        }
    ]
    document["operational_points"] = [{"name": "tip", "link": "top"}]
    q = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    return scene_from_document(with_start(document, q, np.array([0.1, 0.2, 0.0, *rates])))


def test_a_pendulum_is_found_to_ten_digits():
    case = CASES["pendulum"]
    times = (0.5, 1.0)
    found = reference_motion(case.scene, times)
    sim = Simulator(case.scene)
    places = [sim.mechanism.frame_pose(q, "p1").translation[:2] for q in found.q]
    assert np.abs(np.array(places) - pendulum.let_go(1.0, times)).max() < 1e-10


def test_a_top_precesses_as_euler_says():
    """ω₁ + i ω₂ turns in the body at (izz - ixx) / ixx ω₃; many turns of a quaternion."""
    first, spin = 1.5, 20.0
    times = (0.3, 1.0)
    found = reference_motion(spinning_top((first, 0.0, spin)), times)
    around = np.exp(1j * (0.035 - 0.02) / 0.02 * spin * np.array(times))
    turning = found.v[:, 3] + 1j * found.v[:, 4]
    assert np.abs(turning - first * around).max() < 1e-9
    assert np.abs(found.v[:, 5] - spin).max() < 1e-11
    # Without forces the centre of mass goes straight on.
    assert np.abs(found.q[:, :2] - np.outer(times, (0.1, 0.2))).max() < 1e-10


def test_a_stiff_scene_is_found():
    case = CASES["flyball_governor"]
    found = reference_motion(case.scene, (0.2,), tolerance=1e-10, stiff=True)
    sim = Simulator(case.scene)
    height = sim.mechanism.frame_pose(found.q[0], "slider_point").translation[2]
    assert abs(height - governor.heights((0.2,))[0]) < 1e-8


def test_a_closed_chain_keeps_loops_and_energy():
    document = with_start(five_bar(-9.81), five_bar_bent(1.9, 0.9), np.array([0.9, -1.0, 1.0, 0.5]))
    scene = scene_from_document(document)
    found = reference_motion(scene, (0.0, 0.1, 0.33))
    mechanism = Simulator(scene).mechanism
    energies = [sum(mechanism.energy(q, v)) for q, v in zip(*found, strict=True)]
    assert np.ptp(energies) < 1e-11 * abs(energies[0])
    assert all(mechanism.closing_terms(q, (True,)).error < 1e-14 for q in found.q)


def test_wrenches_are_held():
    """2 kg pushed by 3 N: s = F t² / 2m."""
    push = np.zeros((1, 6))
    push[0, 2] = 3.0
    found = reference_motion(spinning_top((0.0, 0.0, 0.0)), (0.4,), push)
    assert found.q[0, 2] == pytest.approx(3.0 * 0.4**2 / 4.0, abs=1e-12)


@pytest.mark.parametrize(
    ("times", "wrenches", "what"),
    [((0.2, 0.1), 0.0, "times"), ((np.nan,), 0.0, "times"), ((0.1,), np.zeros((2, 6)), "wrenches")],
)
def test_wrong_questions_are_refused(times, wrenches, what):
    with pytest.raises(InvalidInputError, match=what):
        reference_motion(spinning_top((0.0, 0.0, 1.0)), times, wrenches)
