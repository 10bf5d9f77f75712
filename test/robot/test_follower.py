# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that follows samples: through a clutch, and closed where samples are missing."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.robot.follower import Follower, FollowerSettings
from hapticmech_ros.robot.law import Gains, Tuning
from oracles.driven_robots import accelerated, law_of, pose_of

Q = np.array([0.2, 0.6, -0.3, -1.4, 0.4, 0.9, 0.0])
STILL, NO_TWIST = np.zeros(7), np.zeros(6)
PERIOD = 1e-3
POSE = pin.SE3(pin.exp3(np.array([0.2, -0.4, 0.1])), np.array([0.1, 0.2, 0.3]))
TORQUE_LIMITS = np.array([320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0])


def follower(**options):
    law = law_of("iiwa14", gains=Gains(posture_rate=0.0), torque_limits=TORQUE_LIMITS)
    return law, Follower(law, FollowerSettings(period=PERIOD, **options))


def told(made, time=0.0, q=Q, v=STILL, pose=POSE, twist=NO_TWIST):
    """Return the order after samples of joints and target at a time."""
    made.update_joints(q, v, time)
    made.update_target(pose, twist, time)
    return made.order(time)


def moved_by(way):
    return pin.SE3(POSE.rotation, POSE.translation + way)


def test_nothing_is_ordered_before_joints_were_heard():
    _, made = follower()
    made.update_target(POSE, np.zeros(6), 0.0)
    assert made.order(0.0) is None


@pytest.mark.parametrize("interface", ["effort", "velocity", "position"])
def test_it_begins_without_a_jump_wherever_the_target_is(interface):
    law, made = follower(interface=interface)
    order = told(made)
    assert order.trouble == ""
    assert made.follows
    expected = {"effort": law.resting(Q), "velocity": STILL, "position": Q}[interface]
    # Two poses' rounding, 1e-15, times ω² = 900 and masses of 25 kg.
    np.testing.assert_allclose(order.values, expected, atol=1e-9)


@pytest.mark.parametrize("interface", ["velocity", "position"])
def test_it_moves_by_as_much_as_the_target(interface):
    """A target that has moved by 5 cm and turned: after a second the robot has, too."""
    law, made = follower(interface=interface)
    q, start = Q.copy(), pose_of(law, Q)
    way, turn = np.array([0.02, -0.03, 0.035]), pin.exp3(np.array([0.0, 0.1, 0.2]))
    moved = pin.SE3(turn @ POSE.rotation, POSE.translation + way)
    told(made)
    for tick in range(1, 1500):
        order = told(made, PERIOD * tick, q, pose=moved)
        q = order.values if interface == "position" else q + PERIOD * order.values
    end = pose_of(law, q)
    # Critically damped at 30 1/s: exp(-45) of the way is left.
    np.testing.assert_allclose(end.translation - start.translation, way, atol=1e-9)
    np.testing.assert_allclose(end.rotation @ start.rotation.T, turn, atol=1e-9)


def test_a_target_is_carried_on_between_its_samples():
    _, made = follower()
    twist = np.array([0.1, 0.0, -0.2, 0.0, 0.3, 0.0])
    told(made, twist=twist)
    made.update_joints(Q, STILL, 0.02)
    later = made.order(0.02).values
    turn, way = pin.exp3(0.02 * twist[3:]), 0.02 * twist[:3]
    there = pin.SE3(turn @ POSE.rotation, POSE.translation + way)
    # Of rounding, times ω² = 900 and masses of 25 kg.
    values = told(made, 0.02, pose=there, twist=twist).values
    np.testing.assert_allclose(values, later, atol=1e-9)


def test_stale_joints_leave_what_carries_the_weight_alone():
    law, made = follower()
    told(made, v=np.full(7, 0.5), twist=np.ones(6))
    made.update_target(POSE, np.ones(6), 0.03)
    order = made.order(0.03)
    assert "joint states" in order.trouble
    assert not made.follows
    np.testing.assert_array_equal(order.values, law.resting(Q))
    assert made.counts.joints_stale == 1
    assert not order.contact.any()


@pytest.mark.parametrize("interface", ["effort", "velocity"])
def test_torques_are_not_used_with_joint_states_too_old_for_the_rates(interface):
    """Rates of 30 1/s bear 1/60 s, a period included, whatever the timeout is."""
    law, made = follower(interface=interface, joint_timeout=0.2, target_timeout=0.2)
    told(made)
    assert made.order(0.0155).trouble == ""
    order = made.order(0.0158)
    if interface == "velocity":
        assert order.trouble == ""
        return
    assert order.trouble == "joint states are too old for the rates"
    np.testing.assert_array_equal(order.values, law.resting(Q))
    assert (made.counts.joints_stale, made.follows) == (1, False)


