# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Delays that are measured and declared: what gains are made for, and when they change."""

import json

import numpy as np
import pytest

from hapticmech_ros.analysis.scene_variants import with_loop
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.loop_delay import (
    EVERY,
    SHORTER_AFTER_S,
    WINDOW,
    DelayFollower,
    RoundTripEstimate,
    admissible_round_trip,
    compensated_loop_delay,
    jitter_allowance,
    made_for,
    periods_before,
)
from hapticmech_ros.control.rendering_controller import ControllerInput, RenderingController
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics.layout import OperationalModelSample
from hapticmech_ros.plan.loop_check import loop_warning
from hapticmech_ros.scene.controller import Connection
from oracles.running import varied


def over(connection, local=True, name="five_bar"):
    gains = {"joint_constraint": {"local": local}}
    return varied(load_scene(name), connection=connection, controller=gains)


def test_what_is_declared_counts_in_design_as_what_is_simulated():
    simulated, declared = over(Connection(delay=0.05)), over(Connection(expected=0.05))
    assert compensated_loop_delay(declared) == compensated_loop_delay(simulated) > 0.1
    one, two = ControlArchitecture(simulated).channels, ControlArchitecture(declared).channels
    assert np.array_equal(one.held_stiffness, two.held_stiffness)
    assert one.held_stiffness[0] < 0.1 * one.stiffness[0]
    both = over(Connection(delay=0.02, expected=0.03))
    assert compensated_loop_delay(both) == pytest.approx(
        compensated_loop_delay(declared), abs=1e-15
    )


def test_the_rule_softens_springs_that_cross_a_declared_network(tmp_path):
    file = tmp_path / "scene.yaml"
    written = load_scene("two_link").model_dump(mode="json")
    written["controller"]["joint_constraint"] = {"local": False}
    file.write_text(json.dumps(written), "utf-8")
    near, far = (load_scene(file, 0.0, delay).controller.joint_constraint for delay in (0.0, 0.05))
    assert far.stiffness < 0.01 * near.stiffness
    assert load_scene(file, 0.0, 0.05).connection.expected == 0.05


@pytest.mark.parametrize(
    ("connection", "at_once"),
    [(Connection(), True), (Connection(expected=0.05), True), (Connection(delay=0.05), False)],
)
def test_what_is_declared_is_not_simulated(connection, at_once):
    scene = over(connection)
    side = RenderingController(ControlArchitecture(scene), scene.simulation.period, connection)
    inputs = ControllerInput(
        0.0, 0, np.eye(19)[6], np.zeros(OperationalModelSample.layout.size), 0, 1_000_000
    )
    inputs.operational_model[OperationalModelSample.layout.slice("quaternion").stop - 1] = 1.0
    clutch = side.control.engage(0.0, inputs.device, inputs.operational_model, 0.0)
    assert (side.tick(inputs, clutch, corrects=True) is not None) == at_once


def test_an_estimate_is_high_in_the_jitter_and_forgets_hiccups():
    estimate = RoundTripEstimate()
    rng = np.random.default_rng(1)
    for _ in range(EVERY - 1):
        estimate.add(0.1)
    assert estimate.value == 0.0
    for _ in range(WINDOW):
        estimate.add(0.1 + rng.uniform(-0.02, 0.02))
    assert 0.115 < estimate.value < 0.12
    for number in range(WINDOW + EVERY):
        estimate.add(3.0 if number % 50 == 0 else 0.02)
    assert estimate.value == 0.02


def test_round_trips_together_are_as_one_after_the_other():
    rng, alone, together = np.random.default_rng(2), RoundTripEstimate(), RoundTripEstimate()
    for count in (1, 0, EVERY - 2, 3, 7 * EVERY + 5, 3 * WINDOW + 11, EVERY, 2):
        trips = rng.uniform(0.01, 0.1, count)
        for trip in trips:
            alone.add(trip)
        together.extend(trips)
        assert together.value == alone.value
    assert alone.value > 0.0


def test_a_longer_way_is_followed_at_once_and_a_shorter_one_after_a_while():
    follower = DelayFollower(Connection(expected=0.01))
    assert not follower.follow(0.024, 0.0)  # declared, with its jitter, and a graph's own
    assert follower.delay == 0.01
    assert follower.follow(0.1, 1.0)
    assert follower.delay == 0.05
    assert not follower.follow(0.105, 1.1)  # no other one
    assert not follower.follow(0.03, 2.0)
    assert not follower.follow(0.03, 2.0 + 0.9 * SHORTER_AFTER_S)
    assert not follower.follow(0.1, 4.0)  # it was a dip: the count begins anew
    assert not follower.follow(0.02, 4.1)
    assert follower.follow(0.02, 4.2 + SHORTER_AFTER_S)
    assert follower.delay == 0.01  # never below what is declared


