# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of a live session: what belongs to which link, what the hand is, what is hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.contact.mesh_corners import CELLS, MOST_JOINED, MOST_TRIANGLES
from hapticmech_ros.live.commands import Open
from hapticmech_ros.live.live_picture import (
    LAYERS,
    VISUALS,
    LivePicture,
    first_view,
    ground_below,
    visual_bodies,
)
from hapticmech_ros.live.live_session import LiveSession
from hapticmech_ros.live.page_controls import History, numbers_html
from hapticmech_ros.live.settings import HANDS, changes_of, gain_sliders
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.view import palette
from oracles.touching import FLOOR, body, pair, scene, shape


def begun(name):
    session = LiveSession(Open(name, changes_of(load_scene(name))), 0.0)
    return session, LivePicture(session.opened)


def moved(session, seconds):
    for now in np.arange(0.0, seconds, 0.005):
        session.advance(now)
    return session.state()


@pytest.mark.parametrize("name", shipped_scenes())
def test_what_is_said_to_be_of_a_link_moves_with_it(name):
    """By its pose in the link's frame, which is the same wherever the mechanism is."""
    session, picture = begun(name)
    state, mechanism = session.state(), session.session.simulator.mechanism
    rng, seen = np.random.default_rng(3), []
    for _ in range(2):
        q = mechanism.integrate(state.q, rng.uniform(-0.3, 0.3, mechanism.nv))
        frame, found = picture.draw(replace(state, q=q)), {}
        for one in frame.shapes:
            link = picture.link_of(one)
            if link is not None and not one.namespace.endswith("_world"):
                local = frame.placement.links[link].inverse() * one.pose
                axis = None if one.kind == "sphere" else local.rotation[:, 2]
                found[one.key] = (local.translation, axis)
        seen.append(found)
        links = {picture.link_of(one) for one in frame.shapes}
        assert {link.name for link in mechanism.scene.links} <= links
    first, second = seen
    assert first.keys() == second.keys()
    for key, (place, axis) in first.items():
        assert second[key][0] == pytest.approx(place, abs=1e-9), key
        # What is drawn between two points may be turned about the line through them.
        if axis is not None:
            assert abs(second[key][1] @ axis) == pytest.approx(1.0, abs=1e-9), key


def test_all_layers_can_be_hidden():
    session, picture = begun("five_bar")
    state = moved(session, 0.8)
    whole = {one.namespace.split("/")[0] for one in picture.draw(state).shapes}
    assert {"rigid_directions", "free_directions", "mass", "point", "links", "device"} <= whole
    bare = {one.namespace.split("/")[0] for one in picture.draw(state, frozenset(LAYERS)).shapes}
    assert bare == whole - {"rigid_directions", "free_directions", "mass", "point"}


def test_the_hand_is_meant_where_its_ball_is_seen_whatever_is_in_front():
    session, picture = begun("five_bar")
    state = session.state()
    device = state.users[0].device[:, 3]
    eye = device + np.array((0.0, 0.0, 1.0))
    in_front = device + np.array((0.0, 0.0, 0.3 * picture.unit))
    assert picture.hand_at(state, eye, in_front) == "handle"
    assert picture.hand_at(state, eye, in_front + np.array((0.2 * picture.unit, 0.0, 0.0))) is None


@pytest.mark.parametrize("name", ["five_bar", "spatial_arm"])
def test_the_first_view_sees_everything(name):
    session, picture = begun(name)
    shapes = picture.draw(session.state()).shapes
    eye, centre, up = first_view(shapes, picture.planar)
    near = (eye - centre) / np.linalg.norm(eye - centre)
    assert abs(near @ up) < 0.9
    half = np.deg2rad(0.5 * 45.0)
    for one in shapes:
        to = one.pose.translation - eye if not len(one.points) else one.points[0] - eye
        assert -to @ near / np.linalg.norm(to) > np.cos(half)


@pytest.mark.parametrize("name", shipped_scenes())
def test_the_ground_is_below_everything_and_goes_through_below_the_origin(name):
    session, picture = begun(name)
    shapes = picture.draw(session.state()).shapes
    ground = ground_below(shapes, picture.planar)
    places = [one.points if len(one.points) else one.pose.translation[None] for one in shapes]
    assert ground.centre[2] <= min(0.0, np.vstack(places)[:, 2].min())
    assert (ground.centre[2] < 0.0) or not picture.planar
    lines = ground.centre[:2] / ground.cell
    assert lines == pytest.approx(np.round(lines), abs=1e-9)
    aside = np.abs(np.vstack(places)[:, :2] - ground.centre[:2]).max()
    assert aside < 0.5 * ground.side


