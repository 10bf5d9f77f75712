# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SDFormat: poses relative to anything, axes in any frame, loops closed by joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from formats.imports import Read, beside, refused, same_dynamics, saved
from hapticmech_ros.errors import SceneError
from hapticmech_ros.formats import read_model
from hapticmech_ros.mechanism import Mechanism

# Rounding of a few transforms, of angles that are taken from a rotation and put in again.
SAME = 1e-13
INERTIAL = """<inertial><pose>0.3 0.2 -0.1 0.4 0.5 0.6</pose><mass>1.5</mass><inertia><ixx>1</ixx>
<iyy>1.2</iyy><izz>1.3</izz><ixy>0.1</ixy><ixz>0.05</ixz><iyz>0.02</iyz></inertia></inertial>"""


def text_of(place):
    numbers = (*place.translation, *pin.rpy.matrixToRpy(place.rotation))
    return " ".join(repr(float(x)) for x in numbers)


def pose(place, relative=""):
    relative = f' relative_to="{relative}"' if relative else ""
    return f"<pose{relative}>{text_of(place)}</pose>"


def link(name, inside=""):
    return f'<link name="{name}">{inside}{INERTIAL}</link>'


def joint(name, parent, child, axis="1 2 3", kind="revolute", inside="", of_axis=""):
    return f"""<joint name="{name}" type="{kind}"><parent>{parent}</parent><child>{child}</child>
        {inside}<axis><xyz{of_axis}>{axis}</xyz></axis></joint>"""


def written(folder, parts, version="1.9", model=""):
    inside = "".join(parts)
    text = f'<sdf version="{version}"><model name="m"{model}>{inside}</model></sdf>'
    return saved(folder, "model.sdf", text)


@pytest.fixture
def places():
    rng = np.random.default_rng(1)
    found = []
    for _ in range(6):
        moved = pin.exp6(rng.normal(size=6))
        found.append(pin.SE3(moved.rotation, moved.translation))
    return found


def built(places_in_world, joints):
    """Return Pinocchio's model of links at places in the world, each on the one before.

    Args:
        places_in_world: of links at zero.
        joints: (pose of the joint in the world, its axis in its own frame) for each link.
    """
    model, before = pin.Model(), pin.SE3.Identity()
    inertia = pin.Inertia(
        1.5, np.zeros(3), np.array([[1.0, 0.1, 0.05], [0.1, 1.2, 0.02], [0.05, 0.02, 1.3]])
    ).se3Action(pin.SE3(pin.rpy.rpyToMatrix(0.4, 0.5, 0.6), np.array((0.3, 0.2, -0.1))))
    for place, (at, axis) in zip(places_in_world, joints, strict=True):
        unit = axis / np.linalg.norm(axis)
        number = model.addJoint(
            model.njoints - 1, pin.JointModelRevoluteUnaligned(unit), before.actInv(at), ""
        )
        model.appendBodyToJoint(number, inertia, at.actInv(place))
        before = at
    return model


def assert_same(path, theirs, places_in_world, names, joints):
    ours, data = Read(path), theirs.createData()
    for q, _ in same_dynamics(ours, theirs, 10 * SAME):
        pin.forwardKinematics(theirs, data, q)
        for k, (name, place) in enumerate(zip(names, places_in_world, strict=True)):
            there = data.oMi[k + 1] * joints[k][0].actInv(place)
            error = np.abs(ours.pose(name, q).homogeneous - there.homogeneous)
            assert error.max() <= 10 * SAME * max(1.0, np.abs(there.translation).max())
    return ours


AXIS = np.array((1.0, 2.0, 3.0))
# Where link b, and the joint that carries it, are said to be: the same place each time.
RELATIVE = {
    "model": lambda a, b, j, f: (pose(b), pose(b.actInv(j))),
    "link": lambda a, b, j, f: (pose(a.actInv(b), "a"), pose(b.actInv(j), "b")),
    "joint": lambda a, b, j, f: (pose(j.actInv(b), "k"), pose(a.actInv(j), "a")),
    "frame": lambda a, b, j, f: (pose(f.actInv(b), "f"), pose(f.actInv(j), "f")),
    "model's own": lambda a, b, j, f: (pose(b, "__model__"), pose(j, "__model__")),
}


