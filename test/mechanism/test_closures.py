# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every kind of closure: residual, Jacobian and bias, on and off the closed position."""

import copy
from itertools import product

import numpy as np
import pytest

from oracles.analysed import terms_of
from oracles.differences import columns, relative, second_derivative
from oracles.generator import random_mechanism, random_origin
from oracles.kinematics import closure_residual, frame_pose, link_poses, origin_in
from sampling import sampled

# Kinds of closures, and whether in a plane.
KINDS = [(kind, False) for kind in ("spherical", "revolute", "weld", "rod")]
KINDS += [("planar_pin", True), ("rod", True)]


def sample_with(kind, planar, seed, off):
    """Return a tree with one closure of ``kind``, open if ``off``.

    Frame b is then moved and turned by about 0.5; a rod is longer than the distance by ``off`` (m).
    """
    sample = random_mechanism(seed, planar, closed=False)
    rng = np.random.default_rng(seed)
    document = copy.deepcopy(sample.document)
    a = {"link": "link4", "origin": random_origin(rng, planar)}
    b = {"link": ("world", "link0", "link1")[seed % 3], "origin": random_origin(rng, planar)}
    poses, closure = link_poses(document, sample.q), {"name": "loop", "kind": kind}
    if kind == "rod":
        gap = frame_pose(poses, a)[1] - frame_pose(poses, b)[1]
        closure["length"] = float(np.linalg.norm(gap)) + off
    elif not off:
        b["origin"] = origin_in(poses[b["link"]], frame_pose(poses, a))
    document["closures"] = [closure | {"a": a, "b": b}]
    return document, sample.q, sample.v


CASES = [
    (*kind, seed, off)
    for kind, off in product(KINDS, (0.0, 0.2))
    for seed in sampled(range(6), (kind, off))
]


@pytest.mark.parametrize(("kind", "planar", "seed", "off"), CASES)
def test_residual_jacobian_and_bias(kind, planar, seed, off):
    document, q, v = sample_with(kind, planar, seed, off)
    terms = terms_of(document, q, v)

    def residual(change):
        return closure_residual(document, terms.mechanism.integrate(q, change))

    found = terms.evaluation
    here = residual(np.zeros(v.size))
    # A rod's is one of squares over its length.
    lost = 10.0 if kind == "rod" else 1.0
    # Lengths below 2 m and unit axes, ten products of rotations: 1e-14 of length 1.
    assert relative(found.closure_residual, here, scale=1.0) < lost * 1e-14
    assert (np.linalg.norm(here) > 0.02) == (off > 0.0)
    # h = 1e-3: eps/h = 2e-13, truncation h^4/30 per unit of scale.
    jacobian = columns(residual, v.size)
    assert relative(found.closure_jacobian, jacobian) < lost * 1e-10
    # Along q (+) t v the rates stay v: phi'' = W' v.
    # h = 4e-3: rounding eps/h^2 = 1e-11, truncation h^4 |v|^6/90 = 1e-8.
    expected = second_derivative(lambda t: residual(t * v))
    scale = max(float(np.linalg.norm(expected)), float(v @ v))
    assert relative(found.closure_bias, expected, scale) < 1e-6