def test_forces_that_are_there_already_do_not_change_the_first_view():
    session, picture = begun("five_bar")
    shapes = picture.draw(session.state()).shapes
    far = replace(shapes[0], namespace="device_command", points=np.full((2, 3), 9.0))
    for one, other in zip(
        first_view(shapes, picture.planar), first_view([*shapes, far], picture.planar), strict=True
    ):
        assert np.array_equal(one, other)


def test_a_mesh_is_drawn_as_its_hull(tmp_path):
    corners = 0.05 * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    rows = [f"v {x} {y} {z}" for x, y, z in corners.tolist()]
    file = tmp_path / "cube.obj"
    file.write_text("\n".join([*rows, "f 1 2 3", "f 4 5 6", "f 6 7 8"]) + "\n", encoding="utf-8")
    mesh = shape("one", {"kind": "mesh", "file": str(file)})
    document = scene(
        [body("one")], [FLOOR, mesh], [pair("one_shape")], {"one": [0, 0, 1, 0, 0, 0, 1]}
    )
    import yaml

    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    session, picture = begun(str(path))
    ((number, hull),) = picture.solids.items()
    assert np.abs(hull.corners) == pytest.approx(np.full((8, 3), 0.05))
    frame = picture.draw(session.state())
    assert frame.solids[number].translation == pytest.approx((0.0, 0.0, 1.0), abs=1e-3)
    assert picture.link_of(hull) == "one"
    assert picture.link_of(hull._replace(link="world")) is None


def test_numbers_are_told_by_name():
    session, picture = begun("five_bar")
    state = moved(session, 1.0)
    frame = picture.draw(state)
    text = numbers_html(state, frame, "five_bar", {}, {}, "")
    assert '<b id="live-count">1</b>' in text
    assert "problem" not in text
    refused = numbers_html(state, frame, "five_bar", {}, {}, "a < b")
    assert '<b id="live-problem">a &lt; b</b>' in refused
    rigid = replace(frame, masses={"handle": np.array((1.0, np.inf))})
    slow = numbers_html(replace(state, factor=0.5), rigid, "x", {}, {}, "")
    assert "slower than real time" in slow
    assert '<b id="live-mass">1, rigid</b>' in slow


def test_history_keeps_ten_seconds_and_begins_anew_with_time():
    session, picture = begun("five_bar")
    history = History()
    history.begin(picture.users, 3)
    columns = {one.title: one.columns for one in history.plots()}
    assert [len(column) for column in columns["joint constraints felt"]()] == [1, 1]
    state = session.state()
    for time in np.arange(0.0, 20.0, 0.02):
        history.add(replace(state, time=float(time)))
    times, *s = columns["response"]()
    assert len(s) == 3
    assert s[0][-1] == state.users[0].observation[0]
    assert times[-1] - times[0] == pytest.approx(10.0, abs=0.6)
    assert np.diff(times).min() >= 0.05
    history.add(replace(state, time=3.0))
    assert columns["joint constraints felt"]()[0].tolist() == [3.0]


@pytest.mark.parametrize("name", shipped_scenes())
def test_sliders_hold_what_the_scene_has_and_hands_are_scenes(name):
    for slider in gain_sliders(load_scene(name)):
        assert 0.0 <= slider.value <= slider.highest
        assert slider.step > 0.0
    for hand in HANDS:
        changed = load_scene(name, changes=changes_of(load_scene(name), [hand], 20.0))
        assert changed.connection.delay == pytest.approx(0.02)


ARM = """<robot name="arm">
  <link name="base"/>
  {links}
  <joint name="j1" type="continuous"><parent link="base"/><child link="one"/>
    <origin xyz="0.1 0 0.2" rpy="0 0.3 0"/><axis xyz="0 1 0"/></joint>
  <joint name="j2" type="fixed"><parent link="one"/><child link="cap"/>
    <origin xyz="0 0 0.3" rpy="0.2 0 0"/></joint>
  <joint name="j3" type="continuous"><parent link="cap"/><child link="two"/>
    <origin xyz="0 0.1 0.1"/><axis xyz="1 0 0"/></joint>
</robot>"""
LINK = """<link name="{}"><inertial><mass value="1"/><origin xyz="0 0 0.1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>{}</link>"""
VISUAL = (
    """<visual><origin xyz="0.01 0.02 0.1" rpy="0.1 0.2 0.3"/><geometry>{}</geometry></visual>"""
)
CORNERS = np.array([(0, 0, 0), (0.1, 0, 0), (0, 0.2, 0), (0, 0, 0.3)])
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))


