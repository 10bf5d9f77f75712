# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Renderings written in place are those that are packed from the objects."""

import numpy as np
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.control import PointMeasurement
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import PastRates
from hapticmech_ros.wire.layouts import (
    OPERATIONAL_MODEL_FIELDS,
    OperationalModelMessage,
    pack_operational_model,
)
from hapticmech_ros.wire.readings import OperationalModelWriter
from hapticmech_ros.wire.state import WireState


def states(mechanism):
    """Return states of a mechanism, one after another, all different."""
    q, _ = consistent_initial_state(mechanism)
    points = len(mechanism.point_names)
    rng = np.random.default_rng(0)
    for tick in range(3):
        yield WireState(
            1_500_000_000 + tick,
            mechanism.initially_active,
            q,
            rng.normal(size=mechanism.nv),
            rng.normal(size=(points, 6)),
            flat_grasps(mechanism.scene),
            (tick % 2 == 0,) * points,
        )
        q = mechanism.integrate(q, 1e-3 * rng.normal(size=mechanism.nv))


@pytest.mark.parametrize("name", shipped_scenes())
def test_both_ways_write_the_same(name):
    mechanism = Mechanism(load_scene(name))
    analyser = Analyser(mechanism)
    writer = OperationalModelWriter(analyser, PastRates(3, 1_000_000, mechanism.nv))
    for count, state in enumerate(states(mechanism)):
        writer.evaluate(state)
        writer.count(count)
        terms = mechanism.evaluate(state.q, state.v, state.active)
        found, point = analyser.analyse(terms), terms.points[analyser.index]
        measured = PointMeasurement(point.pose, point.twist, state.contacts[analyser.index])
        received, grasp = state.commanded[analyser.index], state.grasps[analyser.index]
        s = found.spectrum.s
        expected = pack_operational_model(
            OperationalModelMessage(
                state.stamp_ns, count, s, operational_model_of(found), measured, received, grasp
            )
        )
        assert (writer.s == s).all()
        # The quaternion by a kernel and by Eigen, which rounds it once less or more.
        turn = OPERATIONAL_MODEL_FIELDS.slice("quaternion")
        assert np.abs(writer.values[turn] - expected[turn]).max() < 1e-15
        writer.values[turn] = expected[turn]
        assert writer.values.tobytes() == expected.tobytes()
