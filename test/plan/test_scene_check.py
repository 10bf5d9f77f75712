# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What ``scene check`` says of scenes, and what it warns of."""

import json
from pathlib import Path

import numpy as np
import pytest

from commands import ran
from hapticmech_ros import load_scene
from hapticmech_ros.plan.scene_plan import check_scene
from hapticmech_ros.scene import document_of, scene_from_document

FIVE_BAR = document_of(load_scene("five_bar"))


def changed(**parts):
    return scene_from_document({**FIVE_BAR, **parts})


def with_joint(name, **parts):
    links = [dict(link) for link in FIVE_BAR["links"]]
    for link in links:
        if link["joint"]["name"] == name:
            link["joint"] = {**link["joint"], **parts}
    return links


def test_the_five_bar():
    found = check_scene(load_scene("five_bar"))
    assert (found.links, found.joints, found.nv, found.rank, found.mobility) == (4, 4, 4, 2, 2)
    assert found.mass_kg == pytest.approx(3.5)
    assert found.closures == (("ground_pin", "planar_pin", 2, 2),)
    (point,) = found.points
    assert (point.name, point.link, point.rank, point.count) == ("handle", "link2", 2, 1)
    assert found.warnings == ()


@pytest.mark.parametrize("name", ["five_bar", "four_bar_closing", "spatial_arm", "two_link"])
def test_masses_are_those_of_the_inverse_inertia(name):
    scene = load_scene(name)
    (point,) = check_scene(scene).points
    least, largest = point.mass_kg
    assert 0.0 < least <= largest
    assert np.isfinite(largest)


def test_a_start_that_was_not_closed_is_told():
    (warning,) = check_scene(changed(initial_state={"q": {"joint1": 1.9}})).warnings
    assert "loops are open at the start" in warning


@pytest.mark.parametrize("scripted", [False, True])
def test_a_hand_that_is_stronger_than_the_device_is_told(tmp_path, scripted):
    hand = {"kind": "constant_wrench", "force": [0.0, 30.0, 0.0]}
    if scripted:
        file = tmp_path / "push.csv"
        file.write_text("time,fx,fy,fz,tx,ty,tz\n0,0,0,0,0,0,0\n1,0,-30,0,0,0,0\n")
        hand = {"kind": "scripted", "file": str(file)}
    said = [one for one in check_scene(changed(hand=hand)).warnings if "force_limit" in one]
    assert len(said) == 1
    assert "the hand pushes with 30 N, but device.force_limit is 20 N" in said[0]
    turning = {"kind": "constant_wrench", "torque": [0.0, 0.0, 1.5]}
    said = [one for one in check_scene(changed(hand=turning)).warnings if "torque_limit" in one]
    assert len(said) == 1
    weak = {"kind": "constant_wrench", "force": [0.0, 19.9, 0.0]}
    assert not any("limit is" in one for one in check_scene(changed(hand=weak)).warnings)


def test_a_joint_beyond_its_stops_is_told():
    stops = {"lower": -1.0, "upper": 1.0, "stiffness": 1.0}
    (warning,) = check_scene(changed(links=with_joint("joint1", limits=stops))).warnings
    assert warning == "joint joint1 starts at 1.9, outside its stops at -1 and 1"


@pytest.mark.parametrize("integrator", ["rk4", "linearly_implicit"])
def test_a_spring_that_is_too_stiff_is_told(integrator):
    scene = changed(
        links=with_joint("joint2", stiffness=1e5, rest=-1.2),
        simulation={"period": 0.001, "integrator": integrator},
    )
    found = check_scene(scene)
    stiff = found.warnings
    assert len(stiff) == (integrator == "rk4")
    assert all("joint joint2: k T² / m" in warning for warning in stiff)
    # Divided, nearly every step is accurate, but for errors of 1e-19 J that nobody feels.
    assert found.accuracy.inaccurate == 0
    assert (found.accuracy.refined > 1000) == (integrator == "rk4")


def test_steps_that_are_inaccurate_are_told():
    accuracy = {"tolerance": 1e-9, "max_substeps": 1}
    coarse = {"period": 0.001, "integrator": "rk2", "accuracy": accuracy}
    found = check_scene(changed(simulation=coarse))
    (warning,) = found.warnings
    steps = found.accuracy.inaccurate
    assert steps > 0
    assert warning == (
        f"{steps} steps of the scene's experiment exceed simulation.accuracy.tolerance:"
        " shorten the period"
    )


def test_redundant_closures_are_told():
    twice = [*FIVE_BAR["closures"], {**FIVE_BAR["closures"][0], "name": "again"}]
    found = check_scene(changed(closures=twice))
    assert [one[3] for one in found.closures] == [2, 0]
    assert found.warnings == ("redundant closures: again",)


def test_the_command_prints_the_same():
    shown = ran("scene", "check", "five_bar")
    assert "degrees of freedom   2" in shown
    assert "accuracy of steps" in shown
    told = json.loads(ran("scene", "check", "five_bar", "--json"))
    assert (told["mobility"], told["notes"]) == (2, [])
    assert told["accuracy"]["position_m"] < 1e-12


def test_steps_in_which_nothing_moves_are_not_called_accurate():
    shown = ran("scene", "check", Path(__file__).parents[2] / "examples" / "pantograph.urdf")
    assert "not tested: nothing moves" in " ".join(shown.split())
    assert "energy of steps" not in shown


@pytest.mark.parametrize("name", ["five_bar", "spatial_arm"])
def test_the_list_has_each_scene_and_its_purpose(name):
    # Long lines are folded to the terminal's width.
    listed = " ".join(ran("scene", "list").split())
    assert f"{name} {load_scene(name).description}" in listed
