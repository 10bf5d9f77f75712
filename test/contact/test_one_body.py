# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One body on a floor or a slope: analytic answers, shape by shape."""

import numpy as np
import pytest

from oracles.touching import SHAPES, G, on_floor, run

# Half of each shape's height, standing, m; and on how many points it rests.
HEIGHT = {"sphere": 0.05, "box": 0.05, "cylinder": 0.05, "capsule": 0.05}
POINTS = {"sphere": 1, "box": 4, "cylinder": 4, "capsule": 1}


@pytest.mark.parametrize("kind", SHAPES)
def test_a_body_rests_where_springs_carry_its_weight(kind):
    law = {"stiffness": 1e4, "damping": 50.0}
    _, states = run(on_floor(kind, HEIGHT[kind], law=law), 1.0, 1000)
    end = states[-1]
    sunk = HEIGHT[kind] - end.q[2]
    # Decayed by exp(-50 t / 2 m) and more: 1e-11 of a start 1 mm off.
    assert sunk == pytest.approx(G / (POINTS[kind] * 1e4), rel=1e-6)
    assert end.touching.forces.sum(axis=0) == pytest.approx([0, 0, G], abs=1e-6)
    assert np.abs(end.v).max() < 1e-7


def test_stiffness_far_above_the_explicit_limit_is_stable():
    """A step of 1 ms and 0.1 kg: an explicit rule needs k < 4 m / h² = 4e5 N/m."""
    document = on_floor("box", 0.06, mass=0.1, law={"stiffness": 1e6, "damping": 100.0})
    _, states = run(document, 1.0)
    assert states[-1].q[2] == pytest.approx(0.05 - 0.1 * G / 4e6, abs=1e-9)
    late = states[len(states) // 2 :]
    assert max(np.abs(state.v).max() for state in late) < 1e-9


@pytest.mark.parametrize(("kind", "friction"), [("box", 0.3), ("box", 0.1), ("cylinder", 0.4)])
def test_a_body_slides_as_far_as_coulomb_says(kind, friction):
    sunk = G / 4e5
    law = {"stiffness": 1e5, "damping": 100.0, "friction": friction}
    document = on_floor(kind, 0.05 - sunk, (1.0, 0.0, 0.0), law=law)
    _, states = run(document, 1.0 / (friction * G) + 0.2, 10)
    assert states[-1].q[0] == pytest.approx(1.0 / (2.0 * friction * G), rel=0.01)
    assert abs(states[-1].v[0]) < 1e-6


def test_a_sphere_that_slides_ends_in_rolling():
    """From v without spin it rolls at v (1 + I / (m r²))⁻¹, whatever the friction."""
    document = on_floor("sphere", 0.05, (1.0, 0.0, 0.0), law={"damping": 200.0, "friction": 0.3})
    _, states = run(document, 0.6, 200)
    share = 0.1**2 / 6.0 / 0.05**2
    # Speed in body axes, which turn; 1e-4 m of sinking takes 1e-3 of the radius.
    assert np.linalg.norm(states[-1].v[:3]) == pytest.approx(1.0 / (1.0 + share), rel=2e-3)
    halfway = np.linalg.norm(states[-2].v[:3])
    assert np.linalg.norm(states[-1].v[:3]) == pytest.approx(halfway, rel=1e-6)


@pytest.mark.parametrize("stiffness", [2e4, 1e5, 1e7])
def test_a_step_on_a_spring_is_the_one_derived(stiffness):
    """T15: y⁺ = (y + h v) / (1 + κ) and v⁺ = (v - κ y / h) / (1 + κ), y inwards, κ = k h² / m."""
    law, depth = {"stiffness": stiffness}, 2e-4 / np.sqrt(stiffness)
    document = on_floor("sphere", 0.05 - depth, (0, 0, -2e-4), law=law, gravity=(0, 0, 0))
    _, states = run(document, 0.002)
    kappa, h = stiffness * 1e-6, 1e-3
    inwards = [-state.v[2] for state in states]
    ahead = [0.05 - state.q[2] + 0.5 * h * v for state, v in zip(states, inwards, strict=True)]
    # Rounding of positions of 0.05 m, over a step.
    assert inwards[1] == pytest.approx(
        (inwards[0] - kappa * ahead[0] / h) / (1.0 + kappa), rel=1e-9, abs=1e-12
    )
    assert ahead[1] == pytest.approx((ahead[0] + h * inwards[0]) / (1.0 + kappa), abs=1e-14)
