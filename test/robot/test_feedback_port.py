# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The port of the robot's contact: a passive environment passes, energy from nothing does not."""

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.robot.interfaces import FeedbackPort, FeedbackSettings

PERIOD = 1e-3
X = np.eye(6)[0]


def settings(**changed):
    return FeedbackSettings(**{"period": PERIOD, "force": 1e3, "torque": 1e3, **changed})


def moved(port, lag, mass=1.0, stiffness=400.0, seconds=3.0):
    """Return the largest energy, J, of a mass on a spring that is felt some periods late.

    A wrench acts from the next sample on, as in a session.
    """
    x, v, forces, most, acting = 0.01, 0.0, [0.0] * (lag + 1), 0.0, 0.0
    for _ in range(round(seconds / PERIOD)):
        forces.append(-stiffness * x)
        force = float(port.wrench(forces[-1 - lag] * X, v * X)[0])
        x += PERIOD * v + 0.5 * PERIOD**2 * acting / mass
        v += PERIOD * acting / mass
        acting = force
        most = max(most, 0.5 * mass * v**2)
    return most


def test_a_delayed_spring_gives_energy_and_the_port_takes_it():
    """K T per period of delay is negative damping: 20 periods double the energy in 90 ms."""
    stored = 0.5 * 400.0 * 0.01**2
    free, held = FeedbackPort(settings(passive=False)), FeedbackPort(settings(allowance=stored))
    assert moved(free, lag=20) > 100.0 * stored
    # From rest, all that the mass can have is the allowance; a period's prediction of F v T beyond,
    # of accelerations of 4 m/s².
    assert moved(held, lag=20) < 1.1 * stored
    assert held.changed > 0
    assert held.given < 1.1 * stored
    assert held.dissipated > 0.0


def test_what_a_wrench_adds_to_the_speed_itself_is_counted():
    """A force that turns round every period, on a mass: W is its kinetic energy, exactly."""
    port, v, acting, mass = FeedbackPort(settings(passive=False)), 0.3, 0.0, 0.2
    start, energies = 0.5 * mass * v**2, []
    for tick in range(100):
        energies.append(0.5 * mass * v**2 - start)
        found = float(port.wrench((-1.0) ** tick * 20.0 * X, v * X)[0])
        assert port.given == pytest.approx(energies[-1], abs=1e-12)
        v += PERIOD * acting / mass
        acting = found
    # T F v of v at the start of each period leaves out half of this.
    assert max(energies) > 5e-3


def test_a_damper_is_never_changed():
    port, rng = FeedbackPort(settings(allowance=0.0)), np.random.default_rng(1)
    for _ in range(1000):
        twist = rng.normal(size=6)
        np.testing.assert_array_equal(port.wrench(-2.0 * twist, twist), -2.0 * twist)
    assert port.changed == 0


def test_what_is_left_keeps_to_the_allowance_and_is_a_damper_beside_the_wrench():
    port, rng = FeedbackPort(settings(allowance=1e-3)), np.random.default_rng(2)
    twist, acting = rng.normal(size=6), np.zeros(6)
    for _ in range(100):
        contact = twist + rng.normal(size=6)
        found = port.wrench(contact, twist)
        under_way = max(float(acting @ twist), 0.0)
        assert port.given + PERIOD * (under_way + float(found @ twist)) <= 1e-3 + 1e-15
        acting = found
        change = contact - found
        momentum = np.r_[twist[:3], 0.01 * twist[3:]]
        # Parallel to M v.
        assert np.abs(change * (momentum @ momentum) - (change @ momentum) * momentum).max() < 1e-10
    assert port.changed > 0


def test_a_mechanism_at_rest_feels_the_whole_contact():
    port = FeedbackPort(settings(allowance=0.0, share=0.5, force=3.0))
    port.given = 1.0
    np.testing.assert_allclose(port.wrench(4.0 * X, np.zeros(6)), 2.0 * X, atol=1e-15)
    np.testing.assert_allclose(port.wrench(40.0 * X, np.zeros(6)), 3.0 * X, atol=1e-15)
    port.begin()
    assert port.given == 0.0


@pytest.mark.parametrize(
    ("name", "value"), [("share", 1.5), ("force", -1.0), ("allowance", np.nan), ("period", 0.0)]
)
def test_settings_that_are_none_are_refused(name, value):
    with pytest.raises(InvalidInputError, match=name):
        settings(**{name: value})
