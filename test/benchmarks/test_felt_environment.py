# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is felt of a robot's environment: impedances in closed form, and the linear loop's."""

from itertools import product

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.robot import felt_environment as measured
from benchmarks.robot.environment import loop
from benchmarks.robot.felt_environment import (
    ClosedForm,
    RobotInEnvironment,
    device_twists,
    felt_environment,
    transfer,
)
from hapticmech_ros.analysis.impedance import alone
from hapticmech_ros.analysis.touch import ROWS, Setup, fine_times
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.robot.law import Gains
from hapticmech_ros.robot.linear_environment import CONTACT, Impedance, LinearEnvironment
from sampling import sampled

S = 2.0j * np.pi * np.array([0.5, 2.0, 8.0, 32.0])


@pytest.mark.parametrize(
    "impedance", [Impedance(300.0, 6.0), Impedance(300.0, 6.0, 0.3), Impedance(20e3, 400.0)]
)
def test_an_environment_in_time_has_its_dynamic_stiffness(impedance):
    """F = -E x for x = cos(2 π f t) along a line, after what its own motion leaves has decayed."""
    step, direction = 2.5e-4, np.array([0.6, 0.0, 0.8])
    for s in S[:3]:
        made, omega = LinearEnvironment(impedance, direction), s.imag
        made.advance(np.zeros(3), np.zeros(3), step)
        count = round(2.0 / step)
        times = step * np.arange(3 * count)
        forces = np.array(
            [
                made.advance(
                    np.cos(omega * t) * direction, -omega * np.sin(omega * t) * direction, step
                )
                @ direction
                for t in times
            ]
        )
        # Over whole periods.
        found = 2.0 * np.mean(forces[-count:] * np.exp(-1j * omega * times[-count:]))
        expected = -impedance.dynamic_stiffness(np.array([s]))[0]
        # Steps of 0.25 ms, semi-implicit: half a step of phase of the own mass, ω h / 2 = 0.6 %.
        assert abs(found / expected - 1.0) < 0.01


def test_a_mass_behind_its_contact_is_the_series_of_both():
    found = Impedance(0.0, 0.0, 0.3).dynamic_stiffness(S)
    expected = 1.0 / (1.0 / (CONTACT[0] + CONTACT[1] * S) + 1.0 / (0.3 * S**2))
    np.testing.assert_allclose(found, expected, rtol=1e-13)


@pytest.mark.parametrize("interface", ["effort", "velocity", "trajectory"])
def test_a_robot_in_the_air_follows_slow_motion_exactly(interface):
    found = transfer(Gains(), 1.0, 0.0 * S, interface, 1e-3 * S, 1e-3)
    # To second order in s / ω, of 0.03 1/s over 30.
    np.testing.assert_allclose(found, 1.0, atol=1e-3)


def test_impedances_that_are_none_are_refused():
    with pytest.raises(InvalidInputError, match="stiffness"):
        Impedance(-1.0)
    with pytest.raises(InvalidInputError, match="mass"):
        Impedance(mass=np.nan)


def answered(interface, impedance, frequency):
    """Return F over -x_d of a robot whose target swings along x, relative to E H; complex."""
    given, period, size = loop(), 1e-3, 1e-4
    made, omega = RobotInEnvironment(given, interface, impedance), 2.0 * np.pi * frequency
    forces, window = [], 1000
    for tick in range(3 * window):
        time = period * tick
        # Over the first second a growing amplitude, a (1 - cos π t) / 2.
        fade = 0.5 * (1.0 - np.cos(np.pi * min(time, 1.0)))
        slope = 0.5 * np.pi * np.sin(np.pi * time) if time < 1.0 else 0.0
        sine, cosine = np.sin(omega * time), np.cos(omega * time)
        place = np.array([size * fade * sine, 0.0, 0.0])
        twist = np.zeros(6)
        twist[0] = size * (fade * omega * cosine + slope * sine)
        made.follower.update_target(pin.SE3(np.eye(3), place), twist, time)
        forces.append(made.go_on(time)[0])
    times = period * np.arange(2 * window, 3 * window)
    turned = np.exp(-1j * omega * times)
    found = 2.0 * np.mean(np.array(forces[-window:]) * turned) / (size / 1j)
    s = np.array([1j * omega])
    stiff = impedance.dynamic_stiffness(s)
    through = transfer(given.gains, made.mobility, stiff, interface, s, period)
    return -found / (stiff * through)[0]


