# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""q ⊕ θ and J_r(θ)⁻¹ v inside kernels against Pinocchio's, at small angles and at large ones."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.kernels.manifold_kernels import (
    SERIES,
    configure,
    coordinates_of,
    local_rates,
    move,
)
from hapticmech_ros.scene import scene_from_document
from oracles.generator import random_mechanism
from sampling import sampled

# A handful of products, each rounded to 1e-16, of numbers of order 10.
ROUNDING = 1e-13
SIZES = (0.0, 1e-9, 1e-5, 0.9 * SERIES, 1.1 * SERIES, 2.0, 3.0)


def mechanisms():
    for seed in range(8):
        scene = scene_from_document(random_mechanism(seed, closed=False).document)
        mechanism = Mechanism(scene)
        yield (
            mechanism,
            pin.integrate(
                mechanism.model, pin.neutral(mechanism.model), np.sin(1.0 + np.arange(mechanism.nv))
            ),
        )


CASES = [
    (mechanism, q, size)
    for index, (mechanism, q) in enumerate(mechanisms())
    for size in sampled(SIZES, index)
]


def change(mechanism, size):
    """Return a change whose angles, joint by joint, are of a size; displacements are longer."""
    rng = np.random.default_rng(mechanism.nv)
    theta = rng.normal(size=mechanism.nv)
    for index, kind in enumerate(mechanism.tree.joint_types):
        part = mechanism.tree.velocity_slice(index)
        turning = theta[part][-3:] if kind in ("free", "spherical") else theta[part][-1:]
        theta[part] *= size / np.linalg.norm(turning)
    return theta


@pytest.mark.parametrize(("mechanism", "q", "size"), CASES)
def test_moves_are_pinocchios_in_place_too(mechanism, q, size):
    theta, found = change(mechanism, size), np.empty(mechanism.nq)
    model = mechanism.active_set((False,) * len(mechanism.closures)).model
    move(model, q, theta, found)
    expected = pin.integrate(mechanism.model, q, theta)
    apart = pin.difference(mechanism.model, expected, found)
    assert np.abs(apart).max() < ROUNDING * max(1.0, np.abs(theta).max())
    for index, kind in enumerate(mechanism.tree.joint_types):
        part = found[mechanism.tree.position_slice(index)]
        unit = {"free": part[3:], "spherical": part, "planar": part[2:]}.get(kind)
        assert unit is None or abs(np.linalg.norm(unit) - 1.0) < 1e-15
    in_place = q.copy()
    move(model, in_place, theta, in_place)
    assert (in_place == found).all()


@pytest.mark.parametrize("size", [*SIZES, np.pi - 1e-9, np.pi, 3.5, 6.0])
@pytest.mark.parametrize("mechanism", [mechanism for mechanism, _ in mechanisms()])
def test_coordinates_are_pinocchios_and_lead_back(mechanism, size):
    """Of angles beyond π the other rotation vector, as long as 2 π less."""
    neutral, theta = pin.neutral(mechanism.model), change(mechanism, size)
    q, found, again = np.empty(mechanism.nq), np.empty(mechanism.nv), np.empty(mechanism.nq)
    model = mechanism.active_set((False,) * len(mechanism.closures)).model
    configure(model, theta, q)
    expected = pin.integrate(mechanism.model, neutral, theta)
    largest = max(1.0, np.abs(theta).max())
    assert np.abs(pin.difference(mechanism.model, expected, q)).max() < ROUNDING * largest
    coordinates_of(model, q, found)
    configure(model, found, again)
    assert np.abs(pin.difference(mechanism.model, q, again)).max() < ROUNDING * largest
    if abs(size - np.pi) > 1e-3:
        expected = pin.difference(mechanism.model, neutral, q)
        np.testing.assert_allclose(found, expected, atol=10.0 * ROUNDING * largest)
    elif size < np.pi:
        np.testing.assert_allclose(found, theta, atol=10.0 * ROUNDING * largest)


@pytest.mark.parametrize(("mechanism", "q", "size"), CASES)
def test_local_rates_are_pinocchios(mechanism, q, size):
    theta, v = change(mechanism, size), np.cos(np.arange(mechanism.nv))
    model = mechanism.active_set((False,) * len(mechanism.closures)).model
    found = np.empty(mechanism.nv)
    local_rates(model, theta, v, found)
    # v is J_r(θ) θ̇, of Pinocchio's J_r.
    turned = pin.dIntegrate(mechanism.model, q, theta, pin.ArgumentPosition.ARG1)
    expected = np.linalg.solve(np.atleast_2d(turned), v)
    # Next to 2π the Jacobian is singular; at 3 rad it magnifies by about 3.
    assert np.abs(found - expected).max() < 100.0 * ROUNDING * max(1.0, np.abs(expected).max())
