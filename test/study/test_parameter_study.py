# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes with keys varied: each measured once, whoever shares the work, and whatever ends it."""

import json
import os
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

from commands import ran
from hapticmech_ros import load_scene
from hapticmech_ros.errors import InvalidInputError, SceneError
from hapticmech_ros.study import run_study
from hapticmech_ros.study.parameter_study import DEFINITION, ROWS, StudyError
from study.counting import FOLDER
from study.designs import of

MASSES = "device.mass=0.1,0.2,0.3,0.4,0.5,0.6"
HEADING = "time,fx,fy,fz,tx,ty,tz\n"
BARS = Path(__file__).resolve().parents[2] / "examples" / "four_bar.yaml"
PANTOGRAPH = BARS.with_name("pantograph.yaml")


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """Return a function that tells how often each scene was measured, by its device's mass."""
    folder = tmp_path / "asked"
    folder.mkdir()
    monkeypatch.setenv(FOLDER, str(folder))
    return lambda: {path.name: len(path.read_text()) for path in folder.iterdir()}


def test_the_mass_felt_is_that_of_the_closed_form():
    """A slider of mass m on a rail is felt as m along it, and as rigid across."""
    rail = {
        "format": "hapticmech-scene/1",
        "name": "rail",
        "task_space": "planar",
        "links": [
            {
                "name": "block",
                "parent": "world",
                "joint": {"name": "rail", "type": "prismatic", "axis": [1, 0, 0]},
                "inertial": {"mass": 1.0, "inertia": {"ixx": 1e-3, "iyy": 1e-3, "izz": 1e-3}},
            }
        ],
        "operational_points": [{"name": "handle", "link": "block"}],
        "hand": {"kind": "constant_wrench"},
    }
    from hapticmech_ros.scene import scene_from_document

    design = of("links.block.inertial.mass=0.5:8:9:log", "links.block.joint.armature=0,2.5")
    found = run_study(scene_from_document(rail), design)
    values, numbers = found.values(), found.arrays()
    expected = values["links.block.inertial.mass"] + values["links.block.joint.armature"]
    assert found.index.tolist() == list(range(18))
    assert np.abs(numbers["mass_x"] / expected - 1.0).max() < 1e-14
    assert np.abs(numbers["mass_least"] / expected - 1.0).max() < 1e-14
    assert np.isinf(numbers["mass_y"]).all()
    assert np.isinf(numbers["mass_largest"]).all()
    assert (numbers["count"] == 2).all()
    # A rail that is turned by a right angle: across it there is rounding, which is no mass.
    turned = of("links.block.joint.origin={rpy: [0, 0, 1.5707963267948966]}")
    rows = run_study(scene_from_document(rail), turned).arrays()
    assert abs(rows["mass_y"][0] - 1.0) < 1e-14
    assert np.isinf(rows["mass_x"][0])
    assert np.isinf(rows["inertia_z"][0])


def test_a_linkage_is_varied_by_its_points_and_gains_follow_the_rule():
    design = of("linkage.points.B=[0.03, 0.06],[0.04, 0.05]", "device.mass=0.1,0.4")
    found = run_study(BARS, design, ("felt", "limits"))
    assert not found.failed
    rows = found.arrays()
    # The mass felt is the mechanism's, the margin also the device's.
    felt, margin = rows["mass_least"], rows["gain_margin"]
    assert felt[0] == felt[1] != felt[2]
    assert margin[0] != margin[1]
    for index in range(4):
        scene = load_scene(BARS, changes=design.changes(index))
        alone = run_study(scene, of("hand.start_delay=0.0"), ("felt", "limits"))
        assert np.array_equal(alone.numbers[0], found.numbers[index])


def test_links_of_a_urdf_are_varied_like_any_others_and_read_once(monkeypatch):
    from hapticmech_ros.formats import reading

    read = []
    original = reading.read_model
    monkeypatch.setattr(
        reading, "read_model", lambda *given: (read.append(given), original(*given))[1]
    )
    found = run_study(PANTOGRAPH, of("links.left_lower.inertial.mass=0.05:0.4:6"))
    assert len(read) == 1
    assert not found.failed
    scene = load_scene(PANTOGRAPH)
    for value, row in zip(
        found.values()["links.left_lower.inertial.mass"], found.numbers, strict=True
    ):
        changed = scene.with_(f"links.left_lower.inertial.mass={float(value)!r}")
        alone = run_study(changed, of("hand.start_delay=0.0"))
        assert np.array_equal(alone.numbers[0], row)
    parts = "{file: pantograph.urdf, joints: {left_elbow: {armature: 0.01}}}"
    joints = run_study(PANTOGRAPH, of(f"model=pantograph.urdf,{parts}"))
    assert joints.arrays()["mass_x"][0] < joints.arrays()["mass_x"][1]