def test_rates_that_a_period_is_too_long_for_are_refused():
    """30 1/s bear 1/60 s: at 50 Hz the robot would never follow, and say that states are old."""
    law = law_of("iiwa14", gains=Gains(posture_rate=0.0))
    with pytest.raises(InvalidInputError, match=r"linear_rate.*above one period, 0\.02 s"):
        Follower(law, FollowerSettings(period=0.02))
    Follower(law, FollowerSettings(interface="velocity", period=0.02))
    made = Follower(law, FollowerSettings(period=0.01))
    with pytest.raises(InvalidInputError, match="linear_rate"):
        made.tune(Tuning(Gains(linear_rate=60.0)), 0.0)


def test_a_stale_target_brakes_the_robot():
    law, made = follower()
    made.update_target(POSE, np.zeros(6), 0.0)
    v = np.linspace(-0.5, 0.5, 7)
    made.update_joints(Q, v, 0.06)
    order = made.order(0.06)
    assert "target" in order.trouble
    vdot, _ = accelerated(law, Q, v, order.values)
    np.testing.assert_allclose(vdot, -law.gains.rest_rate * v, atol=1e-9)
    assert made.counts.target_stale == 1


def test_a_stale_sensor_is_no_sensor_that_feels_nothing():
    _, made = follower(has_sensor=True)
    assert "wrench" in told(made, 0.1).trouble
    made.update_wrench(np.zeros(6), 0.1)
    assert made.order(0.1).trouble == ""
    assert made.counts.wrench_stale == 1


@pytest.mark.parametrize("interface", ["velocity", "position"])
def test_without_samples_a_robot_with_a_servo_holds(interface):
    _, made = follower(interface=interface)
    made.update_joints(Q, np.full(7, 0.3), 0.0)
    for tick in range(60, 100):
        made.update_joints(Q + 1e-3 * tick, np.full(7, 0.3), PERIOD * tick)
        order = made.order(PERIOD * tick)
        expected = STILL if interface == "velocity" else Q + 0.06
        np.testing.assert_array_equal(order.values, expected)


def test_it_comes_together_anew_where_both_are_then():
    law, made = follower()
    told(made)
    made.update_joints(Q + 0.1, STILL, 1.0)
    assert made.order(1.0).trouble
    order = told(made, 1.0, Q + 0.1, pose=moved_by(1.0))
    assert order.trouble == ""
    np.testing.assert_allclose(order.values, law.resting(Q + 0.1), atol=1e-9)
    assert made.counts.engagements == 2


@pytest.mark.parametrize("frame", ["world", "link4", "tool", ""])
def test_a_contact_is_the_same_in_whatever_axes_it_is_measured(frame):
    law, made = follower(has_sensor=True)
    contact = np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    # Axes of a link, as the robot's file says: joints one after the other.
    axes = Rotation.identity()
    for link, angle in zip(law.mechanism.scene.links, Q, strict=True):
        if frame == "world":
            break
        joint = link.joint
        axes *= Rotation.from_euler("xyz", joint.origin.rpy)
        axes *= Rotation.from_rotvec(angle * np.array(joint.axis))
        if link.name == frame:
            break
    if frame in ("tool", ""):
        axes *= Rotation.from_euler("xyz", law.mechanism.scene.operational_points[0].origin.rpy)
    measured = np.r_[axes.inv().apply(contact[:3]), axes.inv().apply(contact[3:])]
    if frame not in ("tool", ""):
        # Where the point is, is not known yet.
        made.update_wrench(measured, 0.0, frame)
    assert told(made).trouble
    made.update_wrench(measured, 0.0, frame)
    np.testing.assert_allclose(made.order(0.0).contact, contact, atol=1e-13)
    with pytest.raises(InvalidInputError, match="must be one of"):
        made.update_wrench(measured, 0.0, "nonsense")


def test_a_target_that_jumps_does_not_pull_the_robot_along():
    law, made = follower(largest_error=0.1)
    told(made)
    order = told(made, PERIOD, pose=moved_by(np.array([0.0, 0.11, 0.0])))
    assert "too far" in order.trouble
    np.testing.assert_allclose(order.values, law.resting(Q), atol=1e-12)
    # From then on it follows from where both are.
    after = made.order(2.0 * PERIOD)
    assert after.trouble == ""
    np.testing.assert_allclose(after.values, law.resting(Q), atol=1e-9)
    assert made.counts.slipped == 1
    near = moved_by(np.array([0.0, 0.2, 0.0]))
    assert told(made, 3.0 * PERIOD, pose=near).trouble == ""


def stretched(made, periods, start=0.0):
    """Return orders of a robot that is held 1 mm from its target."""
    near, orders = moved_by(np.array([0.0, 1e-3, 0.0])), []
    for tick in range(periods):
        pose = POSE if made.counts.orders == 0 else near
        orders.append(told(made, start + PERIOD * tick, pose=pose).values)
    return np.array(orders)


