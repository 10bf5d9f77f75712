# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""An arm's mass, a force sensor and the force channel: a loop whose factor per period is known."""

import numpy as np
import pytest
from scipy.optimize import brentq

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control.loop_stability import lead_gains
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


def loop(scene, arm):
    """Return (3, 9) of F(k + 1) = -Λ_a (Λ_d + Λ_a)⁻¹ u(k) by F(k) to F(k - 2), at the start.

    u answers F(k) by G, ½ ∇F by G and 5/12 ∇²F by W G.
    """
    analysis = session(scene, arm).tick().analysis
    x, share = (
        a[np.ix_(PLANE, PLANE)] for a in (analysis.inverse_inertia, analysis.wrench_projector)
    )
    gain = np.diag([MASS, MASS, INERTIA]) @ x - np.eye(3) + share
    carried = np.diag([arm / (MASS + arm)] * 2 + [0.0])
    line, bend = lead_gains(gain)
    line, bend = 0.5 * line, 5.0 / 12.0 * bend
    return np.hstack([-carried @ one for one in (gain + line + bend, -line - 2.0 * bend, bend)])


def factor(scene, arm):
    """Return the largest |z| of that loop."""
    step = np.eye(9, k=-3)
    step[:3] = loop(scene, arm)
    return np.abs(np.linalg.eigvals(step)).max()


@pytest.mark.parametrize("scene", ["two_link", "five_bar"])
@pytest.mark.parametrize("wanted", [0.95, 1.05, 1.2])
def test_what_the_sensor_reads_follows_from_what_it_read(scene, wanted):
    """In loops that decay and that grow by so much a period, at most."""
    arm = brentq(lambda mass: factor(scene, mass) - wanted, 0.1, 100.0)
    running, law = session(scene, arm), loop(scene, arm)
    read = np.array([running.tick().hand_wrench[PLANE] for _ in range(40)])
    change = np.diff(read, axis=0)
    last = np.hstack((change[2:-1], change[1:-2], change[:-3]))
    # What the position channel couples is some 0.1 % of m / T² beside, until actuators limit.
    error = (change[3:] - last @ law.T)[3:22]
    assert np.linalg.norm(error) < 0.01 * np.linalg.norm(change[6:25])
