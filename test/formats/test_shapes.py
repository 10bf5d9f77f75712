# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of files are where Pinocchio and MuJoCo have them, and in a scene once it names them."""

from __future__ import annotations

import json

import coal
import mujoco
import numpy as np
import pinocchio as pin
import pytest

from commands import ran
from formats.imports import (
    Read,
    counts_in,
    in_order_of,
    random_state,
    scene_naming_all,
    shape_pose,
    supports,
)
from formats.meshes import TETRAHEDRON, stl
from formats.robots import robot
from formats.test_sdf import joint, link
from formats.test_sdf import written as sdf_written
from formats.test_urdf import inertial_of
from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.formats import left_out, read_model
from hapticmech_ros.simulation import Simulator

# Rounding of a few transforms, and of roll, pitch, yaw.
SAME = 1e-12
# A mesh's file has seven digits.
SINGLE = 1e-6
# A base in the world with a post on it, an arm, and a tool that is fixed to it.
URDF = """<robot name="r"><link name="base">{a}</link><link name="post">{b}</link>
<link name="arm">{inertial}{c}</link><link name="tool">{d}</link>
<joint name="stands" type="fixed"><parent link="base"/><child link="post"/>
<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/></joint>
<joint name="turns" type="revolute"><parent link="post"/><child link="arm"/>
<origin xyz="0.3 0.2 0.1" rpy="1 2 3"/><axis xyz="1 2 3"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="holds" type="fixed"><parent link="arm"/><child link="tool"/>
<origin xyz="0 0 1" rpy="0.5 0.6 0.7"/></joint></robot>"""
PLACE = '<origin xyz="{0} 0.2 -0.3" rpy="0.4 {0} -0.6"/>'
GEOMETRIES = {
    "box": '<box size="0.1 0.2 0.3"/>',
    "sphere": '<sphere radius="0.4"/>',
    "cylinder": '<cylinder radius="0.1" length="0.5"/>',
    "mesh": '<mesh filename="file://{folder}/body.stl" scale="0.1 -0.2 0.3"/>',
}


def collision(geometry, place=0.5, name=""):
    called = f' name="{name}"' if name else ""
    return f"<collision{called}>{PLACE.format(place)}<geometry>{geometry}</geometry></collision>"


def urdf(folder, **parts):
    stl(folder / "body.stl", TETRAHEDRON)
    given = dict.fromkeys("abcd", "") | parts
    path = folder / "arm.urdf"
    text = URDF.format(inertial=inertial_of(1), **given)
    path.write_text(text.replace("{folder}", str(folder)))
    return path


def scene(path, contacts, **more):
    document = {"format": "hapticmech-scene/1", "model": path.name, **more}
    document["contacts"] = [
        {"name": f"c{k}", "a": a, "b": b, "stiffness": 1.0} for k, (a, b) in enumerate(contacts)
    ]
    file = path.parent / "scene.yaml"
    file.write_text(json.dumps(document))
    return file


def corners_of(mesh):
    """Return the corners of a mesh of a scene, as contacts read them before they take the hull."""
    loaded = coal.MeshLoader().load(mesh.file, np.array(mesh.scale))
    return np.array(loaded.vertices())


def assert_same_size(ours, theirs):
    """Compare a scene's geometry with coal's."""
    if isinstance(theirs, coal.Box):
        assert ours.kind == "box"
        assert np.abs(np.array(ours.size) - 2.0 * theirs.halfSide).max() < SAME
    elif isinstance(theirs, coal.Sphere):
        assert (ours.kind, ours.radius) == ("sphere", pytest.approx(theirs.radius, rel=SAME))
    elif isinstance(theirs, coal.Cylinder):
        assert (ours.kind, ours.radius) == ("cylinder", pytest.approx(theirs.radius, rel=SAME))
        assert ours.length == pytest.approx(2.0 * theirs.halfLength, rel=SAME)
    else:
        assert ours.kind == "mesh"
        points = corners_of(ours)
        here, known = pin.SE3.Identity(), np.array(theirs.vertices())
        assert np.abs(supports(points, here) - supports(known, here)).max() < SINGLE


