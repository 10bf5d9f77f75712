# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ranks of X on the paper's five-bar, decided on S."""

import numpy as np
import pytest

from oracles.analysed import terms_of
from oracles.planar_linkages import five_bar, five_bar_bent

# Angle of joint 4, rad: zero is links 3 and 4 in line, where X at the end of link 2 loses a rank.
BENDS = [1e-4, 1e-5, 1e-6, 1e-7, 1e-8]


def at(bend, point="end2"):
    return terms_of(five_bar(), five_bar_bent(1.9, bend), point=point)


@pytest.mark.parametrize("bend", BENDS)
def test_rank_on_s_sees_a_small_bend(bend):
    terms = at(bend)
    assert terms.analysis.rank == 2
    assert terms.analysis.constraint_wrenches.shape == (6, 1)
    # The same in exact arithmetic has rank 2; at the position itself, 1.
    assert at(0.0).analysis.rank == 1


def test_s_is_linear_in_the_distance_to_the_singular_position():
    s = [at(bend).analysis.spectrum.s[1] for bend in BENDS]
    # Curvature of order bend at 1e-4; rounding eps/1e-8 of the smallest.
    for smaller, larger in zip(s[1:], s, strict=False):
        assert abs(larger / smaller - 10.0) < 1e-2


def test_the_taut_wrench_is_along_links_3_and_4():
    terms = at(0.0)
    wrenches = terms.analysis.constraint_wrenches[terms.analysis.rows]
    pivot, end = np.array([0.09, 0.0]), terms.evaluation.points[2].pose.translation[:2]
    along = np.append((pivot - end) / np.linalg.norm(pivot - end), 0.0)
    # Along the line, and along link 2 for the joint between links 1 and 2: both in ker X.
    coefficients = np.linalg.lstsq(wrenches, along, rcond=None)[0]
    assert (
        np.linalg.norm(wrenches @ coefficients - along) < 1e-12
    )  # unit vector, rounding of an SVD


TABLE = {1: (1, 1, 1), 2: (2, 2, 1), 3: (3, 2, 2), 4: (3, 1, 1)}
FIRST_ANGLES = [1.6, 1.9, 2.1]


@pytest.mark.parametrize("first", FIRST_ANGLES)
@pytest.mark.parametrize("where", ["end", "middle"])
@pytest.mark.parametrize("link", TABLE)
def test_rank(link, where, first):
    serial, generic, in_line = TABLE[link]
    point = f"{where}{link}"
    bent, taut = five_bar_bent(first, 0.6), five_bar_bent(first, 0.0)
    assert terms_of(five_bar(closed=False), bent, point=point).analysis.rank == serial
    assert terms_of(five_bar(), bent, point=point).analysis.rank == generic
    assert terms_of(five_bar(), taut, point=point).analysis.rank == in_line