def test_gains_pass_to_others_in_a_straight_line():
    """With ω from 30 to 90 1/s over 0.1 s, a spring's torque goes with ω² from one to nine."""
    law, made = follower(gain_ramp=0.1)
    before = stretched(made, 10)
    made.tune(Tuning(Gains(linear_rate=90.0, angular_rate=90.0, posture_rate=0.0)), 0.01)
    after = stretched(made, 120, 0.01)
    pull = before[-1] - law.resting(Q)
    share = np.minimum(np.arange(120) * PERIOD / 0.1, 1.0)
    wanted = ((30.0 + 60.0 * share) / 30.0) ** 2
    # Of rounding, times ω² = 8100 and masses of 25 kg.
    np.testing.assert_allclose(after, law.resting(Q) + np.outer(wanted, pull), atol=1e-8)
    assert np.abs(np.diff(np.vstack((before[-1:], after)), axis=0)).max() < 0.2 * np.abs(pull).max()
    assert made.tuning.gains.linear_rate == 90.0


def test_without_a_sensor_a_steady_contact_is_estimated_at_the_rate_of_the_observer():
    """A robot that stands still against a push: r goes to Jᵀ F_c, from where it is at a new rate.

    Λ⁺ J D⁻¹ r is then F_c.
    """
    law, made = follower(observer_rate=50.0, gain_ramp=0.0)
    contact = np.array([5.0, -3.0, 8.0, 0.2, -0.1, 0.3])
    torque = law.resting(Q) - law.state(Q, STILL).point.jacobian.T @ contact
    found = []
    for tick in range(200):
        if tick == 20:
            made.tune(Tuning(law.gains, 200.0), PERIOD * tick)
        # As if the law had ordered what balances the push.
        made._torques = [torque, torque]
        found.append(told(made, PERIOD * tick).contact)
    share = 1.0 - np.array(found) @ contact / (contact @ contact)
    # Steps of Euler: 1 - κ T of what is missing is left after each.
    ticks = np.arange(200)
    wanted = np.where(ticks < 20, 0.95**ticks, 0.95**19 * 0.8 ** (ticks - 19.0))
    np.testing.assert_allclose(share, wanted, atol=1e-9)
    np.testing.assert_allclose(found[-1], contact, atol=1e-9)


def test_an_observer_neither_begins_nor_ends_while_it_follows():
    for rate, other in ((0.0, 20.0), (20.0, 0.0)):
        law, made = follower(observer_rate=rate)
        with pytest.raises(InvalidInputError, match="observer_rate"):
            made.tune(Tuning(law.gains, other), 0.0)
        assert made.tuning == Tuning(law.gains, rate)
    with pytest.raises(InvalidInputError, match="1000"):
        made.tune(Tuning(law.gains, 1000.0), 0.0)


def test_the_same_gains_once_more_begin_nothing():
    """As a node tells them when another parameter changes: no ramp, and no watch that forgets."""
    law, made = follower(observer_rate=20.0)
    watch, other = made._watch, Tuning(Gains(linear_rate=90.0, posture_rate=0.0), 20.0)
    made.tune(made.tuning, 0.0)
    stretched(made, 2)
    assert made._law is law
    assert made._watch is watch
    made.tune(other, 0.01)
    stretched(made, 100, 0.01)
    half = made.tuning.gains.linear_rate
    made.tune(other, 0.11)
    stretched(made, 1, 0.11)
    # On the way still: from 30 to 90 1/s over 0.3 s.
    assert made.tuning.gains.linear_rate == pytest.approx(50.0)
    assert half < 50.0


def test_a_robot_that_swung_stays_slow_under_new_gains():
    _, made = follower(observer_rate=16.0, gain_ramp=0.0)
    made.counts.swings = 1
    assert made.tuning.observer_rate == 1.0
    made.tune(Tuning(Gains(linear_rate=40.0, angular_rate=20.0), 32.0), 0.0)
    stretched(made, 2)
    found = made.tuning
    assert found.gains.linear_rate == pytest.approx(40.0 / 2**0.5)
    assert found.gains.angular_rate == pytest.approx(20.0 / 2**0.5)
    assert found.observer_rate == 2.0
    assert made._law.gains == found.gains
    made.counts.swings = 2
    assert made.tuning.observer_rate == 0.0


def test_settings_that_are_none_are_refused():
    for changed in (
        {"period": 0.0},
        {"joint_timeout": np.nan},
        {"interface": "steam"},
        {"gain_ramp": -1.0},
        {"swing_speed": -1.0},
    ):
        with pytest.raises(InvalidInputError, match=next(iter(changed))):
            FollowerSettings(**changed)
    _, made = follower()
    with pytest.raises(InvalidInputError, match="7 finite numbers"):
        made.update_joints(np.full(7, np.nan), STILL, 0.0)
