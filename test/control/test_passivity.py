# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Actuators give no more than there is: each sample's account, and loops that would diverge."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control.passivity import passivity_for
from hapticmech_ros.scene.controller import Passivity
from oracles.controllers import Account
from oracles.running import varied
from sampling import sampled

INERTIA = np.array([0.3] * 3 + [3e-4] * 3)
PERIOD = 1e-3
FAR = (1e9, 1e9)


def controller(limits=FAR, **bounds):
    return Account(Passivity(**bounds), INERTIA, PERIOD, limits)


def at(position=(0, 0, 0), twist=(0,) * 6, push=(0,) * 6):
    return np.array((*position, 0, 0, 0, 1, *twist, *push), dtype=float)


def moved(sample, command):
    """Return a free body's sample a period later, as the simulated device moves."""
    place, twist, push = sample[:3].copy(), sample[7:13].copy(), sample[13:]
    later = twist + PERIOD * (command + push) / INERTIA
    return at(place + 0.5 * PERIOD * (twist + later)[:3], later, push)


def test_work_of_held_commands_is_exact():
    """u · ξ is ΔE."""
    account, sample, rng = controller(), at(), np.random.default_rng(1)
    applied = np.zeros(6)
    for _ in range(200):
        account.record(sample, applied)
        applied = np.array((*rng.normal(1.0, size=3), 0, 0, 0))
        sample = moved(sample, applied)
    account.record(sample, applied)
    kinetic = 0.5 * sample[7:13] @ (INERTIA * sample[7:13])
    assert kinetic > 0.1
    # 200 sums of parts of up to 1e-2 J.
    assert account.actuators == pytest.approx(-kinetic, abs=1e-14)
    assert account.hand(sample) == pytest.approx(0.0, abs=1e-14)


def test_a_static_force_is_left_alone():
    """It does no work: what holds a wall up against a hand needs no energy."""
    account = controller(allowance=1e-9)
    push = np.array([5.0, -2.0, 0, 0, 0, 0.1])
    sample = at(push=push)
    account.record(sample, np.zeros(6))
    account.receive(0.0)
    assert np.array_equal(account.enforce(-push, sample), -push)


def test_bounds_follow_what_the_mechanism_got():
    account = controller(allowance=1e-3, slack=0.1)
    account.receive(0.05)
    assert account.available == pytest.approx(1e-3)
    # It got more than slack allows: that much has to come from the hand first.
    account.receive(0.3)
    assert account.available == pytest.approx(-0.2)
    # It gave: the hand may have that.
    account.receive(-0.4)
    assert account.available == pytest.approx(0.401)
    account.begin()
    assert account.available == np.inf
    off = controller(control=False)
    off.receive(5.0)
    assert off.available == np.inf


def test_what_was_given_before_anybody_told_of_the_mechanism_is_no_debt():
    """A commander of one's own pushes for a while; the controller takes over, and tells E_m."""
    account = controller(allowance=1e-4)
    push = np.array([0.5, 0, 0, 0, 0, 0])
    for place in np.arange(0.0, 0.2, 1e-3):
        sample = at(position=(place, 0.0, 0.0), twist=(1.0, 0, 0, 0, 0, 0))
        account.record(sample, push)
        assert np.array_equal(account.enforce(push, sample), push)
    assert account.actuators == pytest.approx(-0.5 * 0.199)
    account.receive(0.0)
    assert account.available == pytest.approx(1e-4)
    # Of a force that gives nothing, nothing is held back: 20 N of damping were, of a debt of 0.1 J.
    braking = -push
    assert np.array_equal(account.enforce(braking, sample), braking)
    # From then on it counts.
    account.record(at(position=(0.2, 0.0, 0.0)), push)
    account.receive(0.1)
    assert account.actuators == pytest.approx(-0.5e-3)


def connected(name, delay, local=True, control=True):
    gains = {part: {"local": local} for part in ("joint_constraint", "force_channel")}
    gains["passivity"] = {"control": control}
    connection = {"delay": delay, "jitter": 0.2, "loss": 0.05, "seed": 2}
    return varied(load_scene(name), controller=gains, connection=connection)


def lowest(scene, seconds):
    """Return the least of E_h, beyond what the mechanism gave of its own, J, and the worst force.

    E_h is the simulated device's own: exact work of what its actuators applied.
    """
    session, least, force = Session(scene), 0.0, 0.0
    inertia = passivity_for(scene).account.inertia
    work, before, gave = 0.0, None, 0.0
    for _ in range(round(seconds / session.period)):
        device = session.tick().device
        if before is not None:
            way = device.pose.translation - before.pose.translation
            turn = device.pose.rotation @ before.pose.rotation.T
            work -= device.applied[:3] @ way
            work -= device.applied[3:] @ pin.log3(turn)
        before = device
        gave = max(gave, -session.energies.to_mechanism)
        kinetic = 0.5 * device.twist @ (inertia * device.twist)
        least = min(least, work + kinetic + gave)
        force = max(force, float(np.linalg.norm(device.applied[:3])))
    return least, force


@pytest.mark.parametrize(
    ("name", "local", "delay"),
    [
        (name, *case)
        for name in ("five_bar", "two_link", "door", "shared_payload")
        for case in sampled(product((True, False), (0.002, 0.01, 0.05)), name, 3)
    ],
)
def test_the_hand_gets_no_energy_out_whatever_the_delay(name, local, delay):
    scene = connected(name, delay, local)
    least, force = lowest(scene, 1.5)
    assert least >= -1e-3
    assert force <= scene.device.force_limit * (1 + 1e-12)


def test_without_it_the_loop_that_is_closed_over_the_connection_diverges():
    least, _ = lowest(connected("five_bar", 0.05, local=False, control=False), 1.5)
    assert least < -0.1


def test_without_delay_it_changes_nothing():
    on, off = (Session(connected("five_bar", 0.0, control=control)) for control in (True, False))
    one, two = on.run(600), off.run(600)
    for name in ("device_position", "device_quaternion", "device_twist", "device_applied"):
        assert np.array_equal(one[name], two[name])
    assert on.passivity.changed == 0
    assert on.passivity.actuators == off.passivity.actuators != 0.0
