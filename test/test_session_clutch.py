# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The clutch slips while device and mechanism come to one velocity; forces act at once."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.analysis.scene_variants import with_loop
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.device.kernels import SimulatedState
from hapticmech_ros.scene.mechanism import Origin
from oracles.running import varied
from sampling import sampled

NOBODY = {"start_delay": 100.0}


def arm_that_moves(rate):
    """Return the shipped two-link arm with its joints turning (rad/s), and nobody's hand."""
    scene = load_scene("two_link")
    joints = tuple(joint.name for link in scene.links if (joint := link.joint).type == "revolute")
    start = {"v": dict.fromkeys(joints, rate)}
    return varied(scene, initial_state=start, gravity=(0.0, 0.0, 0.0), hand=NOBODY)


def felt(scene, at_once=False, ticks=1000):
    """Return the device's forces (n,), N; with a clutch that is closed from the start if asked."""
    session = Session(scene)
    if at_once:
        terms = session.simulator.evaluate(session.simulator.initial_state())
        session._clutch = engage(0.0, terms.points[0].pose, terms.points[0].pose)
    forces = [session.tick().output.device[:3] for _ in range(ticks)]
    return np.linalg.norm(forces, axis=1), session


@pytest.mark.parametrize("rate", [-1.0, 0.1, 2.0, 4.0])
def test_a_mechanism_that_moves_is_taken_hold_of_without_a_blow(rate):
    scene = arm_that_moves(rate)
    slipping, session = felt(scene)
    at_once, _ = felt(scene, at_once=True)
    assert slipping.max() < 0.5 * at_once.max()
    # It ends up held: both have one velocity.
    sample = session.tick()
    apart = sample.point.twist[:2] - sample.device.twist[:2]
    assert np.linalg.norm(apart) < 0.02 * abs(rate)


def coupled_at_1_m_per_s(direction, at_once):
    """Return the largest force (N) of a free device that is coupled to the five-bar at rest."""
    session = Session(varied(load_scene("five_bar"), hand=NOBODY))
    sample = session.tick()
    state, twist = SimulatedState(session._parts.state), np.zeros(6)
    twist[:2] = np.cos(direction), np.sin(direction)
    state.twist[:] = state.body.twist[:] = twist
    session._clutch = engage(session.time, sample.device.pose, sample.point.pose)
    if not at_once:
        session._clutch = None
    return np.linalg.norm(session.run(1000)["on_hand"][:, :3], axis=1).max()


@pytest.mark.parametrize(("at_once", "least", "most"), [(False, 0.38, 0.4), (True, 9.8, 10.6)])
def test_a_device_that_moves_is_slowed_by_dampers_as_documented(at_once, least, most):
    directions = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    forces = [coupled_at_1_m_per_s(direction, at_once) for direction in directions]
    digits = 1 if at_once else 2
    assert [round(min(forces), digits), round(max(forces), digits)] == [least, most]


@pytest.mark.parametrize(
    ("speed", "wanted"), [(0.0, 0.5), (0.05, 0.5), (0.1, 0.9), (0.2, 1.8), (1.0, 3.0), (5.0, 3.0)]
)
def test_a_ramp_is_as_long_as_the_device_s_speed_needs(speed, wanted):
    """2 * 1.2 m v / 0.08 N for 0.3 kg, from 0.5 s up to 3 s; nothing counts but the difference."""
    session = Session(varied(load_scene("five_bar"), hand=NOBODY))
    session.tick()
    state, twist = SimulatedState(session._parts.state), (speed, 0.0, 0.0, 0.0, 0.0, 0.0)
    state.twist[:] = state.body.twist[:] = twist
    session._clutch = None
    session.tick()
    assert session.clutch.duration == pytest.approx(wanted, rel=0.01)


@pytest.mark.parametrize("name", ["five_bar", "two_link"])
def test_a_hand_that_presses_against_a_constraint_is_caught_with_little_more_than_its_force(name):
    """Without the joints' wrench from the start, the force of a sudden load: twice the hand's."""
    session = Session(load_scene(name))
    resting = np.linalg.norm(session.run(6000)["on_hand"][-300:, :3], axis=1)
    start = session.tick()
    # It presses, and does not move.
    pressing = np.linalg.norm(start.device.hand_wrench[:3])
    assert np.abs(resting - pressing).max() < 0.01 * pressing
    session._clutch = None
    caught = np.linalg.norm(session.run(1000)["on_hand"][:, :3], axis=1)
    assert caught.max() < 1.1 * pressing
    # No moment without it, and the same rest as before.
    assert caught.min() > 0.8 * pressing
    assert np.abs(caught[-100:] - pressing).max() < 0.01 * pressing


@pytest.mark.parametrize("delay", [0.0, 0.01, 0.05])
def test_who_engages_anew_in_motion_feels_what_is_felt_without_an_interruption(delay):
    """Whatever the connection's delay; springs before forces would let both sides run apart."""
    scene = varied(load_scene("five_bar"), connection={"delay": delay})
    uninterrupted = np.linalg.norm(Session(scene).run(3500)["on_hand"][:, :3], axis=1).max()
    for start in (800, 1400, 2000, 2300):
        session = Session(scene)
        session.run(start)
        session._clutch = None
        caught = np.linalg.norm(session.run(1200)["on_hand"][:, :3], axis=1)
        assert 0.5 * uninterrupted < caught.max() < 1.1 * uninterrupted


class Failing(ControlArchitecture):
    """The scene's controllers, which give nothing between two times."""

    off = (np.inf, np.inf)

    def answer(self, time, *rest):
        if self.off[0] <= time < self.off[1]:
            return np.zeros((6, 6))
        return super().answer(time, *rest)


@pytest.mark.parametrize(
    ("milliseconds", "most"), sampled([(20, 0.57), (60, 0.61), (200, 0.61), (600, 0.8)], every=2)
)
def test_who_pushed_while_rendering_failed_is_slowed_evenly(milliseconds, most):
    """0.5 N on 0.3 kg; what it has got is braked with 0.08 N, or in 1.5 s at most."""
    scene = load_scene("five_bar")
    # With loops in the device the last answer would go on.
    ramp = {"engagement_ramp": scene.controller.engagement_ramp}
    scene = varied(with_loop(scene, False), controller=ramp)
    for start in (800, 1400, 2300):
        control = Failing(scene)
        session = Session(scene, control=control)
        session.run(start)
        control.off = (session.time - 1e-9, session.time + 1e-3 * milliseconds - 1e-9)
        failing = session.run(milliseconds)["on_hand"][1:, :3]
        assert np.abs(failing).max() == 0.0
        session._clutch = None
        caught = np.linalg.norm(session.run(3500)["on_hand"][:, :3], axis=1)
        assert 0.5 < caught.max() < most


def test_a_clutch_that_has_slipped_lets_all_through_whatever_the_first_ramp_was():
    """The ramp of a start is longer than that of a grasp: nothing falls back to it."""
    slow = {"engagement_ramp": 2.0, "grasp_ramp": 0.1}
    session = Session(varied(load_scene("five_bar"), controller=slow))
    session.run(2200)
    link = session.simulator.scene.operational_points[0].link
    session.set_operational_point(link, Origin(xyz=(0.0, 0.0, 0.0)))
    forces = [np.linalg.norm(session.tick().output.device[:3]) for _ in range(400)]
    assert max(forces) > 0.05
    assert np.abs(np.diff(forces)).max() < 0.1 * max(forces)
