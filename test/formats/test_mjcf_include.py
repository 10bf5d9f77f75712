# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Models of several files are the ones that MuJoCo makes of them."""

from __future__ import annotations

import mujoco
import pytest

from formats.children import outcomes
from formats.meshes import TETRAHEDRON, stl
from formats.test_mjcf import SAME, assert_as_mujoco_has_it
from formats.test_shapes import scene
from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.formats import read_model

BALL = '<geom size=".1" pos=".3 0 .1"/>'
# Settings, classes and bodies of their own; one file is found beside the file that includes it.
FILES = {
    "model.xml": """<mujoco model="m"><include file="settings.xml"/><include file="arm/arm.xml"/>
        <default><geom density="300"/></default>
        <worldbody><body name="a" pos="1 0 0" euler="1 .2 .3"><joint name="j" axis="1 2 3"/>
        <include file="arm/balls.xml"/></body></worldbody></mujoco>""",
    "settings.xml": """<mujocoinclude><compiler angle="radian" meshdir="parts"/>
        <option gravity="1 2 3"/><include file="classes.xml"/></mujocoinclude>""",
    "classes.xml": """<any><default><joint damping="2"/><default class="x"><joint type="slide"/>
        <geom type="box" size=".1 .2 .3"/></default></default></any>""",
    "arm/arm.xml": """<mujoco model="other"><worldbody>
        <body name="b" pos="0 1 0" childclass="x"><joint name="k" axis="0 1 1"/><geom/>
        <include file="hand.xml"/></body></worldbody>
        <equality><connect body1="a" body2="c" anchor=".1 .2 .3"/></equality></mujoco>""",
    "arm/hand.xml": """<mujoco><body name="c" euler="0 .3 0"><joint name="l" class="main"/>
        <geom class="main" size=".1" pos=".3 0 .1"/></body>
        <site name="s" pos="1 2 3"/></mujoco>""",
    "arm/balls.xml": f"<mujoco>{BALL}<geom size='.2' name='ball'/></mujoco>",
}


