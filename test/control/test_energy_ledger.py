# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controllers' account against integrals that are known."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.account_kernels import (
    account_for_motion,
    account_for_springs,
    queue_wrench,
)
from hapticmech_ros.control.architecture import PositionChannels
from hapticmech_ros.control.loop_layout import ControllerSettings
from hapticmech_ros.control.rendering_controller import RenderingController
from hapticmech_ros.scene.controller import (
    JointConstraintGains,
    PositionChannelGains,
)

PERIOD = 1e-3
CHANNELS = PositionChannels(PositionChannelGains(), np.ones(6), 0.0)


class Ledger(RenderingController):
    """The account of a controller, by its kernels' functions."""

    def __init__(self):
        scene = load_scene("five_bar")
        super().__init__(ControlArchitecture(scene), PERIOD, scene.connection, delay=0)

    def acts(self, wrench):
        queue_wrench(self.account, self.queue, wrench, np.empty(6))

    def moved(self, twist, duration):
        account_for_motion(self.account, twist, duration)

    def answered(self, error, projector, joint, channels):
        settings = ControllerSettings()
        settings.joint_stiffness, settings.joint_damping = joint.stiffness, joint.damping
        settings.stiffness[:], settings.damping[:] = channels.stiffness, channels.damping
        account_for_springs(self.account, settings, error, projector)


def test_what_the_mechanism_got_is_its_own_work():
    """Equal to the mechanism's account of work, but for the trapezoid's second order."""
    session = Session(load_scene("five_bar"))
    session.run(1999)
    sample = session.tick()
    ledger, own = session.energies.to_mechanism, sample.mechanism.account.work_in
    assert own > 1e-3
    assert ledger == pytest.approx(own, rel=1e-4)


def test_what_came_in_is_held_or_lost():
    """A hand against joints that hold: all of it is in the springs, or went in the dampers."""
    session = Session(load_scene("door"))
    session.run(2249)
    device = session.tick().device
    entry, account = session.energies, session.passivity
    kinetic = account.hand(np.concatenate((device.published[:13], np.zeros(6))))
    balance = kinetic - entry.to_mechanism - entry.stored - entry.dissipated + entry.injected
    # The device's own kinetic energy is felt as a part of the mechanism's.
    assert abs(balance) < 0.1 * kinetic


def test_a_direction_that_comes_while_there_is_an_error_brings_its_energy():
    ledger, joint = Ledger(), JointConstraintGains()
    error = np.array([1e-3, 0, 0, 0, 0, 0])
    none, one = np.zeros((6, 6)), np.diag([1.0, 0, 0, 0, 0, 0])
    ledger.answered(error, none, joint, CHANNELS)
    ledger.answered(error, one, joint, CHANNELS)
    assert ledger.account.energies.injected == pytest.approx(0.5 * joint.stiffness * 1e-6)
    ledger.answered(error, none, joint, CHANNELS)
    assert ledger.account.energies.injected == pytest.approx(0.0, abs=1e-18)
    assert ledger.account.energies.stored == pytest.approx(0.5 * 300.0 * 1e-6)


def test_dampers_lose_what_their_force_does():
    ledger, joint = Ledger(), JointConstraintGains(damping=30.0)
    projector, speed = np.diag([1.0, 0, 0, 0, 0, 0]), 0.02
    for tick in range(501):
        error = np.array([speed * tick * PERIOD, 0, 0, 0, 0, 0])
        ledger.answered(error, projector, joint, CHANNELS)
    assert ledger.account.energies.dissipated == pytest.approx((30.0 + 10.0) * speed**2 * 0.5)
    # Springs that stay as they are bring nothing.
    assert ledger.account.energies.injected == pytest.approx(0.0, abs=1e-18)


def test_held_elsewhere_nothing_is_made_up():
    ledger, joint = Ledger(), JointConstraintGains()
    ledger.acts(np.ones(6))
    ledger.moved(np.ones(6), PERIOD)
    ledger.moved(np.ones(6), PERIOD)
    given = ledger.account.energies.to_mechanism
    assert given == pytest.approx(6.0 * PERIOD)
    ledger.answered(np.full(6, 1e-3), np.eye(6), joint, CHANNELS)
    before = ledger.account.energies.injected
    ledger.held_elsewhere()
    ledger.moved(np.full(6, -50.0), PERIOD)
    ledger.answered(np.full(6, 5e-3), np.zeros((6, 6)), joint, CHANNELS)
    assert ledger.account.energies.to_mechanism == given
    assert ledger.account.energies.injected == before
