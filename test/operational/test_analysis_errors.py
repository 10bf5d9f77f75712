# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One test per error that the analysis promises, and the shape of what it returns."""

import numpy as np
import pytest

from hapticmech_ros import Mechanism, analyse
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import scene_from_document
from oracles.analysed import terms_of
from oracles.differences import relative
from oracles.planar_linkages import five_bar, five_bar_bent


@pytest.fixture
def mechanism():
    return Mechanism(scene_from_document(five_bar()))


def test_unknown_point(mechanism):
    with pytest.raises(InvalidInputError, match="end2") as caught:
        analyse(mechanism, five_bar_bent(1.9, 0.6), "elbow")
    assert caught.value.value == "elbow"
    with pytest.raises(InvalidInputError):
        Analyser(mechanism, "elbow")


@pytest.mark.parametrize(
    ("what", "value"),
    [
        *(("q", q) for q in (np.zeros(3), np.zeros(5), np.zeros((4, 1)))),
        *(("q", q) for q in ([0, 0, 0, np.nan], [0, np.inf, 0, 0])),
        *(("v", v) for v in (np.zeros(3), [0, 0, np.nan, 0])),
    ],
)
def test_a_state_of_wrong_size_or_not_finite(mechanism, what, value):
    with pytest.raises(InvalidInputError) as caught:
        analyse(mechanism, **{"q": five_bar_bent(1.9, 0.6), what: value})
    assert caught.value.what == what


def test_planar_scenes_have_three_rows(mechanism):
    found = analyse(mechanism, five_bar_bent(1.9, 0.6), "end2")
    assert found.rows.tolist() == [0, 1, 5]
    assert found.spectrum.s.shape == (3,)
    out_of_plane = [2, 3, 4]
    matrices = (found.inverse_inertia, found.constraint_projector, found.wrench_projector)
    assert all(not m[out_of_plane].any() and not m[:, out_of_plane].any() for m in matrices)
    assert not found.constraint_wrenches[out_of_plane].any()


def test_opened_closures_give_the_serial_x(mechanism):
    q = five_bar_bent(1.9, 0.6)
    opened = analyse(mechanism, q, "end2", active=(False,))
    serial = terms_of(five_bar(closed=False), q, point="end2").analysis
    assert relative(opened.inverse_inertia, serial.inverse_inertia) < 1e-14  # same arithmetic


def test_a_metric_of_its_own_replaces_the_links(mechanism):
    document = five_bar()
    metric = {"mass": 2.0, "length": 0.1}
    point = document["operational_points"][2] | {"metric": metric}
    found = terms_of(document | {"operational_points": [point]}, five_bar_bent(1.9, 0.6))
    x = found.x
    g = np.sqrt(np.array([2.0, 2.0, 2.0 * 0.1**2]))
    expected = np.sort(np.linalg.eigvalsh(g[:, None] * x * g))[::-1]
    assert np.abs(found.analysis.spectrum.mu - expected).max() < 1e-13 * expected[0]