def test_an_experiment_has_its_figures():
    design = of("experiment.duration=0.05")
    found = run_study("five_bar", design, ("experiment",))
    rows = found.arrays()
    assert rows["kept"].tolist() == [1.0]
    assert 0.0 < rows["drift_rms"][0] < 1e-2
    assert np.isnan(rows["contact_error"][0])


def test_rows_are_the_same_to_the_bit_whoever_shares_the_work(tmp_path):
    design = of("links[0].inertial.mass=0.05:0.5", "device.mass=0.1:0.4", samples=40, seed=1)
    here = run_study("five_bar", design, ("felt", "limits"))
    shared = run_study("five_bar", design, ("felt", "limits"), workers=2, folder=tmp_path)
    with ThreadPoolExecutor(2) as executor:
        other = run_study("five_bar", design, ("felt", "limits"), workers=executor)
    for found in (shared, other):
        assert found.columns == here.columns
        assert np.array_equal(found.index, here.index)
        assert found.numbers.tobytes() == here.numbers.tobytes()


def test_each_scene_is_measured_once_and_what_failed_is_told(tmp_path, asked):
    out = tmp_path / "out"
    told = []
    first = run_study(
        "two_link",
        of("device.mass=0.1,0.2,-1,0.4"),
        ("study.counting:mass",),
        folder=out,
        show=lambda *numbers: told.append(numbers),
    )
    assert first.columns == ("mass", "double")
    assert first.index.tolist() == [0, 1, 3]
    assert first.arrays()["double"].tolist() == [0.2, 0.4, 0.8]
    assert list(first.failed) == [2]
    assert "device.mass" in first.failed[2]
    assert told[0] == (0, 4)
    assert told[-1] == (4, 4)
    counts = asked()
    again = run_study(
        "two_link", of("device.mass=0.1,0.2,-1,0.4"), ("study.counting:mass",), folder=out
    )
    assert again.numbers.tobytes() == first.numbers.tobytes()
    assert again.failed == first.failed
    own = repr(load_scene("two_link").device.mass)
    more = {mass: count - counts[mass] for mass, count in asked().items()}
    # The scene as it is tells what the numbers are; it is no row.
    assert {mass: count for mass, count in more.items() if count} == {own: 1}


def test_a_worker_that_dies_costs_its_scene_alone_which_is_tried_again(tmp_path, asked):
    out = tmp_path / "out"
    design, measures = of(MASSES), ("study.counting:deadly",)
    found = run_study("two_link", design, measures, folder=out, workers=2)
    assert found.lost == (1,)
    assert not found.sound
    assert found.index.tolist() == [0, 2, 3, 5]
    assert found.arrays()["mass"].tolist() == [0.1, 0.3, 0.4, 0.6]
    assert found.failed == {4: "half a kilogram"}
    before = asked()
    again = run_study("two_link", design, measures, folder=out, workers=2)
    assert again.lost == (1,)
    more = {mass for mass, count in asked().items() if count > before[mass]}
    assert more == {"0.2", repr(load_scene("two_link").device.mass)}


def test_a_pool_of_a_user_s_own_is_left_open(tmp_path, asked):
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        found = run_study("two_link", of(MASSES), ("study.counting:mass",), workers=pool)
        assert found.index.size == 6
        assert pool.submit(abs, -3).result() == 3


def test_a_study_that_is_killed_goes_on_without_a_lost_or_doubled_row(tmp_path, asked):
    """A worker ends the process that runs the study, which is then started again."""
    out, measures = tmp_path / "out", ("study.counting:late_end",)
    script = f"""
from pathlib import Path
from hapticmech_ros.study import Design, Variation, run_study
if __name__ == "__main__":
    design = Design((Variation.read("device.mass=0.1:0.5:81"),))
    run_study("two_link", design, {measures}, folder=Path({str(out)!r}), workers=2)
"""
    path = os.pathsep.join([str(Path(__file__).parents[1]), *filter(None, sys.path)])
    (tmp_path / "run.py").write_text(script, encoding="utf-8")
    command = [sys.executable, str(tmp_path / "run.py")]
    environment = {**os.environ, "PYTHONPATH": path}
    ended = subprocess.run(command, env=environment, timeout=120.0, check=False)
    assert ended.returncode == -signal.SIGKILL
    written = [json.loads(line[9:])["index"] for line in (out / ROWS).read_text().splitlines()]
    assert 0 < len(written) < 81
    design, before = of("device.mass=0.1:0.5:81"), asked()
    (Path(os.environ[FOLDER]) / "spared").touch()
    found = run_study("two_link", design, measures, folder=out)
    masses = [float(design.values(index)[0]) for index in range(81)]
    assert found.index.tolist() == list(range(81))
    assert found.arrays()["mass"].tolist() == masses
    assert len((out / ROWS).read_text().splitlines()) == 81
    more = {mass for mass, count in asked().items() if count > before.get(mass, 0)}
    # 0.3 kg are the scene's own, which tells what the numbers are.
    assert not more & {repr(masses[index]) for index in written} - {"0.3"}