def assert_as_in_pinocchio(path, base="fixed", package_dirs=None):
    ours, found = Read(path, base == "free"), scene_naming_all(path, base)
    root = (pin.JointModelFreeFlyer(),) if base == "free" else ()
    theirs = pin.buildModelFromUrdf(str(path), *root)
    shapes = pin.buildGeomFromUrdf(theirs, str(path), pin.COLLISION, None, package_dirs)
    if base == "free":
        ours.imported.joints["root_joint"] = found.links[0].joint.name
    _, convert = in_order_of(ours, theirs, list(theirs.names)[1:])
    q, _ = random_state(theirs, np.random.default_rng(1))
    data, placed = theirs.createData(), shapes.createData()
    pin.updateGeometryPlacements(theirs, data, shapes, placed, q)
    bodies = [solid.body for solid in ours.imported.shapes.values()]
    by_name = {shape.name: shape for shape in found.shapes}
    assert len(shapes.geometryObjects) == len(bodies) > 0
    for k, (name, body) in enumerate(zip(ours.imported.shapes, bodies, strict=True)):
        number = shapes.getGeometryId(f"{body}_{bodies[:k].count(body)}")
        pose, there = shape_pose(ours, by_name[name], convert(q)), placed.oMg[number]
        assert np.abs(pose.homogeneous - there.homogeneous).max() < 100 * SAME
        assert_same_size(by_name[name].geometry, shapes.geometryObjects[number].geometry)


def test_shapes_of_urdf_are_where_pinocchio_has_them(tmp_path):
    """On a base, on what is fixed to it, on a body, on what is fixed to that; two on each."""
    kinds = list(GEOMETRIES)
    parts = {
        letter: "".join(collision(GEOMETRIES[kinds[(k + i) % 4]], 0.1 * k + i) for i in range(2))
        for k, letter in enumerate("abcd")
    }
    assert_as_in_pinocchio(urdf(tmp_path, **parts))


@pytest.mark.parametrize(
    ("name", "base"),
    [
        ("panda_description/urdf/panda.urdf", "fixed"),
        ("ur_description/urdf/ur5_robot.urdf", "fixed"),
        ("solo_description/robots/solo12.urdf", "free"),
    ],
)
def test_robots_have_their_shapes_where_pinocchio_has_them(name, base, tmp_path):
    original = robot(".urdf", name)
    # Beside the file there is nothing to write to; its packages are found by their names.
    share = next(p for p in original.parents if p.name == "example-robot-data").parent
    path = tmp_path / original.name
    path.write_bytes(original.read_bytes())
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("ROS_PACKAGE_PATH", str(share))
        assert_as_in_pinocchio(path, base, [str(share)])


def test_only_what_contacts_name_is_in_the_scene(tmp_path):
    path = urdf(
        tmp_path,
        a=collision(GEOMETRIES["box"]),
        c=collision(GEOMETRIES["sphere"], name="my ball") + collision(GEOMETRIES["mesh"]),
        d=collision('<cone radius="1"/>') + collision("<sphere/>"),
    )
    (tmp_path / "body.stl").unlink()
    assert load_scene(path).shapes == ()
    found = load_scene(scene(path, [("base_collision", "my ball")]))
    assert [shape.name for shape in found.shapes] == ["base_collision", "my_ball"]
    assert (found.contacts[0].a, found.contacts[0].b) == ("base_collision", "my_ball")
    assert load_scene(scene(path, [("my_ball", "base_collision")])).shapes == found.shapes
    left = left_out(tmp_path / "scene.yaml")
    assert left.shapes == ("arm_collision", "tool_collision_2")
    counts = {note.what: note.count for note in left.notes}
    assert (counts["collision"], counts["collision: cone"]) == (2, 1)


def test_scene_check_lists_the_names(tmp_path):
    path = urdf(tmp_path, a=collision(GEOMETRIES["box"]) * 70, c=collision(GEOMETRIES["sphere"]))
    file = scene(path, [("base_collision", "arm_collision")])
    told = ran("scene", "check", file)
    assert "shapes of the model: base_collision_2, base_collision_3" in told
    assert "and 9 more, which --json lists" in told
    found = json.loads(ran("scene", "check", file, "--json"))
    assert found["model_shapes"] == [f"base_collision_{k}" for k in range(2, 71)]
    assert "collision (69 x): no effect unless a contact of a scene file names it" in found["notes"]


NAMES = (
    ("", "a"), ("shell", "a"), ("", "a"), ("hull", "b"), ("hull", "c"), ("x y", "b"), ("x_y", "b"),
    ("", "b"), ("b_hull", "c"), ("c_collision", "a"), ("", "c"),
)  # fmt: skip
NAMED = (
    "a_collision", "shell", "a_collision_2", "b_hull_2", "c_hull", "b_x_y", "b_x_y_2",
    "b_collision", "b_hull", "c_collision", "c_collision_2",
)  # fmt: skip