@pytest.fixture
def arm(tmp_path):
    """Return a URDF file with visuals: a box, a cylinder, a mesh, and one that is not there."""
    loops = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*CORNERS[i]) for i in face)
        + "endloop\nendfacet\n"
        for face in FACES
    )
    (tmp_path / "body.stl").write_text(f"solid body\n{loops}endsolid body\n", encoding="utf-8")
    mesh = '<mesh filename="{}" scale="2 1 1"/>'
    shapes = (
        ("one", ('<box size="0.1 0.2 0.3"/>',)),
        ("cap", ('<cylinder radius="0.05" length="0.2"/>',)),
        ("two", (mesh.format("body.stl"), mesh.format("missing.stl"))),
    )
    links = "".join(
        LINK.format(name, "".join(VISUAL.format(one) for one in drawn)) for name, drawn in shapes
    )
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.format(links=links), encoding="utf-8")
    return path


def test_visuals_of_a_urdf_are_where_pinocchio_has_them_and_stand_for_rods(arm):
    session, picture = begun(str(arm))
    text = arm.read_text(encoding="utf-8").replace("body.stl", str(arm.parent / "body.stl"))
    (arm.parent / "missing.stl").write_bytes((arm.parent / "body.stl").read_bytes())
    model = pin.buildModelFromXML(text)
    (arm.parent / "whole.urdf").write_text(text, encoding="utf-8")
    drawn = pin.buildGeomFromUrdf(
        model,
        str(arm.parent / "whole.urdf"),
        pin.GeometryType.VISUAL,
        package_dirs=[str(arm.parent)],
    )
    data, poses = model.createData(), drawn.createData()
    q = np.array((0.4, -0.7))
    at = np.array((np.cos(0.4), np.sin(0.4), np.cos(-0.7), np.sin(-0.7)))
    pin.updateGeometryPlacements(model, data, drawn, poses, at)
    state = replace(session.state(), q=q)
    frame = picture.draw(state)
    # All but the mesh that is missing, in the order of the file.
    assert len(frame.solids) == 3
    for number, pose in frame.solids.items():
        expected = poses.oMg[-1 - number]
        assert pose.isApprox(expected, 1e-9), drawn.geometryObjects[-1 - number].name
    mesh = picture.solids[-3].corners
    wanted = CORNERS * (2.0, 1.0, 1.0)
    assert np.array(sorted(mesh.tolist())) == pytest.approx(np.array(sorted(wanted.tolist())))
    box, cylinder = (np.ptp(picture.solids[n].corners, axis=0) for n in (-1, -2))
    assert box == pytest.approx((0.1, 0.2, 0.3))
    assert cylinder == pytest.approx((0.1, 0.1, 0.2))
    assert picture.link_of(picture.solids[-3]) == "two"

    def rods(shown):
        return {one.key for one in shown.shapes if one.namespace == "links"}

    without = picture.draw(state, frozenset({VISUALS}))
    assert not without.solids
    assert rods(without)
    assert not rods(frame)


SDF = """<sdf version="1.9"><model name="m"><link name="a"><pose>0 0 1 0 0 0</pose>
  <inertial><mass>1</mass></inertial>
  <visual name="v"><pose>0.1 0.2 0.3 0 0 0.5</pose>
    <geometry><box><size>0.1 0.2 0.3</size></box></geometry>
    <material><diffuse>0 0.5 1 1</diffuse></material></visual></link>
  <joint name="j" type="revolute"><parent>world</parent><child>a</child>
    <axis><xyz>0 0 1</xyz></axis></joint></model></sdf>"""
MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="a" pos="0 0 1">
  <joint name="j" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
  <geom type="box" size="0.05 0.1 0.15" pos="0.1 0.2 0.3" euler="0 0 0.5" rgba="0 0.5 1 1"
    contype="0" conaffinity="0"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("suffix", "text"), [("sdf", SDF), ("xml", MJCF)])
def test_visuals_of_sdf_and_mjcf_are_read(tmp_path, suffix, text):
    path = tmp_path / f"one.{suffix}"
    path.write_text(text, encoding="utf-8")
    (one,) = visual_bodies(str(path))
    expected = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, 0.5), np.array((0.1, 0.2, 0.3)))
    assert one.link == "a"
    assert one.place.isApprox(expected, 1e-12)
    assert np.ptp(one.corners, axis=0) == pytest.approx((0.1, 0.2, 0.3))
    assert one.colour == pytest.approx((0.0, 0.5, 1.0, 1.0))


