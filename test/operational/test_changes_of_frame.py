# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""X changes by congruence with point and axes; mu with none of axes, units and cut joint."""

import numpy as np
import pytest

from oracles.analysed import terms_of
from oracles.differences import relative
from oracles.generator import floats, random_mechanism
from oracles.kinematics import skew
from oracles.loops import loop
from sampling import sampled

SAMPLES = [(seed, planar) for planar in (False, True) for seed in sampled(range(8), planar)]
every_sample = pytest.mark.parametrize(("seed", "planar"), SAMPLES)
# Two evaluations with other roundings each: eps times cond(D) < 1e4.
ROUNDING = 1e-11


@every_sample
def test_change_of_point_is_a_congruence(seed, planar):
    sample = random_mechanism(seed, planar)
    tip = sample.document["operational_points"][0]
    offset = np.array([0.11, -0.07, 0.0 if planar else 0.05])
    xyz = np.asarray(tip["origin"]["xyz"]) + offset
    other = {"name": "other", "link": tip["link"], "origin": {"xyz": floats(xyz)}}
    document = sample.document | {"operational_points": [tip, other]}
    here, there = (terms_of(document, sample.q, point=name) for name in ("tip", "other"))
    poses = [point.pose.translation for point in here.evaluation.points]
    shift = np.eye(6)
    shift[:3, 3:] = -skew(poses[1] - poses[0])
    rows = here.analysis.rows
    shift = shift[np.ix_(rows, rows)]
    assert relative(there.x, shift @ here.x @ shift.T, there.scale) < ROUNDING
    # The link's own inertia moves along: mu is a property of the link, not of the point.
    assert np.abs(there.analysis.spectrum.mu - here.analysis.spectrum.mu).max() < ROUNDING


FOUR_BAR = ("revolute",) * 4
FIVE_BAR = ("revolute",) * 5
# Mobility of a spatial loop: sum of the joints' freedoms less 6.
EIGHT_HINGES = ("revolute",) * 8
MIXED = ("revolute", "spherical", "revolute", "spherical", "revolute")
CASES = [
    pytest.param(FOUR_BAR, True, 1, id="four-bar"),
    pytest.param(FIVE_BAR, True, 2, id="five-bar"),
    pytest.param(EIGHT_HINGES, False, 2, id="eight hinges in space"),
    pytest.param(MIXED, False, 3, id="hinges and balls in space"),
]


def rest(document):
    """Return the configuration in which the loop was authored."""
    parts = [
        (0, 0, 0, 1) if link["joint"]["type"] == "spherical" else (0,) for link in document["links"]
    ]
    return np.concatenate(parts).astype(float)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("kinds", "planar", "mobility"), CASES)
def test_x_does_not_depend_on_the_cut(kinds, planar, mobility, seed):
    held = 1 + seed % (len(kinds) - 1)
    found = []
    for cut in range(len(kinds)):
        document = loop(seed, cut, kinds, planar, held)
        terms = terms_of(document, rest(document))
        assert np.linalg.norm(terms.evaluation.closure_residual) < 1e-14
        assert terms.mechanism.nv - terms.evaluation.space.rank == mobility
        found.append(terms)
    first = found[0]
    for other in found[1:]:
        # D and W differ from cut to cut: eps times their condition numbers, of the serial X.
        assert relative(other.x, first.x, scale=max(first.scale, other.scale)) < 1e-11
        assert other.analysis.rank == first.analysis.rank
        # s is dimensionless and at most 1.
        assert np.abs(other.analysis.spectrum.s - first.analysis.spectrum.s).max() < 1e-11
        a_0 = first.analysis.free_acceleration
        assert relative(other.analysis.free_acceleration, a_0) < 1e-10
