# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Keys of a scene that are set from outside its file."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from commands import ran
from hapticmech_ros import load_scene
from hapticmech_ros.analysis import impedance
from hapticmech_ros.cli.console import with_changes as changed_copies
from hapticmech_ros.errors import InvalidInputError, SceneError
from hapticmech_ros.scene import document_of
from hapticmech_ros.scene.validation import with_changes

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
LINK = {"name": "a", "joint": {"damping": 0.1}}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("gravity=[0, 0, -1]", {"gravity": [0, 0, -1]}),
        (" gravity = 5e-3 ", {"gravity": 0.005}),
        ("a.b.c=text", {"a": {"b": {"c": "text"}}}),
        ("links.a.joint.damping=0.5", {"links": [{"name": "a", "joint": {"damping": 0.5}}]}),
        ("links[0].joint.axis[1]=2", {"links": [{**LINK, "joint": {"axis": [0, 2, 1]}}]}),
        ("hand={kind: x, force: [1, 2, 3]}", {"hand": {"kind": "x", "force": [1, 2, 3]}}),
        ("label=a=b", {"label": "a=b"}),
        ("closures=", {"closures": None}),
        ("", {}),
    ],
)
def test_a_key_is_set_and_the_document_stays(change, expected):
    joint = {"axis": [0, 0, 1]} if "axis" in change else LINK["joint"]
    before = {"format": "f", "links": [{**LINK, "joint": joint}]}
    document = yaml.safe_load(yaml.safe_dump(before))
    found = with_changes(document, [change], "scene")
    assert found == {**before, **expected}
    assert document == before


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ("gravity", "must be key=value"),
        ("=3", "must be key=value"),
        ("links.b.joint=1", r"must be one of a, or a place in brackets"),
        ("links[3].joint=1", "must be a place from 0 to 0"),
        ("format.x=1", "leads nowhere"),
        ("links.a.name.x=1", "leads nowhere"),
        ("links[0][1]=1", "leads nowhere"),
        ("a..b=1", "names with dots between them"),
        (".a=1", "names with dots between them"),
        ("a.=1", "names with dots between them"),
        ("a[x]=1", "names with dots between them"),
        ("a=[1", "a: "),
    ],
)
def test_what_leads_nowhere_is_refused(change, rule):
    with pytest.raises(SceneError, match=rule) as caught:
        with_changes({"format": "f", "links": [LINK]}, [change], "scene.yaml")
    assert str(caught.value).startswith("scene.yaml: ")


def test_a_scene_has_what_was_set_and_the_rules_hold():
    changes = ["links.link1.inertial.mass=0.2", "controller.joint_constraint.stiffness=1500"]
    found = load_scene("five_bar", changes=changes)
    plain = load_scene("five_bar")
    assert found.links[0].inertial.mass == 0.2
    assert found.controller.joint_constraint.stiffness == 1500.0
    # By the rule for gains, from the stiffness that was set.
    damping = found.controller.joint_constraint.damping
    assert damping != plain.controller.joint_constraint.damping
    with pytest.raises(SceneError, match=r"links\[0\].inertial.mass"):
        load_scene("five_bar", changes=["links.link1.inertial.mass=-1"])
    with pytest.raises(SceneError, match="unknown key"):
        load_scene("five_bar", changes=["hand.forse=[1, 0, 0]"])


def test_a_copy_is_the_scene_with_what_was_set(tmp_path):
    path = tmp_path / "mine.yaml"
    ran("scene", "copy", "five_bar", path, "--set", "gravity=[0, -1, 0]")
    expected = load_scene("five_bar", changes=["gravity=[0, -1, 0]"])
    assert document_of(load_scene(path)) == document_of(expected)
    with pytest.raises(SceneError, match="exists"):
        ran("scene", "copy", "five_bar", path)


def test_a_copy_finds_the_model_elsewhere(tmp_path):
    there = tmp_path / "there"
    there.mkdir()
    for name in ("pantograph.urdf", "pantograph.yaml"):
        shutil.copy(EXAMPLES / name, there)
    (tmp_path / "here").mkdir()
    copy = tmp_path / "here" / "copy.yaml"
    ran("scene", "copy", there / "pantograph.yaml", copy)
    assert document_of(load_scene(copy)) == document_of(load_scene(there / "pantograph.yaml"))


