# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of mechanism and simulator that no other file asserts where it tests the rest."""

import re

import numpy as np
import pytest

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.inertia import SingularInertiaError
from hapticmech_ros.mechanism.kernels.factor_kernels import SINGULAR
from hapticmech_ros.mechanism.refinement import step_error
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.scene import scene_from_document
from oracles.planar_linkages import five_bar, five_bar_bent
from oracles.running import simulator, with_joints, with_start


@pytest.fixture
def mechanism():
    return Mechanism(scene_from_document(five_bar()))


@pytest.mark.parametrize("integrator", [name for name in SCHEMES if not SCHEMES[name].implicit])
@pytest.mark.parametrize("closed", [False, True])
def test_a_step_that_blows_up_is_no_missing_mass(integrator, closed):
    """Springs of 1e13 N m/rad at 1 ms: the joint that went astray is named, no link is to blame."""
    document = with_start(five_bar(closed=closed), five_bar_bent(1.9, 0.6))
    sim = simulator(with_joints(document, stiffness=1e13, rest=0.0), integrator=integrator)
    state = sim.initial_state()
    with pytest.raises(HapticMechError) as raised:
        sim.run(state, 1000)
    assert not isinstance(raised.value, SingularInertiaError)
    assert "mass" not in str(raised.value)
    assert re.search(r"joint 'joint\d'|closures pin|mechanism state", str(raised.value))


@pytest.mark.parametrize("rate", range(4))
def test_a_step_that_diverged_names_the_joint_that_went_furthest(rate):
    """Where D is positive definite at its start, and not at a stage that it threw far away."""
    sim = simulator(with_start(five_bar(), five_bar_bent(1.9, 0.6)))
    parts, start = sim.stepper.parts, sim.initial_state()
    parts.q0[:] = parts.q[:] = start.q
    parts.q += np.where(np.arange(4) == rate, -1e9, 1e3)
    parts.settings.step = sim.period
    packed = sim.mechanism.closing_terms(start.q, start.active).packed
    error = step_error(sim.mechanism, parts, SINGULAR - 2, packed, start.active)
    assert not isinstance(error, SingularInertiaError)
    assert f"joint 'joint{rate + 1}' moved by -1e+09 rad or m in 0.001 s" in str(error)


def test_checked_states_are_copies(mechanism):
    q = np.zeros(4)
    checked, _ = mechanism.check_state(q, np.zeros(4))
    q[0] = 1.0
    assert checked[0] == 0.0


def test_unknown_point_and_closure(mechanism):
    with pytest.raises(InvalidInputError, match="end1"):
        mechanism.point_index("elbow")
    with pytest.raises(InvalidInputError, match="pin"):
        mechanism.closure_index("hook")
    assert mechanism.point_index() == 0
    assert mechanism.point_index("end2") == 2
    assert mechanism.closure_index("pin") == 0
