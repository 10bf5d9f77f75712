# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stops of a joint: they push, never pull, and give back less than they took."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.kernels.element_kernels import _joint_forces
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.scene import scene_from_document
from mechanism.test_elements import one_joint
from oracles.slopes import slopes

STIFFNESS, DEPTH = 400.0, 0.05


class Stop:
    """A sliding joint with stops, by the functions of kernels."""

    def __init__(self, damping):
        limits = {"lower": -1.0, "upper": 0.5, "stiffness": STIFFNESS, "damping": damping}
        ends = {"axis": [1.0, 0.0, 0.0], "limits": limits | {"depth": DEPTH}}
        document = one_joint("prismatic", **ends)
        self.mechanism = Mechanism(scene_from_document(document))
        (self.values,) = Model(*self.mechanism.active_set(()).constants).element_values
        (self.element,) = self.mechanism.elements.joints

    def forces(self, q, v):
        return _joint_forces(self.values, q, v)

    def energy(self, q):
        return self.element.energy(q)

    def slopes(self, q, v, horizon):
        found = slopes(self.mechanism, np.array([q]), np.array([v]), horizon)
        return tuple(found[:, 0, 0].tolist())


def force_at(element, q, v):
    return sum(element.forces(q, v))


def bounce(element, q, v):
    """Return speed after, and energies on the way, of 1 kg let go towards a stop."""

    def inside(_, state):
        return min(state[0] + 1.0, 0.5 - state[0])

    # When it is back from the stop.
    inside.terminal, inside.direction = True, 1.0
    found = solve_ivp(
        lambda _, state: (state[1], force_at(element, *state)),
        (0.0, 2.0),
        (q, v),
        events=inside,
        rtol=1e-10,
        atol=1e-12,
        max_step=1e-2,
    )
    place, rate = found.y
    return abs(found.y_events[0][0][1]), 0.5 * rate**2 + np.vectorize(element.energy)(place)


@pytest.mark.parametrize("damping", [0.0, 5.0, 1000.0])
def test_a_stop_pushes_inwards_or_not_at_all(damping):
    element = Stop(damping)
    for depth, speed in itertools.product((1e-9, 0.02, DEPTH, 0.3), (-50.0, -1.0, 0.0, 1.0, 50.0)):
        assert force_at(element, -1.0 - depth, speed) >= 0.0
        assert force_at(element, 0.5 + depth, speed) <= 0.0
        # The two stops are mirror images.
        one, other = force_at(element, -1.0 - depth, speed), force_at(element, 0.5 + depth, -speed)
        assert one == pytest.approx(-other, rel=1e-6)
    assert force_at(element, 0.2, 30.0) == 0.0


@pytest.mark.parametrize("speed", [-20.0, 0.0, 20.0])
def test_a_stop_begins_without_a_jump(speed):
    element = Stop(1000.0)
    # The damper grows by damping / depth per metre: 20 N per 1e-12 m would be a jump.
    assert abs(force_at(element, 0.5 + 1e-12, speed)) < 1e-6
    assert force_at(element, 0.5, speed) == 0.0


@pytest.mark.parametrize(("depth", "soft"), [(0.01, 0.2), (DEPTH, 1.0), (0.2, 1.0)])
def test_the_force_is_the_formula(depth, soft):
    element = Stop(8.0)
    expected = -(STIFFNESS * depth + 8.0 * soft * 0.3)
    assert force_at(element, 0.5 + depth, 0.3) == pytest.approx(expected, rel=1e-12)
    # Leaving fast, the damper would pull: 8 * 10 against 400 * 0.05.
    elastic, lossy = element.forces(0.5 + DEPTH, -10.0)
    assert elastic == pytest.approx(-STIFFNESS * DEPTH, rel=1e-12)
    assert elastic + lossy == 0.0


@pytest.mark.parametrize("damping", [5.0, 20.0, 100.0])
@pytest.mark.parametrize(("q", "v"), [(0.45, 2.0), (-0.95, -2.0), (0.499, 0.1)])
def test_a_bounce_loses_energy(damping, q, v):
    speed, energies = bounce(Stop(damping), q, v)
    # What the tolerance of the integration leaves.
    assert np.diff(energies).max() < 1e-6 * energies[0]
    assert speed < 0.999 * abs(v)
    # The gentler, the less: Hunt and Crossley's restitution is 1 at no speed.
    assert bounce(Stop(damping), q, 0.1 * v)[0] / (0.1 * abs(v)) > speed / abs(v)


def test_a_bounce_without_damping_gives_all_back():
    speed, energies = bounce(Stop(0.0), 0.45, 2.0)
    assert speed == pytest.approx(2.0, rel=1e-6)
    assert np.ptp(energies) < 1e-5


def test_slopes_count_a_stop_that_is_met_within_the_horizon():
    element = Stop(8.0)
    assert element.slopes(0.4, 1.0, 0.05) == (0.0, 0.0)
    stiffness, damping = element.slopes(0.4, 1.0, 0.125)
    assert stiffness == STIFFNESS
    assert damping == pytest.approx(8.0 * 0.025 / DEPTH)
    assert element.slopes(0.4, -1.0, 0.125) == (0.0, 0.0)
    assert element.slopes(0.7, -1.0, 0.125) == (STIFFNESS, 8.0)