@pytest.mark.parametrize("said", RELATIVE.values(), ids=RELATIVE)
def test_poses_are_relative_to_what_they_say(tmp_path, places, said):
    at, a, b, j, f, _ = places
    of_link, of_joint = said(a, b, j, f)
    path = written(
        tmp_path,
        [
            pose(at),
            link("b", of_link),
            joint("k", "a", "b", inside=of_joint),
            link("a", pose(a)),
            joint("i", "world", "a"),
            f'<frame name="f" attached_to="a">{pose(a.actInv(f))}</frame>',
        ],
    )
    in_world = [at * a, at * b]
    joints = [(at * a, AXIS), (at * j, AXIS)]
    ours = assert_same(path, built(in_world, joints), in_world, ["a", "b"], joints)
    frame = ours.pose("f", np.zeros(2))
    assert np.abs(frame.homogeneous - (at * f).homogeneous).max() < 10 * SAME


@pytest.mark.parametrize("frame", ["", "a", "b", "f", "i", "k", "__model__"])
def test_axes_are_of_the_frame_that_they_say(tmp_path, places, frame):
    _, a, b, j, f, _ = places
    given = f' expressed_in="{frame}"' if frame else ""
    path = written(
        tmp_path,
        [
            *(link("a", pose(a)), link("b", pose(b)), joint("i", "world", "a")),
            joint("k", "a", "b", inside=pose(b.actInv(j)), of_axis=given),
            f'<frame name="f">{pose(f)}</frame>',
        ],
    )
    here = {"a": a, "b": b, "f": f, "i": a, "__model__": pin.SE3.Identity()}.get(frame, j)
    joints = [(a, AXIS), (j, j.rotation.T @ here.rotation @ AXIS)]
    assert_same(path, built([a, b], joints), [a, b], ["a", "b"], joints)


@pytest.mark.parametrize(
    ("version", "said", "of_model"),
    [("1.4", "", True), ("1.6", "", False), ("1.6", "1", True), ("1.4", "0", False)],
)
def test_axes_of_old_versions_may_be_the_models(tmp_path, places, version, said, of_model):
    _, a, b, *_ = places
    old = f"<use_parent_model_frame>{said}</use_parent_model_frame>" if said else ""
    hinge = joint("k", "a", "b").replace("</axis>", f"{old}</axis>")
    still = joint("i", "world", "a", kind="fixed")
    path = written(tmp_path, [link("a", pose(a)), link("b", pose(b)), still, hinge], version)
    joints = [(b, b.rotation.T @ AXIS if of_model else AXIS)]
    assert_same(path, built([b], joints), [b], ["b"], joints)


def test_degrees(tmp_path, places):
    turned = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array((1.0, 2.0, 3.0)))
    degrees = " ".join(repr(float(np.rad2deg(x))) for x in (0.1, 0.2, 0.3))
    inside = f'<pose degrees="true">1 2 3 {degrees}</pose>'
    path = written(tmp_path, [link("a", inside), joint("i", "world", "a")])
    joints = [(turned, AXIS)]
    assert_same(path, built([turned], joints), [turned], ["a"], joints)


@pytest.mark.parametrize(("kind", "rows"), [("revolute", 5), ("ball", 3), ("fixed", 6)])
def test_a_link_that_two_joints_carry_closes_a_loop(tmp_path, places, kind, rows):
    """Drawn closed, it is closed at zero; off zero, the gap is that of the joint's two frames."""
    _, a, b, j, *_ = places
    path = written(
        tmp_path,
        [
            *(link("a", pose(a)), link("b", pose(b))),
            *(joint("i", "world", "a"), joint("k", "world", "b")),
            joint("loop", "a", "b", kind=kind, inside=pose(b.actInv(j))),
        ],
    )
    ours = Read(path)
    mechanism = Mechanism(ours.scene)
    on = mechanism.initially_active
    closed = mechanism.closing_terms(np.zeros(2), on)
    assert closed.residual.size == rows
    assert closed.error < SAME * 10
    q = np.array((0.3, -0.2))
    gap = mechanism.closing_terms(q, on).residual[:3]
    ends = [ours.pose(name, q) * place.actInv(j) for name, place in (("a", a), ("b", b))]
    apart = ends[0].translation - ends[1].translation
    assert abs(np.linalg.norm(gap) - np.linalg.norm(apart)) < 10 * SAME
    assert np.linalg.norm(apart) > 0.01
    if kind == "revolute":
        (closure,) = ours.scene.closures
        for name, end in (("a", closure.a), ("b", closure.b)):
            to_link = ours.imported.places[name][1].inverse()
            turned = ours.pose(name, np.zeros(2)) * to_link
            axis = turned.rotation @ pin.rpy.rpyToMatrix(*end.origin.rpy)[:, 2]
            unit = j.rotation @ AXIS / np.linalg.norm(AXIS)
            assert np.abs(axis - unit).max() < 10 * SAME


