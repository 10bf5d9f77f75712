# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Four-channel controller: forces fed back, and gains of a loop that is late.

What hand and contact do to both sides is in test_control_law and, of sessions, test_transparency.
"""

import numpy as np
import pytest

from hapticmech_ros.control import OperationalModel
from hapticmech_ros.control.architecture import FourChannel
from hapticmech_ros.scene.controller import (
    DESIGN_PHASE_LAG,
    ForceChannelGains,
    PositionChannelGains,
)
from oracles.controllers import answered, control_of

STIFFNESS, DAMPING = 200.0, 6.0
GAINS = PositionChannelGains(stiffness=STIFFNESS, damping=DAMPING)
FREE = np.zeros((6, 6))


@pytest.mark.parametrize("feedback", [-0.5, -0.2, 0.0])
def test_local_force_feedback_makes_both_sides_as_much_lighter(feedback):
    """C2 = C3 = 1 + C5 = 1 + C6: the two sides move alike, 1 / (1 + C6) times as heavy."""
    rng = np.random.default_rng(7)
    root = rng.normal(size=(6, 6))
    x, known = root @ root.T, 1.0 + feedback
    hand, contact = rng.normal(size=(2, 6))
    back = {"mechanism_feedback": feedback, "device_feedback": feedback}
    force = {"contact": known, "hand": known, **back}
    control = control_of("spatial_arm", force_channel=force)
    model = OperationalModel(x, FREE, FREE, np.zeros(6))
    found = answered(control, model, hand=hand, contact=contact)
    device = np.linalg.solve(control.device_inertia, hand + found.device)
    assert device == pytest.approx(x @ (known * hand + known * contact), rel=1e-9, abs=1e-9)
    mechanism = x @ (found.mechanism + contact)
    assert mechanism == pytest.approx(device, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("lag", [0.0, 1.5e-3, 0.0215, 0.1015])
def test_gains_on_the_device_keep_the_phase_lag_of_a_delayed_loop(lag):
    inertia = np.array([0.3] * 3 + [3e-4] * 3)
    channels = FourChannel(GAINS, ForceChannelGains(), inertia, lag)
    full = FourChannel(GAINS, ForceChannelGains())
    pace = np.sqrt(channels.held_stiffness / inertia)
    assert (pace * lag <= DESIGN_PHASE_LAG * (1 + 1e-12)).all()
    assert (channels.held_damping / inertia * lag <= DESIGN_PHASE_LAG * (1 + 1e-12)).all()
    # As damped as before, and the mechanism's side is as it was.
    ratio = channels.held_damping / np.sqrt(channels.held_stiffness)
    assert ratio == pytest.approx(full.damping / np.sqrt(full.stiffness), rel=1e-12)
    assert np.array_equal(channels.stiffness, full.stiffness)
    assert lag > 0.002 or np.array_equal(channels.held_stiffness, full.stiffness)
