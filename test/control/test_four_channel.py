# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Four-channel controller: the transparency oracle of physics section 5, in one dimension.

With equal impedances sΛ on both sides, C2 = C3 = 1 and C_m = C_s:
(sΛ + C_m + C_s)(V_h - V_e) = 0, so drift decays; sΛ (V_h + V_e)/2 = F_h - F_e, so the user feels Λ
and the contact, whatever the gains.
"""

import numpy as np
import pytest

from hapticmech_ros.control import OperationalModel
from hapticmech_ros.control.architecture import PositionChannels
from hapticmech_ros.scene.controller import (
    DESIGN_PHASE_LAG,
    PositionChannelGains,
)
from oracles.controllers import answered, control_of

MASS, STIFFNESS, DAMPING = 0.5, 200.0, 6.0
GAINS = PositionChannelGains(stiffness=STIFFNESS, damping=DAMPING)
FREE = np.zeros((6, 6))
CONTROL = control_of("spatial_arm", position_channel={"stiffness": STIFFNESS, "damping": DAMPING})


def channels_of(control, share, error, rate, hand, contact):
    """Return the channels' wrenches on the hand and on the mechanism, which moves by none."""
    model = OperationalModel(FREE, FREE, share, np.zeros(6))
    found = answered(control, model, error, rate, hand, contact)
    return found.four_channel, found.mechanism


def along_x(value):
    return np.array([value, 0.0, 0.0, 0.0, 0.0, 0.0])


def accelerations(state, push, contact):
    """Return (ẍ_h, ẍ_e) of a device and a mechanism of equal mass, joined by the channels."""
    x_h, v_h, x_e, v_e = state
    given = (x_h - x_e, v_h - v_e, push, contact)
    device, mechanism = channels_of(CONTROL, FREE, *map(along_x, given))
    return (push + device[0]) / MASS, (contact + mechanism[0]) / MASS


def test_hand_and_contact_act_on_the_mean_whatever_the_error():
    rng = np.random.default_rng(0)
    for _ in range(20):
        state, (push, contact) = rng.normal(size=4), rng.normal(size=2)
        a_h, a_e = accelerations(state, push, contact)
        # Coupling forces of up to 600 N cancel.
        assert abs(MASS * (a_h + a_e) / 2.0 - (push + contact)) < 1e-12
        error = STIFFNESS * (state[0] - state[2]) + DAMPING * (state[1] - state[3])
        assert abs(MASS * (a_h - a_e) + 2.0 * error) < 1e-11


def test_the_device_side_leaves_rigid_directions_to_the_joint_constraint():
    rng = np.random.default_rng(3)
    n, dual = rng.normal(size=(2, 6))
    share = np.outer(n, dual) / (n @ dual)
    given = rng.normal(size=(4, 6))
    device, mechanism = channels_of(CONTROL, share, *given)
    # What is left of the coupling has no component along n: its pairing with n's dual is zero.
    assert abs(dual @ (device - given[3])) < 1e-12 * np.linalg.norm(device) * 10.0
    # The mechanism is pulled in full: its joints take what they constrain.
    assert np.array_equal(mechanism, channels_of(CONTROL, FREE, *given)[1])


def test_channels_can_be_cut_scaled_and_forces_fed_back():
    given = np.random.default_rng(6).normal(size=(4, 6))
    *_, hand, contact = given
    force = {"contact": 0.25, "hand": 0.5, "mechanism_feedback": 0.125}
    cut = control_of(
        "spatial_arm",
        position_channel={"to_mechanism": 0.0, "to_device": 0.5},
        force_channel=force,
    )
    device, mechanism = channels_of(cut, FREE, *given)
    whole, _ = channels_of(control_of("spatial_arm", force_channel=force), FREE, *given)
    assert mechanism == pytest.approx(0.5 * hand + 0.125 * contact, abs=1e-15)
    assert device - 0.25 * contact == pytest.approx(0.5 * (whole - 0.25 * contact), rel=1e-12)


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
    channels = PositionChannels(GAINS, inertia, lag)
    full = PositionChannels(GAINS, inertia, 0.0)
    pace = np.sqrt(channels.held_stiffness / inertia)
    assert (pace * lag <= DESIGN_PHASE_LAG * (1 + 1e-12)).all()
    assert (channels.held_damping / inertia * lag <= DESIGN_PHASE_LAG * (1 + 1e-12)).all()
    # As damped as before, and the mechanism's side is as it was.
    ratio = channels.held_damping / np.sqrt(channels.held_stiffness)
    assert ratio == pytest.approx(full.damping / np.sqrt(full.stiffness), rel=1e-12)
    assert np.array_equal(channels.stiffness, full.stiffness)
    assert lag > 0.002 or np.array_equal(channels.held_stiffness, full.stiffness)
