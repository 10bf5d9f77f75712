# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""D, h and the operational point's kinematics against references that know no Pinocchio."""

import numpy as np
import pytest

from oracles import newton_euler
from oracles.analysed import terms_of
from oracles.differences import relative, second_derivative
from oracles.generator import random_mechanism
from oracles.kinematics import point_pose
from sampling import sampled

# First differences with h = 1e-3: eps/h = 2e-13 times a few units of scale, truncation 1e-12.
FIRST = 1e-9
# Second differences with h = 4e-3: eps/h^2 = 1e-11, truncation h^4 |v|^6/90 = 1e-9 for |v| = 3.
SECOND = 1e-6

SAMPLES = [(seed, planar) for planar in (False, True) for seed in sampled(range(6), planar)]


@pytest.mark.parametrize(("seed", "planar"), SAMPLES)
def test_inertia_and_bias_are_those_of_newton_and_euler(seed, planar):
    sample = random_mechanism(seed, planar)
    terms = terms_of(sample.document, sample.q, sample.v)

    def retract(q, change):
        return terms.mechanism.integrate(q, change)

    inertia, bias = newton_euler.dynamics(sample.document, retract, sample.q, sample.v)
    assert relative(terms.d, inertia) < FIRST
    assert relative(terms.evaluation.bias_force, bias) < SECOND


@pytest.mark.parametrize(("seed", "planar"), SAMPLES)
@pytest.mark.parametrize("index", [0, 1])
def test_point_pose_jacobian_and_drift(seed, planar, index):
    sample = random_mechanism(seed, planar)
    terms = terms_of(sample.document, sample.q, sample.v)
    point = terms.evaluation.points[index]

    def pose(change):
        q = terms.mechanism.integrate(sample.q, change)
        return point_pose(sample.document, q, index)

    zero = np.zeros(sample.v.size)
    here = pose(zero)
    # Products of at most six rotations: a few roundings each.
    assert relative(point.pose.translation, here[1]) < 1e-13
    assert relative(point.pose.rotation, here[0]) < 1e-13
    assert relative(point.jacobian, newton_euler.jacobian_of(pose, zero.size)) < FIRST
    # Along q (+) t v the joint rates do not change, so that what is left is J' v.
    accel = second_derivative(lambda t: pose(t * sample.v)[1])
    turning = newton_euler.vee(second_derivative(lambda t: pose(t * sample.v)[0]) @ here[0].T)
    expected = np.concatenate((accel, turning))
    scale = max(float(np.linalg.norm(expected)), float(sample.v @ sample.v))
    assert relative(point.drift, expected, scale) < SECOND
