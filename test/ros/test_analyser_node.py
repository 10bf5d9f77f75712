# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The analyser alone: what it says of a state is what the core says, and nothing kills it."""

import time

import numpy as np
import pytest
from std_msgs.msg import Float64MultiArray, UInt8

from hapticmech_ros import load_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.operational import Analyser
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.messages import OperationalModelMessage
from hapticmech_ros.wire.state import StateLayout, WireState
from ros.harness import RATE, Peer, Statuses, refuses, running

# Of the loop: 2 d + 1 periods, d being 1.
COMPENSATED_DELAY = 3.0 / RATE
# s, longer than any delay from which rates of the past are taken.
APART_S = 20.0 / RATE
CONTACT = np.array([[0.1, -0.2, 0.0, 0.0, 0.0, 0.003]])


def _state(
    peer: Peer,
    q: np.ndarray,
    v: np.ndarray,
    closed: bool = True,
    late_s: float = 0.0,
    grasps: np.ndarray | None = None,
) -> Float64MultiArray:
    now = peer.node.get_clock().now().nanoseconds - round(late_s * 1e9)
    mechanism = Mechanism(load_scene("five_bar"))
    held = flat_grasps(mechanism.scene) if grasps is None else grasps
    state = WireState(now, (closed,), q, v, CONTACT, held, (True,))
    return Float64MultiArray(data=StateLayout(mechanism).pack(state).tolist())


@pytest.mark.parametrize("closed", [True, False], ids=["loop", "open_chain"])
def test_rendering_equals_the_core_analysis(domain: int, peer: Peer, closed: bool) -> None:
    mechanism = Mechanism(load_scene("five_bar"))
    q, _ = consistent_initial_state(mechanism)
    v = np.array([0.3, -0.2, 0.1, 0.4])
    terms = mechanism.evaluate(q, v, (closed,))
    analyser = Analyser(mechanism, compensated_delay=COMPENSATED_DELAY)
    expected = analyser.analyse(terms)
    compensated = analyser.compensated(terms, expected)
    models = peer.listen("analysis/handle/operational_model", Float64MultiArray)
    counts = peer.listen("analysis/handle/constraint_count", UInt8)
    matrices = peer.listen("analysis/handle/inverse_inertia", Float64MultiArray)
    wrenches = peer.listen("analysis/handle/constraint_wrenches", Float64MultiArray)
    with running("nullspace_analyser", domain, view_rate=1000.0):
        states = peer.publisher("mechanism/state", Float64MultiArray)
        sent = [0.0]

        def publish() -> None:
            # So far apart that the compensation knows nothing of the rates of the one before: any
            # answer may be the first that is received here.
            if time.monotonic() > sent[-1] + APART_S:
                states.publish(_state(peer, q, v, closed))
                sent.append(time.monotonic())

        peer.until(
            lambda: models and counts and matrices and wrenches, "an analysis", doing=publish
        )
    found = read(OperationalModelMessage, models[0].data)
    # The same code on the same bits, in another process: equal, not merely close.
    assert np.array_equal(found.operational_model.inverse_inertia, compensated.inverse_inertia)
    assert np.array_equal(
        found.operational_model.constraint_projector, expected.constraint_projector
    )
    assert np.array_equal(found.operational_model.wrench_projector, expected.wrench_projector)
    assert np.array_equal(found.operational_model.free_acceleration, compensated.free_acceleration)
    assert np.array_equal(found.s, expected.spectrum.s)
    assert np.array_equal(found.operational_model.contact, CONTACT[0])
    assert counts[-1].data == found.count == 1
    dims = matrices[-1].layout.dim
    assert [(d.label, d.size, d.stride) for d in dims] == [("row", 6, 36), ("column", 6, 6)]
    assert np.array_equal(np.reshape(matrices[-1].data, (6, 6)), expected.inverse_inertia)
    column = np.array(wrenches[-1].data)
    pull = expected.inverse_inertia @ column
    # The published direction is in the null space: X n is rounding, seen against |X| |n|.
    scale = np.abs(expected.inverse_inertia) @ np.abs(column)
    assert np.abs(pull).max() < 1e-13 * scale.max()


def test_bad_states_are_refused(domain: int, peer: Peer, statuses: Statuses) -> None:
    models = peer.listen("analysis/handle/operational_model", Float64MultiArray)
    zero = np.zeros(4)
    with running("nullspace_analyser", domain, diagnostics_period=0.02) as process:
        states = peer.publisher("mechanism/state", Float64MultiArray)
        for bad in (
            _state(peer, np.array([np.nan, 0.0, 0.0, 0.0]), zero),
            _state(peer, zero, np.array([0.0, np.inf, 0.0, 0.0])),
            Float64MultiArray(data=_state(peer, zero, zero).data[:-1]),
            _state(peer, zero, zero, closed=0.5),
            _state(peer, zero, zero, late_s=3.0),
            Float64MultiArray(),
        ):
            refuses(peer, statuses, "nullspace_analyser", states, bad)
        assert process.poll() is None
    assert not models