@pytest.mark.parametrize(
    ("impedance", "frequency"),
    sampled(product([Impedance(300.0, 6.0), Impedance(20e3, 400.0)], [5.0, 30.0]), every=2),
)
def test_a_robot_that_takes_torques_presses_as_the_closed_form_says(impedance, frequency):
    """The sensor tells the force of the last of four steps: up to 0.25 ms late."""
    found = answered("effort", impedance, frequency)
    # Of the law's semi-implicit steps besides, ω T / 2 = 2 % of 40 1/s.
    assert abs(abs(found) - 1.0) < 0.01
    assert 0.0 <= -np.angle(found) <= 2.0 * np.pi * frequency * 0.25e-3


@pytest.mark.parametrize("interface", sampled(["velocity", "position", "trajectory"]))
def test_a_robot_with_a_servo_presses_as_the_closed_form_says(interface):
    # The closed form's servo is continuous: half a period of 2 π 5 Hz, 1.6 %.
    assert abs(answered(interface, Impedance(300.0, 6.0), 5.0) - 1.0) < 0.016


@pytest.mark.parametrize(
    ("impedance", "felt"),
    sampled([(Impedance(300.0, 6.0), 0.86), (Impedance(20e3, 400.0), 0.08)]),
)
def test_what_a_tool_is_fixed_to_is_felt_as_the_linear_loop_says(monkeypatch, impedance, felt):
    """A robot gives way by ω² / X, 1.7 kN/m: at 1 Hz to a spring by 14 %, to a wall by 92 %."""
    # Nothing swings here that would have to die away.
    monkeypatch.setattr(measured, "FADING_S", 0.5)
    monkeypatch.setattr(measured, "SETTLING_S", 2.0)
    found = felt_environment(loop(), "fixed", impedance, "effort", 0)
    assert found.steady
    assert found.stable
    assert abs(found.ratio[0]) == pytest.approx(felt, rel=0.02)
    # The sensor tells the force of the last of four steps: up to 0.25 ms of 2 π 10 Hz, 1.6 %.
    assert found.model_error(10.0) < 0.016


@pytest.mark.parametrize(
    ("interface", "impedance", "delay", "stable"),
    sampled(
        [
            ("effort", Impedance(300.0, 6.0), 5, True),
            ("effort", Impedance(20e3, 400.0), 0, True),
            ("effort", Impedance(20e3, 400.0), 5, False),
            ("position", Impedance(300.0, 6.0), 0, False),
            ("trajectory", Impedance(300.0, 6.0), 0, True),
        ],
        every=2,
    ),
)
def test_a_loop_that_the_closed_form_has_unstable_grows(interface, impedance, delay, stable):
    """By Nyquist's criterion, against 1.5 s of a session that is touched once."""
    given = loop()
    robot = RobotInEnvironment(given, interface, impedance)
    closed = ClosedForm(given, interface, impedance, robot.mobility, delay, 1)
    assert closed.is_stable() is stable
    periods = 1500
    push = np.zeros((fine_times(1e-3, periods).size, 6))
    push[: 20 * ROWS, 0] = 0.02
    try:
        twists = device_twists(Setup(alone(given.scene), "", 1), robot, push, delay)[:, 0]
        early, late = np.abs(twists[300:600]).max(), np.abs(twists[-300:]).max()
        grows = bool(late > 2.0 * early)
    except HapticMechError:
        # The robot's motion is lost.
        grows = True
    assert grows is not stable