def test_shapes_have_the_files_names_where_these_are_theirs_alone(tmp_path):
    inside = {
        one: "".join(collision("<sphere radius='1'/>", name=n) for n, body in NAMES if body == one)
        for one in "abc"
    }
    path = urdf(tmp_path, **inside)
    text = path.read_text()
    for old, new in (("base", "a"), ("post", "b"), ("arm", "c")):
        text = text.replace(f'"{old}"', f'"{new}"')
    path.write_text(text)
    order = sorted(range(len(NAMES)), key=lambda k: NAMES[k][1])
    assert list(read_model(path).shapes) == [NAMED[k] for k in order]


def test_a_scenes_own_shapes_go_before_the_models(tmp_path):
    path = urdf(tmp_path, a=collision(GEOMETRIES["box"]), c=collision(GEOMETRIES["sphere"]))
    own = {"name": "base_collision", "link": "post", "geometry": {"kind": "half_space"}}
    file = scene(path, [("arm_collision", "base_collision")], shapes=[own])
    found = {shape.name: shape for shape in load_scene(file).shapes}
    assert found.keys() == {"arm_collision", "base_collision"}
    assert found["base_collision"].geometry.kind == "half_space"
    assert left_out(file).shapes == ("base_collision",)


def test_a_contact_of_no_shape_is_told_of_both_kinds(tmp_path):
    path = urdf(tmp_path, a=collision(GEOMETRIES["box"]))
    own = {"name": "floor", "link": "world", "geometry": {"kind": "half_space"}}
    with pytest.raises(SceneError) as caught:
        load_scene(scene(path, [("floor", "base_collision"), ("gone", "floor")], shapes=[own]))
    (problem,) = caught.value.problems
    assert (problem.key_path, problem.value) == ("contacts[1].a", "gone")
    assert "the scene file has ['floor'], the model ['base_collision']" in problem.rule


WRONG = {
    "cone": ('<cone radius="1"/>', "a scene's shapes are"),
    "radius": ('<sphere radius="0"/>', "sizes must be above zero"),
    "no radius": ("<sphere/>", "needs radius"),
    "size": ('<box size="1 2"/>', "size must be 3"),
    "flat": ('<box size="1 -2 1"/>', "sizes must be above zero"),
    "nan": ('<sphere radius="nan"/>', "must be 1 finite"),
    "nothing": ("", "a scene's shapes are"),
    "no file": ("<mesh/>", "needs filename"),
    "gone": ('<mesh filename="gone.stl"/>', "no such file in"),
    "scale": ('<mesh filename="body.stl" scale="1 0 1"/>', "a scale must not be zero"),
}


@pytest.mark.parametrize(("geometry", "rule"), WRONG.values(), ids=WRONG)
def test_a_shape_that_is_none_is_refused_once_it_is_needed(tmp_path, geometry, rule):
    path = urdf(tmp_path, a=collision(GEOMETRIES["box"]), d=collision(geometry))
    load_scene(path)
    with pytest.raises(SceneError, match=r"line \d+, <") as caught:
        load_scene(scene(path, [("base_collision", "tool_collision")]))
    assert rule in caught.value.problems[0].rule


MJCF = """<mujoco><compiler meshdir="parts"/>
<default><default class="seen"><geom contype="0" conaffinity="0"/></default>
<default class="round"><geom type="capsule" size=".1 .2"/></default></default>
<asset><mesh name="m" file="body.stl" scale="2 3 -1" refpos=".1 .2 .3"/>
<mesh file="turned.stl" refquat="1 2 3 4" refpos=".1 .2 .3" scale="2 2 2"/></asset>
<worldbody><geom name="floor" type="plane" size="1 1 1" pos="0 0 -1" euler="10 20 30"/>
<geom name="ball" size=".3" pos="1 2 3"/><geom class="seen" size=".1"/>
<body name="a" pos="1 0 0" euler="10 20 30"><joint name="j" axis="1 2 3" pos=".1 .2 .3"/>
<geom name="pill" class="round" pos=".1 0 0" quat="1 2 3 4"/>
<geom name="rod" type="capsule" size=".1" fromto="0 0 0 .3 .2 .1"/>
<geom name="log" type="cylinder" size=".1 .4" xyaxes="1 1 0 0 1 1" conaffinity="0"/>
<frame pos="0 1 0" euler="30 20 10"><geom name="block" type="box" size=".1 .2 .3" contype="0"/>
<geom name="beam" type="box" size=".1" fromto="0 0 0 .3 .2 .1"/></frame>
<body name="b" pos="0 0 1"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<geom name="piece" type="mesh" mesh="m" pos=".1 .2 .3" zaxis="1 1 1"/>
<geom name="turned" type="mesh" mesh="turned" euler="5 6 7"/></body></body></worldbody></mujoco>"""


