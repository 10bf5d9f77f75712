# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The linear copy of a session's loop, the rules of the literature, and the touch that decides."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.analysis import linear_loop
from hapticmech_ros.analysis import linear_loop as rules
from hapticmech_ros.analysis.experience import directions
from hapticmech_ros.analysis.linear_loop import NOBODY, Held, frontier, held_by, law_of, tick_matrix
from hapticmech_ros.analysis.scene_variants import (
    at_once,
    at_rate,
    held_by_nobody,
    held_still,
    scaled,
    with_constraint,
    with_device,
    with_loop,
    without_channel,
)
from hapticmech_ros.analysis.touch import MassHeldDevice, Setup, comes_to_rest, decays
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.clutch import pose_error
from hapticmech_ros.control.loop_stability import ON_CIRCLE, lead_gains, loop_terms, spectral_radius
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import shipped_scenes
from oracles.running import varied
from sampling import sampled


def matrix_of(scene, delay, held=NOBODY):
    found = directions(scene).analysis
    law = law_of(ControlArchitecture(scene), operational_model_of(found))
    return tick_matrix(scene, law, found.inverse_inertia, found.rows, delay, held)


@pytest.mark.parametrize("delay", [5, 10])
def test_without_prediction_hand_and_losses_it_is_the_loop_of_the_control(delay):
    """Where that diverges, so that rigid motions, of size 1, do not hide its largest eigenvalue."""
    scene = with_loop(held_by_nobody(load_scene("five_bar")), local=False)
    found = directions(scene).analysis
    control = ControlArchitecture(scene)
    terms = loop_terms(control, operational_model_of(found), found.rows)
    known = spectral_radius(terms, scene.simulation.period, delay)
    own = np.abs(np.linalg.eigvals(matrix_of(scene, delay))).max()
    assert known > 1.01
    assert own == pytest.approx(known, abs=1e-9)


def fixed(mass):
    """Return a hand whose mass (kg), and a thousandth of it in kg m², is fixed to the device."""
    nothing = np.zeros((6, 6))
    return Held(nothing, nothing, np.diag([mass] * 3 + [1e-3 * mass] * 3))


def growth(scene, hands, delays, lead, monkeypatch):
    """Return the largest eigenvalue's size for each hand and delay, with a lead G -> 2 (n, n)."""
    monkeypatch.setattr(linear_loop, "lead_gains", lead)
    return np.array(
        [
            np.abs(np.linalg.eigvals(matrix_of(scene, delay, hand))).max()
            for hand in hands
            for delay in delays
        ]
    )


@pytest.mark.parametrize("name", shipped_scenes())
def test_carrying_the_hand_s_wrench_on_makes_no_loop_less_stable(name, monkeypatch):
    """With masses of 0.05 to 20 kg that are fixed to the device, and with arms."""
    scene = load_scene(name)
    scene = scene.held_at(scene.held_points[0])
    arms = [
        held_by(scene.with_(hand={"kind": "arm", "impedance": one, "waypoints": [{"time": 0.0}]}))
        for one in ("firm", "relaxed")
    ]
    hands = [*map(fixed, (0.05, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0)), *arms]
    delays = sampled((0, 1, 3), name)
    without = growth(scene, hands, delays, lambda gain: (0.0 * gain, 0.0 * gain), monkeypatch)
    with_it = growth(scene, hands, delays, lead_gains, monkeypatch)
    assert (with_it <= np.maximum(without, 1.0) + ON_CIRCLE).all()


@pytest.mark.parametrize("local", [True, False])
def test_it_moves_as_a_session_does(local):
    """A spring hand and three periods of delay; what differs is of second order in the motion."""
    scene = with_loop(at_once(held_still(load_scene("scissor_lift"))), local)
    links = tuple(varied(link, joint={"damping": 0.0, "effort": 0.0}) for link in scene.links)
    scene = varied(scene, gravity=(0.0, 0.0, 0.0), springs=(), links=links)
    delay, n = 3, 3
    matrix = matrix_of(scene, delay, held_by(scene))
    rows, push = directions(scene).analysis.rows, np.array([1e-3, 1e-3, 0, 0, 0, 1e-5])
    session = Session(scene, command_delay=delay)
    # The first commands are nobody's, and are corrected by nothing.
    for _ in range(delay):
        session.tick()
    start = session.tick(hand_wrench=push).device.pose
    first = session.tick()
    state = np.zeros(len(matrix))
    state[:n] = pose_error(start, first.device.pose)[rows]
    state[n : 2 * n] = state[4 * n : 5 * n] = first.device.twist[rows]
    # The push of the first tick is what the hand did last, and was fed forward; it is on its way to
    # the mechanism.
    state[6 * n : 7 * n] = push[rows]
    law = law_of(ControlArchitecture(scene), operational_model_of(directions(scene).analysis))
    state[(8 + 2 * delay - 1) * n :] = push[rows]
    if not local:
        state[(8 + delay - 1) * n : (8 + delay) * n] = (law.force @ push)[rows]
    seen, copied = [], []
    for _ in range(40):
        seen.append(first.device.twist[rows])
        copied.append(state[n : 2 * n])
        first, state = session.tick(), matrix @ state
    assert np.abs(np.array(seen) - copied).max() < 2e-3 * np.abs(seen).max()