@pytest.mark.parametrize(
    ("options", "force"), [((), 0.5), (("--push", "0,0,0"), 0.0), (("--push", "0.2, 0,0"), 0.2)]
)
def test_an_experiment_pushes_where_the_scene_does_not_and_says_so(tmp_path, options, force):
    idle = ("--set", "hand={kind: constant_wrench, start_delay: 0.0}")
    words = ("experiment", "five_bar", "--duration", "0.2", "--out", tmp_path / "out")
    shown = ran(*words, *idle, *options)
    assert ("the scene's hand does nothing" in shown) == (not options)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["energy"]["exchanged_j"] > 1e-12) == (force > 0.0)


@pytest.mark.parametrize("text", ["1,2", "a,b,c", "nan,0,0"])
def test_a_push_that_is_none_is_refused(tmp_path, text):
    with pytest.raises(InvalidInputError, match="three numbers"):
        ran("experiment", "five_bar", "--push", text, "--out", tmp_path / "out")


@pytest.fixture
def soon_measured(monkeypatch):
    """How well it measures is another test's."""
    monkeypatch.setattr(impedance, "SETTLING_S", 0.1)
    monkeypatch.setattr(impedance, "WINDOW_S", 0.4)


@pytest.mark.usefixtures("soon_measured")
@pytest.mark.parametrize(
    "command", [("impedance",), ("passivity", "--seconds", "0.1", "--processes", "1")], ids="-".join
)
def test_studies_leave_the_changed_scene_beside_their_results(tmp_path, command):
    other = tmp_path / "other" / "two_link.yaml"
    other.parent.mkdir()
    ran("scene", "copy", "two_link", other)
    for mass in ("0.5", "0.6"):
        words = ("feel", *command, "two_link", other, "--set", f"device.mass={mass}")
        ran(*words, "--delays", "1", "--out", tmp_path / "out")
        for name in ("two_link", "two_link_1"):
            changed = load_scene(tmp_path / "out" / "scenes" / f"{name}.yaml")
            assert changed.device.mass == float(mass)
            assert changed.device.mass != load_scene("two_link").device.mass


def test_a_changed_copy_can_be_changed_again_and_none_replaces_another(tmp_path):
    (copy,) = changed_copies(["two_link"], ["device.mass=0.5"], tmp_path)
    assert changed_copies([copy], ["device.damping=7.0"], tmp_path) == [copy]
    device = load_scene(copy).device
    assert (device.mass, device.damping) == (0.5, 7.0)
    with pytest.raises(SceneError):
        changed_copies([copy], ["device.mass=-1"], tmp_path)
    assert load_scene(copy).device == device
    named = [tmp_path / name for name in ("two_link_2.yaml", "two_link.yaml")]
    for path in named:
        shutil.copy(copy, path)
    asked = [str(named[0]), "two_link", str(named[1])]
    assert len(set(changed_copies(asked, ["device.mass=0.6"], tmp_path))) == 3


@pytest.mark.usefixtures("soon_measured")
def test_a_study_feels_what_was_changed(tmp_path):
    felt = []
    for changes in ((), ("--set", "device.mass=1.0")):
        words = ("feel", "impedance", "five_bar", "--json", *changes, "--out", tmp_path)
        rows = json.loads(ran(*words))
        felt.append([row["ratio_real"] for row in rows if row["loop"] == "device"])
    assert not np.allclose(felt[0], felt[1])


def test_a_sweep_is_of_the_changed_scene(tmp_path):
    felt = []
    for changes in ((), ("--set", "links.link1.inertial.mass=5.0")):
        words = ("sweep", "two_link", "--joint", "joint2=0.5:1.0:3", "--processes", "1")
        ran(*words, *changes, "--out", tmp_path)
        with np.load(tmp_path / "sweep.npz") as found:
            felt.append(found["inverse_inertia"])
    assert not np.allclose(felt[0], felt[1])
