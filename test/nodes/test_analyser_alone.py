# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The analyser's topics for people: the count, the inverse inertia, and wrenches not felt."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.reliability.fake_graph import FakeGraph
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.nodes.nullspace_analyser import NullspaceAnalyser
from hapticmech_ros.operational import Analyser
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.state import StateLayout, WireState
from nodes.stand_ins import heard


@pytest.mark.parametrize("closed", [True, False], ids=["loop", "open_chain"])
def test_people_are_told_what_the_core_finds(closed):
    graph = FakeGraph("five_bar", actors=[NullspaceAnalyser])
    mechanism, none = graph.actor("nullspace_analyser").mechanism, np.zeros((1, 6))
    q, _ = consistent_initial_state(mechanism)
    v = np.array([0.3, -0.2, 0.1, 0.4])
    expected = Analyser(mechanism).analyse(mechanism.evaluate(q, v, (closed,)))
    names = "constraint_count", "inverse_inertia", "constraint_wrenches"
    counts, matrices, wrenches = heard(graph, *(f"/analysis/handle/{name}" for name in names))
    layout = StateLayout(mechanism)
    for _ in range(100):
        graph.run(1e-3)
        told = WireState(graph.now_ns, (closed,), q, v, none, flat_grasps(mechanism.scene), (True,))
        graph.put("/mechanism/state", FlatArray(layout.fields).encode(layout.pack(told)))
    assert counts[-1].data == 1
    dims = matrices[-1].layout.dim
    assert [(d.label, d.size, d.stride) for d in dims] == [("row", 6, 36), ("column", 6, 6)]
    # The same code on the same bits: equal, not merely close.
    assert np.array_equal(np.reshape(matrices[-1].data, (6, 6)), expected.inverse_inertia)
    column = np.array(wrenches[-1].data)
    # The published direction is in the null space: X n is rounding, seen against |X| |n|.
    scale = np.abs(expected.inverse_inertia) @ np.abs(column)
    assert np.abs(expected.inverse_inertia @ column).max() < 1e-13 * scale.max()