def mjcf(folder, text=MJCF):
    (folder / "parts").mkdir()
    stl(folder / "parts" / "body.stl", TETRAHEDRON)
    stl(folder / "parts" / "turned.stl", TETRAHEDRON)
    path = folder / "model.xml"
    path.write_text(text)
    return path


def half_sizes(geometry):
    """Return sizes as MuJoCo has them."""
    if geometry.kind == "box":
        return [0.5 * size for size in geometry.size]
    if geometry.kind == "sphere":
        return [geometry.radius]
    return [geometry.radius, 0.5 * geometry.length]


def test_shapes_of_mjcf_are_where_mujoco_has_them(tmp_path):
    path = mjcf(tmp_path)
    ours, found = Read(path), scene_naming_all(path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = q = np.array((0.7,))
    mujoco.mj_forward(model, data)
    shapes = {shape.name: shape for shape in found.shapes}
    assert set(ours.imported.shapes) == set(shapes) - {"here", "there"}
    assert len(shapes) == 11
    for name in ours.imported.shapes:
        shape, there = shapes[name], model.geom(name).id
        pose, turn = shape_pose(ours, shape, q), data.geom_xmat[there].reshape(3, 3)
        place = pin.SE3(turn, data.geom_xpos[there])
        if shape.geometry.kind == "mesh":
            mesh = model.geom_dataid[there]
            first = model.mesh_vertadr[mesh]
            known = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
            points = corners_of(shape.geometry)
            assert np.abs(supports(points, pose) - supports(known, place)).max() < 10 * SINGLE
            continue
        assert np.abs(pose.homogeneous - place.homogeneous).max() < 10 * SAME
        if shape.geometry.kind != "half_space":
            sizes = half_sizes(shape.geometry)
            assert model.geom_size[there][: len(sizes)] == pytest.approx(sizes, rel=SAME)


@pytest.mark.parametrize(
    ("name", "rule"), [("f", "a scene's shapes"), ("e", "a scene's shapes"), ("i", "needs a file")]
)
def test_geoms_that_no_scene_has_are_noted_and_refused(tmp_path, name, rule):
    fitted = '<geom name="f" type="box" mesh="m"/><geom name="e" type="ellipsoid" size="1 1 1"/>'
    inline = '<mesh name="i" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>'
    body = '<body name="b" pos="0 0 1">'
    text = MJCF.replace(body, f'{body}{fitted}<geom name="i" type="mesh" mesh="i"/>')
    text = text.replace("</asset>", inline)
    path = mjcf(tmp_path, text)
    counts = counts_in(read_model(path))
    assert counts["geom that collides: box about a mesh"] == 1
    assert counts["geom that collides: ellipsoid"] == 1
    assert counts["geom"] == 1
    with pytest.raises(SceneError, match=rule):
        load_scene(scene(path, [("floor", name)]))


FALLING = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body name="ball" pos="0 0 .15"><freejoint name="f"/><geom name="shell" size=".1" mass="2"/></body>
</worldbody></mujoco>"""


def test_a_ball_of_the_file_comes_to_rest_on_its_floor(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(FALLING)
    file = scene(path, [("shell", "floor")])
    contact = {"stiffness": 1e4, "damping": 200.0}
    file.write_text(file.read_text().replace('"stiffness": 1.0', json.dumps(contact)[1:-1]))
    sim = Simulator(load_scene(file))
    height = sim.run(sim.initial_state(), 3000, None, 100).q[-1, 2]
    assert height == pytest.approx(0.1 - 2.0 * 9.81 / 1e4, abs=1e-6)


SDF_PLACE = "<pose>0.1 0.2 0.3 0.4 0.5 0.6</pose>"
SDF_GEOMETRIES = {
    "box": ("<box><size>0.1 0.2 0.3</size></box>", {"size": (0.1, 0.2, 0.3)}),
    "sphere": ("<sphere><radius>0.4</radius></sphere>", {"radius": 0.4}),
    "cylinder": (
        "<cylinder><radius>0.1</radius><length>0.5</length></cylinder>",
        {"radius": 0.1, "length": 0.5},
    ),
    "capsule": (
        "<capsule><radius>0.1</radius><length>0.5</length></capsule>",
        {"radius": 0.1, "length": 0.5},
    ),
    "mesh": (
        "<mesh><uri>body.stl</uri><scale>0.1 -0.2 0.3</scale></mesh>",
        {"scale": (0.1, -0.2, 0.3)},
    ),
    "half_space": ("<plane><normal>0 0 1</normal><size>1 1</size></plane>", {}),
}


def sdf_collision(name, geometry, place=SDF_PLACE):
    return f'<collision name="{name}">{place}<geometry>{geometry}</geometry></collision>'


@pytest.mark.parametrize("place", ["link", "frame", "joint", "none"])
def test_shapes_of_sdf_are_where_their_poses_say(tmp_path, place):
    """Their links have places of their own; poses may be relative to other frames."""
    stl(tmp_path / "body.stl", TETRAHEDRON)
    own = pin.SE3(pin.rpy.rpyToMatrix(0.4, 0.5, 0.6), np.array((0.1, 0.2, 0.3)))
    frame = pin.SE3(pin.rpy.rpyToMatrix(0.3, 0.2, 0.1), np.array((3.0, 2.0, 1.0)))
    written_place = {
        "link": SDF_PLACE,
        "frame": SDF_PLACE.replace("<pose>", '<pose relative_to="f">'),
        "joint": SDF_PLACE.replace("<pose>", '<pose relative_to="j">'),
        "none": "",
    }[place]
    solids = "".join(
        sdf_collision(kind, geometry, written_place)
        for kind, (geometry, _) in SDF_GEOMETRIES.items()
    )
    at = "<pose>1 2 3 0.7 0.8 0.9</pose>"
    parts = [
        link("a", f"{at}{solids}"),
        joint("j", "world", "a", inside="<pose>0.5 0 0 0.1 0 0</pose>"),
        '<frame name="f"><pose>3 2 1 0.3 0.2 0.1</pose></frame>',
    ]
    path = sdf_written(tmp_path, parts)
    ours, found = Read(path), scene_naming_all(path)
    of_link = ours.pose("a", np.zeros(1))
    in_link = {
        "link": own,
        "frame": of_link.actInv(frame * own),
        "joint": pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.0, 0.0), np.array((0.5, 0.0, 0.0))) * own,
        "none": pin.SE3.Identity(),
    }[place]
    q = np.array((0.7,))
    there = ours.pose("a", q) * in_link
    for kind, (_, sizes) in SDF_GEOMETRIES.items():
        shape = next(shape for shape in found.shapes if shape.name == kind)
        assert shape.geometry.kind == kind
        assert np.abs(shape_pose(ours, shape, q).homogeneous - there.homogeneous).max() < 10 * SAME
        for key, value in sizes.items():
            assert getattr(shape.geometry, key) == pytest.approx(value, rel=SAME)


def test_a_plane_of_sdf_is_all_below_its_normal(tmp_path):
    plane = "<plane><normal>1 -2 0.5</normal></plane>"
    path = sdf_written(
        tmp_path, [link("a", sdf_collision("wall", plane, "")), joint("j", "world", "a")]
    )
    ours, found = Read(path), scene_naming_all(path)
    wall = next(shape for shape in found.shapes if shape.name == "wall")
    up = ours.pose("a", np.zeros(1)).actInv(shape_pose(ours, wall, np.zeros(1))).rotation[:, 2]
    assert np.abs(up - np.array((1.0, -2.0, 0.5)) / np.sqrt(5.25)).max() < SAME


SDF_WRONG = {
    "submesh": ("<mesh><uri>a.stl</uri><submesh/></mesh>", "parts of meshes"),
    "no uri": ("<mesh/>", "needs a <uri>"),
    "normal": ("<plane><normal>0 0 0</normal></plane>", "must not be zero"),
    "heights": ("<heightmap/>", "a scene's shapes are"),
    "radius": ("<sphere><radius>-1</radius></sphere>", "sizes must be above zero"),
    "length": ("<capsule><length>x</length></capsule>", "length must be 1 number"),
}


@pytest.mark.parametrize(("geometry", "rule"), SDF_WRONG.values(), ids=SDF_WRONG)
def test_wrong_shapes_of_sdf_are_refused_once_they_are_needed(tmp_path, geometry, rule):
    solids = sdf_collision("bad", geometry) + sdf_collision("good", SDF_GEOMETRIES["sphere"][0])
    path = sdf_written(tmp_path, [link("a", solids), joint("j", "world", "a")])
    floor = {"name": "floor", "link": "world", "geometry": {"kind": "half_space"}}
    load_scene(scene(path, [("floor", "good")], shapes=[floor]))
    with pytest.raises(SceneError, match=r"line \d+, <") as caught:
        load_scene(scene(path, [("floor", "bad")], shapes=[floor]))
    assert rule in caught.value.problems[0].rule