def test_the_admissible_round_trip_follows_from_loops_over_the_connection():
    scene = over(Connection())
    inertia = np.diag(ControlArchitecture(scene).device_inertia)
    period = scene.simulation.period
    local = admissible_round_trip(scene.controller, inertia, period)
    position = scene.controller.position_channel
    assert local == pytest.approx(0.3 * 0.3 / position.damping - 1.5 * period)
    late = admissible_round_trip(over(Connection(), local=False).controller, inertia, period)
    assert late < local
    none = varied(scene.controller, position_channel={"to_device": 0.0})
    assert admissible_round_trip(none, inertia, period) == np.inf


def test_gains_made_for_a_delay_are_softer_only_where_they_cross_it():
    scene = over(Connection())
    period = scene.simulation.period
    assert made_for(scene.controller, scene.device, period, 0.05) is scene.controller
    late = over(Connection(), local=False).controller
    softer = made_for(late, scene.device, period, 0.05).joint_constraint
    assert softer.stiffness == pytest.approx(0.3 * (0.3 / 0.102) ** 2)
    assert softer.damping < late.joint_constraint.damping
    assert made_for(late, scene.device, period, 0.0).joint_constraint == late.joint_constraint


def test_gains_pass_to_another_delay_without_a_bump():
    scene = over(Connection())
    control = ControlArchitecture(scene)
    near = control.channels.held_stiffness[0]
    control.tune(1.0, scene.controller, 0.05)
    assert control.aim == (scene.controller, 0.05)
    ramp, seen = scene.controller.gain_ramp, []
    for share in np.linspace(0.0, 1.0, 301):
        control.apply_gains_at(1.0 + share * ramp)
        seen.append(control.channels.held_stiffness[0])
    assert seen[0] == near
    assert np.all(np.diff(seen) <= 0.0)
    # A millimetre makes less than 0.03 N of it, from one sample to the next.
    assert np.abs(np.diff(seen)).max() < 30.0
    assert control.delay == 0.05
    far = ControlArchitecture(over(Connection(expected=0.05))).channels.held_stiffness
    assert np.array_equal(control.channels.held_stiffness, far)
    # Gains that are tuned later stay made for it.
    control.tune(2.0, scene.controller)
    assert control.aim == (scene.controller, 0.05)


@pytest.mark.parametrize(
    ("connection", "allowed"),
    [
        (Connection(), 0.0),
        (Connection(delay=0.05, jitter=0.2), 0.0),  # simulated: not silence
        (Connection(expected=0.01), 0.002),
        (Connection(expected=0.05), 0.005),
    ],
)
def test_jitter_is_waited_for_but_not_for_long(connection, allowed):
    assert jitter_allowance(connection) == pytest.approx(allowed, rel=1e-15, abs=0.0)


@pytest.mark.parametrize("delay", [0.01, 0.05])
def test_only_what_crosses_a_connection_is_warned_of(delay):
    for name in ("five_bar", "door"):
        scene = over(Connection(expected=delay), name=name)
        assert loop_warning(scene, scene.operational_points[0].name, scene.controller) == ""
    late = over(Connection(expected=delay), local=False)
    sentence = loop_warning(late, "handle", late.controller)
    assert f"too stiff for a connection of {1e3 * delay:g} ms each way" in sentence


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_a_device_that_corrects_commands_is_ahead_of_the_mechanism_by_the_delay(delay):
    scene = load_scene("five_bar")
    period = scene.simulation.period
    with_it, without = (
        compensated_loop_delay(with_loop(scene, local), delay) for local in (True, False)
    )
    # Half a period for the hold of what acts, and of what the mechanism learns of the hand.
    assert without == (delay + 0.5) * period
    assert with_it == pytest.approx(2.0 * without, abs=1e-15)


def test_a_negative_delay_is_refused():
    with pytest.raises(InvalidInputError, match="0 or more periods"):
        compensated_loop_delay(load_scene("five_bar"), -1)


@pytest.mark.parametrize(
    ("delay", "local", "periods"), [(0, False, 1), (1, False, 2), (1, True, 3)]
)
def test_past_rates_are_of_as_many_periods_ago_as_the_delay_has(delay, local, periods):
    scene = with_loop(load_scene("five_bar"), local)
    assert periods_before(scene, delay) == periods
    assert periods_before(scene.with_(connection={"expected": 0.05}), delay) == 0
