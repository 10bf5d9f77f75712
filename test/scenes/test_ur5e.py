# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An industrial arm felt at its flange: published frames, its inertia, its wrist singularity."""

import numpy as np
import pytest

from hapticmech_ros import Mechanism, analyse, load_scene
from hapticmech_ros.scene import document_of
from oracles.jacobians import Jacobians
from oracles.sessions import whole

# As the maker publishes them: a, d (m) and alpha (rad) of each joint, mass (kg) and centre of mass
# (m) of each link in the frame behind its row.
LENGTHS = np.array([0.0, -0.425, -0.3922, 0.0, 0.0, 0.0])
OFFSETS = np.array([0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996])
TWISTS = np.array([1.0, 0.0, 0.0, 1.0, -1.0, 0.0]) * np.pi / 2.0
MASSES = np.array([3.761, 8.058, 2.846, 1.37, 1.3, 0.365])
CENTRES = np.array(
    [
        [0.0, -0.02561, 0.00193],
        [0.2125, 0.0, 0.11336],
        [0.15, 0.0, 0.0265],
        [0.0, -0.0018, 0.01634],
        [0.0, 0.0018, 0.01634],
        [0.0, 0.0, -0.001159],
    ]
)
POSES = [np.random.default_rng(seed).uniform(-2.0, 2.0, 6) for seed in range(4)]


def frames(q):
    """Return (4, 4) of each row of Denavit and Hartenberg's, from the ground on."""
    here, found = np.eye(4), []
    for angle, a, d, twist in zip(q, LENGTHS, OFFSETS, TWISTS, strict=True):
        c, s, ct, st = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
        row = [
            [c, -s * ct, s * st, a * c],
            [s, c * ct, -c * st, a * s],
            [0.0, st, ct, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
        here = here @ np.array(row)
        found.append(here)
    return found


@pytest.mark.parametrize("q", POSES)
def test_the_flange_is_where_the_maker_has_it(q):
    found = Mechanism(load_scene("ur5e")).frame_pose(q, "tool").homogeneous
    assert found == pytest.approx(frames(q)[-1], abs=1e-12)


@pytest.mark.parametrize("q", POSES)
def test_masses_are_where_the_maker_has_them(q):
    document = document_of(load_scene("ur5e"))
    poses = Jacobians(document, q).poses
    for link, frame, mass, centre in zip(
        document["links"], frames(q), MASSES, CENTRES, strict=True
    ):
        rotation, origin = poses[link["name"]]
        place = origin + rotation @ np.array(link["inertial"]["com"])
        assert link["inertial"]["mass"] == mass
        # Six digits stand in the file.
        assert place == pytest.approx((frame @ [*centre, 1.0])[:3], abs=1e-6)


@pytest.mark.parametrize("q", POSES)
def test_the_hand_feels_the_arm(q):
    """X = J D⁻¹ Jᵀ, from axes and arms of its joints."""
    document = document_of(load_scene("ur5e"))
    expected = Jacobians(document, q).inverse_inertia(document["operational_points"][0])
    found = analyse(Mechanism(load_scene("ur5e")), q).inverse_inertia
    # D's condition of 1e4, six hinges.
    assert found == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("straight", [0.0, np.pi])
def test_a_straight_wrist_is_a_constraint(straight):
    """Axes 4 and 6 are parallel there: a column of J repeats but for a shift, and the rank is 5."""
    mechanism = Mechanism(load_scene("ur5e"))
    bent = np.array([0.0, -1.9, 1.9, -0.5, -1.45, 0.0])
    q = bent.copy()
    q[4] = straight
    found = analyse(mechanism, q)
    assert analyse(mechanism, bent).rank == 6
    assert found.rank == 5
    (wrench,) = found.constraint_wrenches.T
    jacobian = Jacobians(document_of(load_scene("ur5e")), q).of_frame(
        document_of(load_scene("ur5e"))["operational_points"][0]
    )
    # No joint moves against it.
    assert np.abs(jacobian.T @ wrench).max() < 1e-9 * np.linalg.norm(wrench)


def test_the_constraint_comes_and_goes_with_the_wrist():
    run = whole("ur5e")
    assert [(before, after) for _, before, after in run.changes] == [(0, 1), (1, 0)]
    wrist = run.of(lambda s: abs(s.mechanism.q[4]))
    assert wrist.max() > 1.4
    assert wrist.min() < 0.1
    assert (wrist[run.count == 1] < 1.0).all()
    # s falls with the sine of joint 5, as other directions hardly change.
    s = run.of(lambda s: s.analysis.spectrum.s[-1])
    assert np.corrcoef(s, np.sin(wrist))[0, 1] > 0.98
