# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gains by name, and from one set to another while it renders, without a bump."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.architecture import GainRamp, blended
from hapticmech_ros.control.tuning import TUNED, tuned
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.controller import Controller


def test_gains_are_found_by_name():
    values = dict.fromkeys(TUNED, 0.5)
    found = tuned(Controller(), values)
    assert all(getattr(getattr(found, part), field) == 0.5 for part, field in TUNED.values())
    assert tuned(Controller(), dict.fromkeys(TUNED, -1.0)) == Controller()


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("c2", 1.5, "c2.*less than or equal to 1"),
        ("c6", -2.0, "c6.*greater than -1"),
        ("constraint_stiffness", -3.0, "constraint_stiffness.*greater than or equal to 0"),
        ("constraint_feedforward", float("nan"), "constraint_feedforward.*finite"),
        ("stiffness", 1.0, "constraint_stiffness.*got 'stiffness'"),
    ],
)
def test_gains_that_are_none_are_refused_by_name(name, value, words):
    with pytest.raises(InvalidInputError, match=words):
        tuned(Controller(), {name: value})


def test_gains_pass_in_a_straight_line():
    old = Controller()
    new = tuned(old, {"constraint_stiffness": 1000.0, "c1": 0.0})
    passage = GainRamp(1.0, old, new)
    for time, share in ((0.5, 0.0), (1.0, 0.0), (1.15, 0.5)):
        gains, arrived = passage.at(time)
        assert not arrived
        assert gains.joint_constraint.stiffness == pytest.approx(2000.0 - 1000.0 * share)
        assert gains.position_channel.to_mechanism == pytest.approx(1.0 - share)
        assert gains.joint_constraint.damping == old.joint_constraint.damping
    assert passage.at(1.3 + 1e-12) == (new, True)
    at_once = new.model_copy(update={"gain_ramp": 0.0})
    assert GainRamp(1.0, old, at_once).at(1.0) == (at_once, True)


def test_what_is_no_number_is_new():
    joint = Controller().joint_constraint
    other = joint.model_copy(update={"local": False, "stiffness": 0.0})
    assert blended(joint, other, 0.25).local is False
    assert blended(joint, other, 0.25).stiffness == 1500.0


def test_a_session_takes_other_gains_without_a_bump():
    """Pushed against its joints: a spring half as stiff gives way slowly, from the same force."""
    scene = load_scene("five_bar")
    sessions = [Session(scene, control=ControlArchitecture(scene)) for _ in range(2)]
    for session in sessions:
        session.run(1000)
    names = {"constraint_stiffness": 700.0, "constraint_damping": 20.0, "position_stiffness": 50.0}
    tuned_one, left = sessions
    tuned_one.tune(tuned(scene.controller, names))
    found, other = (session.run(600)["device_command"] for session in sessions)
    # In the first moment nothing has changed.
    assert np.array_equal(found[0], other[0])
    assert tuned_one._control.gains == tuned(scene.controller, names)
    # 0.5 N are held by a spring that loses 65 % over 300 samples.
    assert np.abs(np.diff(found, axis=0)).max() < 0.01
    assert tuned_one.energies.injected < left.energies.injected