def test_closures_of_a_scene_file_leave_those_of_the_model_alone(tmp_path, places):
    """Frames of links and joints differ here: moving a closure twice would tear it."""
    _, a, b, j, *_ = places
    still = joint("i", "world", "a", inside=pose(a.actInv(j)))
    moved = joint("k", "world", "b", inside=pose(b.actInv(a)))
    loop = joint("loop", "a", "b", kind="ball", inside=pose(b.actInv(j)))
    path = written(tmp_path, [link("a", pose(a)), link("b", pose(b)), still, moved, loop])
    own = "closures: [{name: own, kind: rod, length: 1.0, a: {link: a}, b: {link: b}}]"
    mechanism = Mechanism(beside(path, own))
    assert mechanism.closing_terms(np.zeros(2), (True, False)).error < 10 * SAME
    gap = mechanism.closing_terms(np.zeros(2), (False, True)).residual
    apart = np.linalg.norm(a.translation - b.translation)
    assert abs(gap[0] - 0.5 * (apart**2 - 1.0)) < 10 * SAME


ACTING = """<joint name="i" type="prismatic"><parent>world</parent><child>a</child><axis>
<xyz>1 0 0</xyz><limit><lower>{}</lower><upper>{}</upper><effort>3</effort></limit><dynamics>
<damping>2</damping><friction>3</friction><spring_stiffness>4</spring_stiffness>
<spring_reference>0.5</spring_reference></dynamics></axis></joint>"""


@pytest.mark.parametrize(
    ("lower", "upper", "stops"),
    [("-1", "2", (-1, 2)), ("-1e16", "1e16", None), ("0", "1e16", (0, 1e15))],
)
def test_what_acts_in_a_joint_is_carried_over(tmp_path, lower, upper, stops):
    ours = Read(written(tmp_path, [link("a"), ACTING.format(lower, upper)]))
    found = ours.written("i")
    assert (found.damping, found.friction, found.stiffness, found.rest) == (2.0, 3.0, 4.0, 0.5)
    assert (found.limits and (found.limits.lower, found.limits.upper)) == stops
    assert ours.notes == {"effort limit": 1}


HINGE = joint("i", "world", "a")
BROKEN = {
    "circle": (
        [
            *(link("a", '<pose relative_to="b">0 0 0 0 0 0</pose>'), HINGE),
            link("b", '<pose relative_to="a">0 0 0 0 0 0</pose>'),
        ],
        "in a circle",
    ),
    "gone": ([link("a", '<pose relative_to="c">0 0 0 0 0 0</pose>'), HINGE], "no such link"),
    "attached": ([link("a"), HINGE, '<frame name="f" attached_to="g"/>'], "no such link"),
    "attached in a circle": (
        [
            *(link("a"), HINGE),
            '<frame name="f" attached_to="g"><pose relative_to="a"/></frame>',
            '<frame name="g" attached_to="f"><pose relative_to="a"/></frame>',
        ],
        "in a circle",
    ),
    "link of a joint": ([link("a"), joint("i", "world", "b")], "no such link"),
    "type": ([link("a"), joint("i", "world", "a", kind="gear")], "type must be one of"),
    "axis": ([link("a"), joint("i", "world", "a", "0 0 0")], "must not be zero"),
    "names": ([link("a"), joint("a", "world", "a")], "must be unique"),
    "quaternion": (
        [link("a", '<pose rotation_format="quat_xyzw">0 0 0 0 0 0 1</pose>'), HINGE],
        "must be euler_rpy",
    ),
    "old frame": ([link("a", '<pose frame="b">0 0 0 0 0 0</pose>'), HINGE], "use relative_to"),
    "numbers": ([link("a", "<pose>0 0 0</pose>"), HINGE], "a pose must be 6"),
    "included": ([link("a"), HINGE, "<include><uri>b</uri></include>"], "no such file"),
    "static": ([link("a"), HINGE, "<static>true</static>"], "does not move"),
    "automatic": (['<link name="a"><inertial auto="true"/></link>', HINGE], "write it"),
    "elsewhere": ([pose(pin.SE3.Identity(), "a"), link("a"), HINGE], "placed by its own"),
    "loop": (
        [
            *(link("a"), joint("i", "world", "a", kind="prismatic")),
            joint("k", "world", "a", kind="prismatic"),
        ],
        "only these types can",
    ),
}


