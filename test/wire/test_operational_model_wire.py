# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is written in place is what is found object by object."""

import numpy as np
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.control import PointMeasurement
from hapticmech_ros.control.measurements import flat_operational_model, operational_model_of
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.mechanism.projection import consistent_initial_state
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import PastRates
from hapticmech_ros.wire.layouts import OperationalModelWriter
from hapticmech_ros.wire.messages import OperationalModelMessage
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
        writer.message.count = count
        terms = mechanism.evaluate(state.q, state.v, state.active)
        found, point = analyser.analyse(terms), terms.points[analyser.index]
        measured = PointMeasurement(point.pose, point.twist, state.contacts[analyser.index])
        received, grasp = state.commanded[analyser.index], state.grasps[analyser.index]
        s, model = found.spectrum.s, flat_operational_model(operational_model_of(found), measured)
        expected = OperationalModelMessage.of(
            state.stamp_ns, count=count, directions=s.size, operational_model=model, grasp=grasp
        )
        expected.s[:], expected.commanded = s, received
        # The quaternion by a kernel and by Eigen, which rounds it once less or more.
        written, turn = writer.message.values, OperationalModelMessage.layout.slice("quaternion")
        assert np.abs(written[turn] - expected.values[turn]).max() < 1e-15
        written[turn] = expected.values[turn]
        assert written.tobytes() == expected.values.tobytes()