COLOURS = """<mujoco><asset><material name="red" rgba="1 0 0 1" texture="gone"/></asset>
  <default><default class="r"><geom material="red"/></default></default><worldbody>
  <geom name="floor" type="box" size="1 1 0.1" pos="0 0 -1"/>
  <body name="a" pos="0 0 1"><joint name="j" axis="0 1 0"/>
  <geom class="r" size="0.1" mass="1"/><geom size="0.2" rgba="0 1 0 0.5"/>
  <geom size="0.3" group="3"/><geom size="0.4" rgba="0 0 1 0"/>
  <geom name="foot" size="0.5" pos="0 0 -0.5"/></body></worldbody></mujoco>"""


def test_geoms_are_drawn_as_by_mujocos_viewer_and_those_that_touch_once(tmp_path):
    """All of these collide; not drawn are group 3, and what is invisible."""
    (tmp_path / "one.xml").write_text(COLOURS, encoding="utf-8")
    red, green, grey = (1, 0, 0, 1), (0, 1, 0, 0.5), palette.LINK
    drawn = visual_bodies(str(tmp_path / "one.xml"))
    found = [(one.link, np.ptp(one.corners[:, 0]), one.colour) for one in drawn]
    expected = [("world", 2.0, grey), ("a", 0.2, red), ("a", 0.4, green), ("a", 1.0, grey)]
    assert [(link, pytest.approx(size), colour) for link, size, colour in expected] == found
    beside = tmp_path / "one.yaml"
    beside.write_text(
        "format: hapticmech-scene/1\nmodel: one.xml\n"
        "contacts: [{name: c, a: floor, b: foot, stiffness: 1000.0}]\n",
        encoding="utf-8",
    )
    assert [np.ptp(one.corners[:, 0]) for one in visual_bodies(str(beside))] == [
        pytest.approx(0.2),
        pytest.approx(0.4),
    ]


ONE_MESH = """<robot name="r"><material name="blue"><color rgba="0 0 1 1"/></material>
  <link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"
  iyz="0"/></inertial><visual><geometry><mesh filename="a.obj"/></geometry>
  <material name="blue"/></visual></link><joint name="j" type="continuous"><parent link="world"/>
  <child link="a"/></joint></robot>"""


def visual_mesh(folder, vertices, faces):
    """Return what is drawn of a URDF file with a mesh; faces are lines of its OBJ file."""
    rows = (f"v {x} {y} {z}" for x, y, z in vertices.tolist())
    (folder / "a.obj").write_text("\n".join((*rows, *faces, "")), encoding="utf-8")
    (folder / "a.urdf").write_text(ONE_MESH, encoding="utf-8")
    (mesh,) = visual_bodies(str(folder / "a.urdf"))
    return mesh


@pytest.mark.parametrize(("times", "drawn"), [(1, 2), (MOST_JOINED, 4)])
def test_meshes_are_drawn_as_they_are_in_their_colour_and_the_largest_as_hulls(
    tmp_path, times, drawn
):
    """Two triangles with an edge in common: of their hull there are four."""
    mesh = visual_mesh(tmp_path, CORNERS, [*["f 1 2 3"] * times, "f 1 2 4"])
    assert len(mesh.triangles) == drawn
    assert mesh.colour == (0.0, 0.0, 1.0, 1.0)
    assert np.array(sorted(mesh.corners.tolist())) == pytest.approx(
        np.array(sorted(CORNERS.tolist()))
    )


def test_a_large_mesh_is_made_coarser_and_keeps_its_shape(tmp_path):
    """A ring: no triangle may span its hole, as those of its hull do."""
    around, across = 200, 80
    turn, tilt = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, around, endpoint=False),
        np.linspace(0.0, 2.0 * np.pi, across, endpoint=False),
        indexing="ij",
    )
    radius = 1.0 + 0.3 * np.cos(tilt)
    places = np.stack((radius * np.cos(turn), radius * np.sin(turn), 0.3 * np.sin(tilt)), axis=-1)

    def number(i, j):
        return 1 + (i % around) * across + j % across

    faces = [
        f"f {number(i, j)} {number(i + 1, j)} {number(i + a, j + 1)}"
        if a
        else f"f {number(i, j)} {number(i + 1, j + 1)} {number(i, j + 1)}"
        for i in range(around)
        for j in range(across)
        for a in (0, 1)
    ]
    assert len(faces) > MOST_TRIANGLES
    mesh = visual_mesh(tmp_path, places.reshape(-1, 3), faces)
    assert 1000 < len(mesh.triangles) <= MOST_TRIANGLES
    x, y, z = mesh.corners[mesh.triangles].mean(axis=1).T
    beside = np.hypot(np.hypot(x, y) - 1.0, z) - 0.3
    # Corners are moved by a cell at most, the diagonal of a cube.
    assert np.abs(beside).max() < np.sqrt(3.0) * 2.6 / CELLS