@pytest.mark.parametrize(("parts", "rule"), BROKEN.values(), ids=BROKEN)
def test_errors_name_line_element_and_rule(tmp_path, parts, rule):
    refused(written(tmp_path, parts), rule)


def test_a_model_placed_by_one_of_its_frames_is_refused(tmp_path):
    placed = ' placement_frame="a"'
    refused(written(tmp_path, [link("a"), HINGE], model=placed), "placed by its own")


@pytest.mark.parametrize("models", ["", '<model name="a"/><model name="b"/>'])
def test_one_model_is_read(tmp_path, models):
    refused(saved(tmp_path, "model.sdf", f"<sdf>{models}</sdf>"), "needs one <model>")


def test_rotors_that_drakes_tags_give_are_those_of_joints(tmp_path):
    rotor = "<drake:rotor_inertia>2e-4</drake:rotor_inertia>"
    parts = [
        link("a"),
        joint("j", "world", "a", inside=f"{rotor}<drake:gear_ratio>50</drake:gear_ratio>"),
        link("b"),
        joint("k", "a", "b", inside=rotor),
    ]
    ours = Read(written(tmp_path, parts))
    assert ours.written("j").armature == pytest.approx(2e-4 * 50**2)
    assert ours.written("k").armature == 2e-4
    assert not any("drake" in note for note in ours.notes)


def test_a_rotor_of_a_joint_that_has_none_is_noted(tmp_path):
    rotor = "<drake:rotor_inertia>2e-4</drake:rotor_inertia>"
    ours = Read(written(tmp_path, [link("a"), joint("j", "world", "a", kind="ball", inside=rotor)]))
    assert ours.written("j").armature == 0.0
    assert ours.notes["rotor of no revolute or prismatic joint"] == 1


WORLDS = """<sdf version="1.9"><world name="w"><gravity>0 0 -3</gravity>
<model name="one">{one}</model><model name="two"><pose>0 0 1 0 0 0</pose>{two}</model></world>
</sdf>"""


def world_of_two(folder):
    parts = [link(name) + joint(f"j_{name}", "world", name) for name in ("a", "b")]
    return saved(folder, "world.sdf", WORLDS.format(one=parts[0], two=parts[1]))


def test_one_model_of_several_is_named(tmp_path):
    path = world_of_two(tmp_path)
    (found,) = read_model(path, name="two").document["links"]
    assert (found["name"], found["joint"]["name"]) == ("b", "j_b")
    held = "operational_points: [{name: p, link: a}]"
    loaded = beside(path, held, "{file: world.sdf, name: one}")
    assert [one.name for one in loaded.links] == ["a"]
    assert loaded.gravity == (0.0, 0.0, -3.0)


@pytest.mark.parametrize(
    ("name", "rule"), [("", "names one of"), ("three", "must name one of the models")]
)
def test_without_a_name_of_one_the_models_are_named(tmp_path, name, rule):
    with pytest.raises(SceneError, match=rule) as caught:
        read_model(world_of_two(tmp_path), name=name)
    assert "one, two" in str(caught.value)


def test_other_files_have_one_model(tmp_path):
    path = saved(tmp_path, "model.urdf", '<robot name="r"><link name="a"/></robot>')
    with pytest.raises(SceneError, match="only an SDF file"):
        read_model(path, name="r")
