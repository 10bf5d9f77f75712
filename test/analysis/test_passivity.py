# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Trials of passivity: what is counted, what is refused, and what they find."""

import json

import pytest
from typer.testing import CliRunner

from hapticmech_ros.analysis.passivity import STIFFNESS, Trial, passivity, scene_of, trials, tried
from hapticmech_ros.cli import app
from hapticmech_ros.errors import InvalidInputError


def test_a_trial_has_the_stiffness_the_connection_and_the_device_that_are_asked_for():
    scene = scene_of(Trial("door", "premium_1_5_6dof", "grips", 0.03, local=False, seconds=9.0))
    joint = scene.controller.joint_constraint
    assert (joint.stiffness, joint.local) == (STIFFNESS, False)
    link = scene.connection
    assert (link.delay, link.jitter, link.loss) == (0.03, 0.2, 0.05)
    assert scene.device.preset == "premium_1_5_6dof"
    assert scene.hand.release_at == (2.0, 6.0)
    assert scene.hand.waypoints[-1].time == pytest.approx(9.0, abs=0.7)


def test_a_hand_does_not_spin_a_free_handle_up():
    assert scene_of(Trial("five_bar")).hand.torque != (0.0, 0.0, 0.0)
    assert scene_of(Trial("five_bar", "touch")).hand.torque == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("hand", ["grips", "tremor"])
def test_with_control_the_hand_gets_out_what_it_put_in(hand):
    found = tried(Trial("five_bar", "scene", hand, 0.05, local=False, seconds=3.5))
    assert found.passive
    assert found.lowest >= -1e-3
    assert found.changed > 0.1
    assert found.most_force <= 20.0


def test_without_control_that_is_seen():
    found = tried(Trial("five_bar", "scene", "scene", 0.05, local=False, control=False, seconds=2))
    assert not found.passive
    assert found.lowest < -0.1
    assert found.changed == 0.0


def test_a_hand_that_there_is_none_of_is_refused():
    with pytest.raises(InvalidInputError, match=r"hand: must be one of scene, relaxed.*nobody"):
        scene_of(Trial("five_bar", hand="nobody"))


def test_all_combinations_are_tried_and_told(tmp_path):
    asked = trials(["two_link"], ["scene"], ["scene"], [0.0, 0.01], 0.6)
    assert [(one.delay, one.local) for one in asked] == [
        (0.0, True),
        (0.0, False),
        (0.01, True),
        (0.01, False),
    ]
    told = []
    results = passivity(asked, told.append)
    results.write(tmp_path)
    assert [one.trial for one in results.found] == asked
    assert len(told) == 4
    rows = json.loads((tmp_path / "passivity.json").read_text(encoding="utf-8"))
    assert [row["passive"] for row in rows] == [one.passive for one in results.found]
    (sheet,) = results.sheets()
    assert len(sheet.rows) == 4


def test_what_is_no_delay_is_refused():
    found = CliRunner().invoke(app, ["feel", "passivity", "two_link", "--delays", "soon"])
    assert isinstance(found.exception, InvalidInputError)
    assert "--delays" in str(found.exception)