def test_a_mass_fixed_to_the_device_moves_with_it_and_says_what_it_takes():
    scene = held_by_nobody(load_scene("two_link"))
    device = MassHeldDevice(scene, 2.0)
    state = device.at_rest(Session(scene).tick().device.pose)
    command = np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0])
    state = device.step(state, command, None, 0)
    # 0.9 N on 0.3 kg and twice as much: 1 m/s², which takes 0.6 N of the hand.
    assert state.twist[0] == pytest.approx(1e-3, rel=1e-12)
    assert state.hand_wrench[0] == pytest.approx(-0.6, rel=1e-9)
    with pytest.raises(InvalidInputError, match=r"share.*-1"):
        MassHeldDevice(scene, -1.0)


def test_a_scene_on_another_device_has_its_figures_and_keeps_its_gains():
    scene = load_scene("door")
    found = with_device(scene, "omega_3")
    assert found.name == "door_omega_3"
    assert found.device.preset == "omega_3"
    assert found.device.mass != scene.device.mass
    assert found.controller == scene.controller
    with pytest.raises(InvalidInputError, match=r"device.*touch.*got 'mine'"):
        with_device(scene, "mine")


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (rules.passive_stiffness(3.0, 1.0, 1e-3), 4000.0),
        (rules.passive_stiffness(1.0, 3.0, 1e-3), 0.0),
        (rules.delayed_stiffness(1.0, 3.0, 1e-3, 1.5e-3), 2000.0),
        (rules.lightest_mass(0.3, 0.3), 0.1),
    ],
)
def test_rules_by_hand(found, expected):
    assert found == pytest.approx(expected, rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("rule", "given"),
    [
        (rules.passive_stiffness, (-1.0, 1.0, 1e-3)),
        (rules.delayed_stiffness, (1.0, 1.0, 0.0, 1e-3)),
        (rules.lightest_mass, (0.0, 1.0)),
    ],
)
def test_numbers_that_no_rule_takes_are_refused(rule, given):
    with pytest.raises(InvalidInputError, match=r"0 or more|positive"):
        rule(*given)


def hum(stiffness, physical, friction, speed):
    """Return how far a device still moves, in encoder steps, half a second after a touch."""
    step = 2e-5
    changes = {"damping": physical, "coulomb_friction": friction, "substeps": 16}
    scene = varied(load_scene("door"), device=changes | {"position_resolution": step})
    scene = with_constraint(without_channel(at_once(held_by_nobody(scene))), stiffness, 0.0)
    session = Setup(scene, delay=0).session()
    # The door is held along z.
    push = np.array([0.0, 0.0, scene.device.mass * speed / session.period, 0.0, 0.0, 0.0])
    ticks = range(700)
    places = [
        session.tick(hand_wrench=push if tick == 0 else None).device.pose.translation[2]
        for tick in ticks
    ]
    return np.ptp(places[500:]) / step


@pytest.mark.parametrize("speed", [2e-3, 2e-2])
def test_below_the_rule_of_encoder_steps_nothing_hums(speed):
    """min(2 b / T, 2 f_c / Δ) is 2000 N/m; a touch ends at rest, sticking.

    Diolaiti, Niemeyer, Barbagli and Salisbury, "Stability of haptic rendering: discretization,
    quantization, time delay, and Coulomb effects", IEEE Trans. Robotics 2006.
    """
    assert hum(1900.0, 1.0, 0.02, speed) == 0.0


def test_without_friction_encoder_steps_hum():
    """Below 2 b / T = 4000 N/m it does not grow, but a step or two stay for good."""
    assert 0.5 < hum(1900.0, 2.0, 0.0, 2e-3) < 5.0


def test_far_above_the_rule_friction_does_not_hold_it():
    """2 f_c / Δ = 2000 N/m: eight times that, a touch of 20 mm/s grows."""
    assert hum(16000.0, 0.0, 0.02, 2e-2) > 100.0


def test_a_frontier_is_found_from_either_side():
    for guess in (1e-3, 70.0, 1e4):
        found = frontier(lambda value: value < 70.0, guess, 1e-3, 1e4)
        assert 70.0 / 1.01 <= found < 70.0
    assert frontier(lambda value: True, 1.0, 0.1, 10.0) == 10.0
    assert frontier(lambda value: False, 1.0, 0.1, 10.0) is None
    with pytest.raises(InvalidInputError, match=r"positive and in order.*0\.0, 1\.0"):
        frontier(lambda value: True, 1.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("first", "last", "stable"),
    [(1.0, 0.97, True), (1.0, 1.0, False), (np.inf, np.inf, False), (1e-12, 1e-11, True)],
)
def test_what_stays_as_large_is_not_stable(first, last, stable):
    assert decays(first, last) == stable


def test_scaled_scenes_have_scaled_inertia_and_the_same_constraints():
    scene = load_scene("peg_in_hole")
    before, after = directions(scene), directions(scaled(scene, 4.0))
    scaled_inverse = 4.0 * after.analysis.inverse_inertia
    assert scaled_inverse == pytest.approx(before.analysis.inverse_inertia, rel=1e-9)
    assert after.analysis.spectrum.s == pytest.approx(before.analysis.spectrum.s, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda scene: scaled(scene, 0.0), r"factor.*positive.*got 0\.0"),
        (lambda scene: at_rate(scene, 1.0), r"rate.*10 Hz.*got 1\.0"),
        (lambda scene: with_constraint(scene, -1.0, 0.0), r"stiffness.*0 or more.*got -1\.0"),
        (lambda scene: matrix_of(scene, -1), r"delay.*0 or more.*got -1"),
        (
            lambda scene: comes_to_rest(Setup(scene), np.zeros(6), lambda _: np.zeros(1), 3, 1.0),
            r"ticks.*20 or more.*got 3",
        ),
    ],
)
def test_what_cannot_be_is_refused(change, message):
    with pytest.raises(InvalidInputError, match=message):
        change(load_scene("two_link"))