def test_numbers_that_change_their_names_are_a_failure():
    found = run_study("two_link", of("device.mass=0.1,0.4"), ("study.counting:changing",))
    assert found.columns == ("light",)
    assert found.failed == {1: "has other numbers than the first scene: heavy"}


@pytest.mark.parametrize(
    ("arguments", "error", "rule"),
    [
        ({"measures": ("feld",)}, InvalidInputError, "did you mean 'felt'"),
        ({"measures": ()}, InvalidInputError, "at least one"),
        ({"measures": ("felt", "felt")}, InvalidInputError, "two of them have"),
        ({"measures": ("study.counting:nothing",)}, InvalidInputError, "cannot be imported"),
        ({"measures": ("no.such.module:x",)}, InvalidInputError, "cannot be imported"),
        ({"measures": ("study.counting:FOLDER",)}, InvalidInputError, "must be a function"),
        ({"point": "nose"}, InvalidInputError, "operational point"),
        ({"workers": 0}, InvalidInputError, "1 or more"),
        ({"changes": ("device.mass=-1",)}, SceneError, "device.mass"),
    ],
)
def test_bad_input_is_refused_before_anything_is_measured(arguments, error, rule):
    with pytest.raises(error, match=rule):
        run_study("two_link", of(MASSES), **arguments)


@pytest.mark.parametrize("key", ["device.masss", "links.nobody.inertial.mass", "links[9].name"])
def test_keys_that_the_scene_has_not_are_refused_at_once(key):
    with pytest.raises(SceneError, match=r"unknown key|must be"):
        run_study("two_link", of(f"{key}=1,2"))


def test_the_command_writes_rows_table_summary_and_figure_and_goes_on(tmp_path):
    out = tmp_path / "study"
    command = ["study", "five_bar", "--vary", "links.link1.inertial.mass=0.1:0.2:3"]
    command += ["--vary", "controller.passivity.control=true,false", "--measure", "felt,limits"]
    command += ["--processes", "1", "-o", str(out)]
    said = ran(*command)
    assert "6 of 6 scenes measured" in said
    assert "mass_x (kg)" in said
    names = {path.name for path in out.iterdir()}
    assert names == {
        *(DEFINITION, ROWS),
        *("study.npz", "study.png", "summary.json", "summary.md"),
    }
    with np.load(out / "study.npz") as table:
        assert np.allclose(table["links.link1.inertial.mass"], np.repeat([0.1, 0.15, 0.2], 2))
        assert table["controller.passivity.control"].tolist() == ["true", "false"] * 3
        digest = str(table["scene_sha256"])
    assert json.loads((out / DEFINITION).read_text())["scene_sha256"] == digest
    assert len(digest) == 64
    assert json.loads(ran(*command, "--json"))["spread"]["count"]["median"] == 1.0
    with pytest.raises(StudyError, match="differs in scene_sha256"):
        ran(*command, "--set", "device.mass=0.2")


def test_files_that_a_scene_names_belong_to_its_hash(tmp_path):
    script = tmp_path / "hand.csv"
    script.write_text(HEADING + "0,0,0,0,0,0,0\n1,0.1,0,0,0,0,0\n", encoding="utf-8")
    changes = (f"hand={{kind: scripted, file: {script}}}",)
    design = of("device.mass=0.2")
    first = run_study("two_link", design, changes=changes)
    assert run_study("two_link", design, changes=changes).scene_sha256 == first.scene_sha256
    script.write_text(HEADING + "0,0,0,0,0,0,0\n1,0.2,0,0,0,0,0\n", encoding="utf-8")
    assert run_study("two_link", design, changes=changes).scene_sha256 != first.scene_sha256
