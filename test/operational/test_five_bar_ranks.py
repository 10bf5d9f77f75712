# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ranks of X on every link of the paper's five-bar: serial, closed, and with links 3-4 in line."""

import numpy as np
import pytest

from oracles.analysed import terms_of
from oracles.planar_linkages import five_bar, five_bar_bent

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


@pytest.mark.parametrize("first", FIRST_ANGLES)
def test_the_triangle_closes_the_loop(first):
    for bend in (0.0, 0.6, -0.6):
        terms = terms_of(five_bar(), five_bar_bent(first, bend))
        # Metres, of a mechanism of 0.2 m: a few roundings.
        assert np.linalg.norm(terms.evaluation.closure_residual) < 1e-15
