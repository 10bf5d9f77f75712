# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rates from a delay and a payload: the loop of law and observer is stable as far as they say."""

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.robot.law import (
    GAIN_MARGIN,
    Gains,
    Tuning,
    inertia_ratio,
    longest_delay,
    loop_rates,
)
from hapticmech_ros.robot.mujoco_robot import Around, MujocoRobot, Unmodelled
from oracles.driven_robots import law_of, poses, robot

PERIOD = 1e-3


def growth(rate, observer, ratio, period=PERIOD):
    """Return the largest |pole| of one direction with law and observer, a period late.

    The inertia known is 1, the real one ``ratio``; state: x, v, the torque that acts, the one
    before, and the observer's integral and estimate, as the benchmark's trials have them.
    """
    x, v, acts, acted, integral, seen = np.eye(6)
    integral = integral + period * (acted + seen)
    seen = observer * (v - integral)
    ordered = -2.0 * rate * v - rate**2 * x - seen
    moved = acts / ratio
    after = x + period * v + 0.5 * period**2 * moved, v + period * moved
    return np.abs(np.linalg.eigvals([*after, ordered, acts, integral, seen])).max()


@pytest.mark.parametrize("ratio", [1.0, 3.0, 6.0, 10.0, 30.0])
def test_the_loop_bears_the_payload_it_is_made_for_and_not_what_routh_excludes(ratio):
    """The delay takes a part of the gain margin, and leaves some of it."""
    found = loop_rates(1.5 * PERIOD, ratio)
    for borne in np.linspace(1.0, ratio, 12):
        assert growth(*found, borne) < 1.0
    assert growth(*found, max(GAIN_MARGIN * ratio, 9.0)) > 1.0


def test_without_an_observer_every_payload_is_borne():
    found = loop_rates(1.5 * PERIOD, 10.0, observed=False)
    assert found.observer == 0.0
    for ratio in np.geomspace(1.0, 1000.0, 20):
        x, v, acts = np.eye(3)
        ordered = -2.0 * found.law * v - found.law**2 * x
        moved = acts / ratio
        after = x + PERIOD * v + 0.5 * PERIOD**2 * moved, v + PERIOD * moved
        assert np.abs(np.linalg.eigvals([*after, ordered])).max() < 1.0


def test_the_gain_high_up_is_half_of_what_a_delay_allows():
    """Between the loop without payload and instability there is a gain margin of more than 2."""
    for ratio in (1.0, 10.0):
        found = loop_rates(1.5 * PERIOD, ratio)
        assert 2.0 * found.law + found.observer == pytest.approx(1.0 / (3.0 * PERIOD))
        assert growth(*found, 0.5) < 1.0
        assert growth(*found, 0.25) > 1.0


@pytest.mark.parametrize("zeta", [0.1, 0.5, 0.7, 1.0, 2.0])
@pytest.mark.parametrize("observer", [0.0, 10.0, 30.0])
def test_the_longest_delay_is_below_the_delay_margin(zeta, observer):
    """The margin by the loop's frequency response: its phase where |L| = 1, over that frequency."""
    rate = 30.0
    found = longest_delay(Tuning(Gains(rate, 0.5 * rate, zeta), observer))
    s = 1j * np.geomspace(0.1, 1e3, 200_001)
    linear = rate**2 + 2.0 * zeta * rate * observer
    loop = ((2.0 * zeta * rate + observer) * s**2 + linear * s + rate**2 * observer) / s**3
    # The gain falls throughout where it is about 1.
    at = int(np.flatnonzero(np.abs(loop) > 1.0)[-1])
    margin = float(np.angle(-loop[at])) / s[at].imag
    assert 0.0 < found < margin
    if zeta == 1.0:
        assert found > 0.75 * margin


def test_a_payload_multiplies_inertia_by_what_mujoco_has():
    """The largest eigenvalue of D with the payload, by MuJoCo, over D without it."""
    law = law_of("ur5e")
    q = np.array([0.0, -1.9, 1.9, -0.5, -0.6, 0.0])
    state, beyond, mass = law.state(q, np.zeros(6)), 0.1, 1.0
    carrying = Around(unmodelled=Unmodelled(payload=mass, beyond=beyond))
    moved = MujocoRobot(robot("ur5e").scene, around=carrying)
    moved.put(q, np.zeros(6))
    factor = np.linalg.inv(state.factor)
    largest = np.linalg.eigvalsh(factor @ moved.terms()[0] @ factor.T)[-1]
    found = inertia_ratio(state, mass, np.array([0.0, 0.0, beyond]))
    # The payload's own inertia in MuJoCo, 1e-4 kg m², is a third of the flange's.
    assert found == pytest.approx(largest, rel=5e-3)
    jacobian = state.point.jacobian[:3]
    at_tool = MujocoRobot(robot("ur5e").scene, around=Around(unmodelled=Unmodelled(payload=mass)))
    at_tool.put(q, np.zeros(6))
    added = at_tool.terms()[0] - state.factor @ state.factor.T
    # m Jᵀ J, and that inertia.
    np.testing.assert_allclose(added, mass * jacobian.T @ jacobian, atol=4.1e-4)


def test_what_is_no_delay_ratio_or_payload_is_refused():
    with pytest.raises(InvalidInputError, match="delay"):
        loop_rates(0.0)
    with pytest.raises(InvalidInputError, match="inertia_ratio"):
        loop_rates(1e-3, 0.5)
    state = law_of("ur5e").state(np.zeros(6), np.zeros(6))
    with pytest.raises(InvalidInputError, match="payload"):
        inertia_ratio(state, -1.0, np.zeros(3))


def test_what_a_payload_makes_of_the_inertia_hardly_depends_on_the_pose():
    law, far = law_of("ur5e"), np.array([0.0, 0.0, 0.1])
    found = [inertia_ratio(law.state(q, v), 1.0, far) for q, v in poses("ur5e", 50)]
    assert np.median(found) == pytest.approx(10.0, abs=0.5)
    assert max(found) < 1.1 * np.median(found)
    assert loop_rates(1.5 * PERIOD, max(found)).observer > 25.0
