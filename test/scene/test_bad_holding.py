# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rules of device and hand, and of the files that these name."""

import os

import pytest

from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.hand import FILE_SIZE_LIMIT
from scene.broken import problems_of

HEADING = "time,fx,fy,fz,tx,ty,tz\n"
ARM = {"kind": "arm", "waypoints": [{"time": 0.5, "xyz": [0.01, 0, 0]}]}
PUSH = {"kind": "constant_wrench"}


# key path | device or hand | words of the rule
DEVICES = [
    ("device.preset", {"preset": "omega_9"}, "unknown device: must be one of"),
    ("device.preset", {"preset": 3.0}, "valid string"),
    ("device.coulomb_friction", {"coulomb_friction": -0.1}, "greater than or equal to 0"),
    ("device.actuator_bandwidth", {"actuator_bandwidth": -1.0}, "greater than or equal to 0"),
    ("device.actuated", {"actuated": "rotation"}, "'all' or 'translation'"),
    ("device.force_sensor", {"force_sensor": "guessed"}, "'measured', 'estimated' or 'absent'"),
    ("device.observer_bandwidth", {"observer_bandwidth": 0.0}, "greater than 0"),
    ("device.workspace.angle", {"workspace": {"angle": 3.2}}, "less than or equal to 3"),
    ("device.workspace.reach", {"workspace": {"reach": 3.2}}, "unknown key"),
    ("device.compensation.friction", {"compensation": {"friction": 1.0}}, "less than 1"),
    ("device.compensation.gravity", {"compensation": {"gravity": 1}}, "valid boolean"),
    ("device.compensation.dead_zone", {"compensation": {"dead_zone": 0.0}}, "greater than 0"),
    ("device.gravity_load[2]", {"gravity_load": [0.0, 0.0, float("nan")]}, "finite"),
]


HANDS = [
    ("hand.mass", {**ARM, "mass": -1.0}, "greater than or equal to 0"),
    ("hand.impedance", {**ARM, "impedance": "nervous"}, "'relaxed' or 'firm'"),
    ("hand.waypoints", {"kind": "arm"}, "required key is missing"),
    ("hand.damping", {**ARM, "damping": 5000.0}, "must not exceed its mass"),
    ("hand.angular_damping", {**ARM, "angular_damping": 50.0}, "must not exceed its inertia"),
    ("hand.waypoints[0]", {**ARM, "waypoints": [{"time": 0.1, "xyz": [0, 0, 1.0]}]}, "x-y plane"),
    ("hand.tremor.frequency", {**PUSH, "tremor": {"frequency": 0.0}}, "greater than 0"),
    (
        "hand.tremor.xyz",
        {**PUSH, "tremor": {"frequency": 9.0, "xyz": [1e-3, 0.0, 0.0]}},
        "only a hand with waypoints",
    ),
    ("hand.tremor", {**PUSH, "tremor": {"frequency": 9.0, "force": [0, 0, 1.0]}}, "x-y plane"),
    ("hand.grab_at", {**PUSH, "grab_at": [0.1, 0.2]}, "must alternate"),
    ("hand.release_at", {**PUSH, "release_at": [0.3, 0.1]}, "must alternate"),
    ("hand.release_at", {**PUSH, "release_at": [0.1], "grab_at": [0.1]}, "must alternate"),
    ("hand.release_at[0]", {**PUSH, "release_at": [-0.1]}, "greater than or equal to 0"),
    ("hand.file", {"kind": "scripted", "file": ""}, "at least 1 character"),
    ("hand.file", {"kind": "scripted", "file": "nowhere.csv"}, "cannot be read"),
]


@pytest.mark.parametrize(("path", "said", "rule"), DEVICES + HANDS)
def test_a_bad_device_or_hand_is_named(planar, path, said, rule):
    (found,) = problems_of({**planar, path.partition(".")[0]: said})
    assert found.key_path == path
    assert rule in found.rule


def test_an_arm_bears_more_damping_than_the_device_alone(planar):
    hand = {**ARM, "mass": 1.0, "damping": 4000.0, "angular_inertia": 0.1}
    scene = scene_from_document({**planar, "hand": hand})
    assert scene.hand.damping == 4000.0


# file | words of the rule, which name the line
SCRIPTS = [
    ("", "line 1: the heading must be time,fx"),
    ("t,fx,fy,fz,tx,ty,tz\n0,0,0,0,0,0,0\n", "line 1: the heading must be time,fx"),
    (HEADING, "at least one row"),
    (HEADING + "0,1,2,3\n", "line 2: must have 7 columns"),
    (HEADING + "0,0,0,0,0,0,0\n1,0,zero,0,0,0,0\n", "line 3, fy: must be a finite number"),
    (HEADING + "0,nan,0,0,0,0,0\n", "line 2, fx: must be a finite number"),
    (HEADING + "0,2e30,0,0,0,0,0\n", "line 2, fx: must be a finite number, not above 1e+30"),
    (HEADING + "0,0,0,0,0,0,0\n\n0,0,0,0,0,0,0\n", "line 4: times must be 0 or more, and increase"),
    (HEADING + "-1,0,0,0,0,0,0\n", "line 2: times must be 0 or more"),
    (HEADING + "0,0,0,1,0,0,0\n", "fz, tx and ty must be 0"),
]


@pytest.mark.parametrize(("text", "rule"), SCRIPTS)
def test_a_bad_script_is_named_with_its_line(planar, tmp_path, text, rule):
    file = tmp_path / "push.csv"
    file.write_text(text)
    (found,) = problems_of({**planar, "hand": {"kind": "scripted", "file": str(file)}})
    assert found.key_path == "hand.file"
    assert rule in found.rule


def test_a_script_too_large_or_not_text_is_refused(planar, tmp_path):
    file = tmp_path / "push.csv"
    document = {**planar, "hand": {"kind": "scripted", "file": str(file)}}
    file.write_bytes(b"\xff\xfe\x00" * 9)
    assert "cannot be read" in problems_of(document)[0].rule
    with file.open("wb") as stream:
        stream.truncate(FILE_SIZE_LIMIT + 1)
    assert "bytes" in problems_of(document)[0].rule


def test_a_script_that_is_no_regular_file_is_not_waited_for(planar, tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    for file in (tmp_path / "pipe.csv", "/dev/zero", tmp_path):
        (found,) = problems_of({**planar, "hand": {"kind": "scripted", "file": str(file)}})
        assert "must be a regular file" in found.rule


def test_a_script_stands_beside_its_scene(planar, tmp_path, monkeypatch):
    from ruamel.yaml import YAML

    folder = tmp_path / "scenes"
    folder.mkdir()
    (folder / "push.csv").write_text(HEADING + "0,1,0,0,0,0,0\n")
    planar["hand"] = {"kind": "scripted", "file": "push.csv"}
    with (folder / "own.yaml").open("w") as stream:
        YAML(typ="safe", pure=True).dump(planar, stream)
    monkeypatch.chdir(tmp_path)
    scene = load_scene("scenes/own.yaml")
    assert scene.hand.file == str(folder / "push.csv")
    # What is written out again is the same scene, wherever it is read.
    assert scene_from_document(document_of(scene)) == scene