def written(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder / "model.xml"


def test_a_model_of_several_files_is_mujocos(tmp_path):
    ours, theirs = assert_as_mujoco_has_it(written(tmp_path, FILES), SAME, 0.0)
    assert (ours.model.nv, theirs.model.nsite) == (3, 1)
    assert ours.scene.gravity == (1.0, 2.0, 3.0)
    for name in "jkl":
        damping = theirs.model.dof_damping[theirs.model.joint(name).dofadr[0]]
        assert ours.written(name).damping == damping == 2.0
    assert len(ours.scene.closures) == theirs.model.neq == 1


def test_meshes_of_included_files_are_from_the_main_files_folder(tmp_path):
    mesh = '<asset><mesh name="m" file="body.stl"/></asset>'
    touching = '<geom name="piece" type="mesh" mesh="m" density="0"/>'
    files = FILES | {
        "arm/arm.xml": FILES["arm/arm.xml"].replace("<worldbody>", f"{mesh}<worldbody>"),
        "arm/balls.xml": FILES["arm/balls.xml"].replace("</mujoco>", f"{touching}</mujoco>"),
    }
    path = written(tmp_path, files)
    (tmp_path / "parts").mkdir()
    file = stl(tmp_path / "parts" / "body.stl", TETRAHEDRON)
    mujoco.MjModel.from_xml_path(str(path))
    found = load_scene(scene(path, [("b_collision", "piece")]))
    assert file.samefile(found.shapes[1].geometry.file)


def chain(count):
    """Return files that include each other, one after the other."""
    start = '<mujoco><worldbody><include file="0.xml"/></worldbody></mujoco>'
    files = {f"{k}.xml": f'<m><include file="{k + 1}.xml"/></m>' for k in range(count)}
    return {"model.xml": start, **files, f"{count}.xml": f"<m>{BALL}</m>"}


MAIN = '<mujoco>\n<worldbody><body><joint/><geom size="1"/>\n{}</body></worldbody></mujoco>'
ONE = MAIN.format('<include file="one.xml"/>')
# Files, which of them the error names, where in it, and words of the rule.
WRONG = {
    "gone": ({"model.xml": ONE}, "model.xml", "line 3, <include>", "no such file in"),
    "no name": ({"model.xml": MAIN.format("<include/>")}, "model.xml", "line 3", "needs file"),
    "itself": (
        {"model.xml": MAIN.format('<include file="../{folder}/model.xml"/>')},
        "model.xml",
        "line 3, <include>",
        "once at most",
    ),
    "circle": (
        {"model.xml": ONE, "one.xml": '<m>\n\n\n<include file="two.xml"/></m>',
         "two.xml": '<m><include file="./one.xml"/></m>'},
        "two.xml", "line 1, <include>", "once at most",
    ),
    "twice": (
        {"model.xml": ONE.replace("<joint/>", '<include file="one.xml"/>'),
         "one.xml": "<m><a/></m>"},
        "model.xml", "line 3, <include>", "once at most",
    ),
    "element": (
        {"model.xml": ONE, "one.xml": '<m>\n<joint/>\n<joint axis="0 0 0"/></m>'},
        "one.xml", "line 3, <joint>", "axis too small",
    ),
    "default": (
        {"model.xml": ONE.replace("<worldbody>", '<include file="two.xml"/><worldbody>'),
         "one.xml": "<m><site/></m>",
         "two.xml": '<m>\n<compiler eulerseq="x"/>\n<default><site euler="1 2 3"/></default></m>'},
        "two.xml", "line 2, <compiler>", "eulerseq",
    ),
    "not XML": ({"model.xml": ONE, "one.xml": "<m>\n<b></m>"}, "one.xml", "line 2", "not valid"),
    "two roots": ({"model.xml": ONE, "one.xml": "<m/><m/>"}, "one.xml", "line 1", "not valid XML"),
    "empty": ({"model.xml": ONE, "one.xml": "<m/>"}, "model.xml", "line 3", "must not be empty"),
    "not empty": (
        {"model.xml": MAIN.format('<include file="one.xml"><a/></include>')},
        "model.xml", "line 3, <include>", "nothing in it",
    ),
    "folder": (
        {"model.xml": MAIN.format('<include file="."/>')}, "", "file", "must be a regular file",
    ),
    "long": (
        {"model.xml": MAIN.format(f'<include file="{"x" * 5000}"/>')},
        "model.xml", "line 3, <include>", "no such file",
    ),
    "deep": (chain(300), "197.xml", "line 1, <include>", "at most 200 elements in each other"),
}  # fmt: skip


@pytest.mark.parametrize(("files", "file", "where", "rule"), WRONG.values(), ids=WRONG)
def test_wrong_includes_are_refused_by_file_and_line(tmp_path, files, file, where, rule):
    files = {name: text.replace("{folder}", tmp_path.name) for name, text in files.items()}
    path = written(tmp_path, files)
    with pytest.raises(SceneError) as caught:
        read_model(path)
    (problem,) = caught.value.problems
    assert rule in problem.rule
    assert problem.key_path.startswith(where)
    assert caught.value.source == str(tmp_path / file)


def test_the_limits_are_those_of_all_files_together(tmp_path):
    half = "<site/>" * 120_000
    both = '<include file="one.xml"/><include file="two.xml"/>'
    text = "x" * 5_000_000
    bodies = "<body/>" * 600
    cases = {
        "elements": (f"<m>{half}</m>", "at most 200000 elements"),
        "bytes": (f"<m><site name='{text}'/></m>", "at most 8000000 bytes, included files"),
        "bodies": (f"<m>{bodies}</m>", "at most 1000 elements <body>"),
    }
    paths = []
    for name, (part, _) in cases.items():
        (tmp_path / name).mkdir()
        files = {"model.xml": MAIN.format(both), "one.xml": part, "two.xml": part}
        paths.append(written(tmp_path / name, files))
    for found, (_, rule) in zip(outcomes(paths), cases.values(), strict=True):
        assert found.startswith("refused: ")
        assert rule in found


def test_a_long_chain_of_includes_is_read(tmp_path):
    text = chain(150)["model.xml"].replace('<include file="0.xml"/>', "<body><joint/>{}</body>")
    path = written(tmp_path, chain(150) | {"model.xml": text.format('<include file="0.xml"/>')})
    assert len(read_model(path).document["links"]) == 1
