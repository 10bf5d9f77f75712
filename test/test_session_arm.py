# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An arm's mass, a force sensor and the force channel: a loop whose factor per period is known."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.scene import document_of, scene_from_document

PLANE = [0, 1, 5]
MASS, INERTIA = 12.0, 0.01


def session(scene, arm):
    """Return a scene with a heavy device that nothing limits, held by a slack arm (kg)."""
    document = document_of(load_scene(scene))
    document["device"] = {
        "mass": MASS,
        "inertia": INERTIA,
        "force_limit": 1e6,
        "torque_limit": 1e6,
    }
    document["controller"]["engagement_ramp"] = 0.0
    document["hand"] = {
        "kind": "arm",
        "mass": arm,
        "angular_inertia": 0.0,
        "stiffness": 1.0,
        "damping": 0.0,
        "start_delay": 0.0,
        "waypoints": [{"time": 0.0, "xyz": [1e-3, 5e-4, 0.0]}],
    }
    return Session(scene_from_document(document))


def factor(scene, arm):
    """Return the spectral radius of G Λ_a (Λ_d + Λ_a)⁻¹ at the scene's start."""
    analysis = session(scene, arm).tick().analysis
    x, share = (
        a[np.ix_(PLANE, PLANE)] for a in (analysis.inverse_inertia, analysis.wrench_projector)
    )
    gain = np.diag([MASS, MASS, INERTIA]) @ x - np.eye(3) + share
    carried = np.diag([arm / (MASS + arm)] * 2 + [0.0])
    return np.abs(np.linalg.eigvals(gain @ carried)).max()


@pytest.mark.parametrize("scene", ["two_link", "five_bar"])
@pytest.mark.parametrize("wanted", [0.95, 1.05, 1.2])
def test_what_the_sensor_reads_grows_by_the_predicted_factor(scene, wanted):
    low, high = 0.1, 100.0
    for _ in range(25):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if factor(scene, middle) < wanted else (low, middle)
    running = session(scene, low)
    read = np.array([running.tick().hand_wrench[:2] for _ in range(40)])
    change = np.linalg.norm(np.diff(read, axis=0), axis=1)
    # From the sixth period on, over 20: other factors of the loop fade as their powers, and what
    # the position channel couples is some 0.1 % of m / T² beside.
    assert (change[25] / change[5]) ** (1 / 20) == pytest.approx(wanted, rel=0.01)
