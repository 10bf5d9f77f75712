# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Trees in URDF are the same to us and to Pinocchio's own reader; what is left out is said."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin
import pytest

from formats.imports import (
    Read,
    counts_in,
    mass_matrix,
    notes_in,
    random_state,
    refused,
    same_dynamics,
    saved,
)
from hapticmech_ros.formats import read_model

# Of the largest entry: rounding of products along a dozen joints, and of angles that are taken out
# of a rotation and put in again.
SAME = 1e-12
TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
ODD = ("left arm", "left_arm", "left-arm", "7th", "Größe", "a.b/c", "A<&>'\"", "left_arm_2", "é")


def xyz(rng, size=1.0):
    return " ".join(repr(float(x)) for x in rng.normal(size=3) * size)


def inertial(rng):
    """Return the inertia of a random cloud of points, so that it is one of a body."""
    points, mass = rng.normal(size=(6, 3)), rng.uniform(0.5, 2.0, size=6)
    centre = mass @ points / mass.sum()
    r = points - centre
    moment = (mass * (r * r).sum(axis=1)).sum() * np.eye(3) - (mass * r.T) @ r
    names = (("ixx", 0, 0), ("ixy", 0, 1), ("ixz", 0, 2), ("iyy", 1, 1), ("iyz", 1, 2))
    written = " ".join(f'{n}="{float(moment[i, j])!r}"' for n, i, j in (*names, ("izz", 2, 2)))
    return (
        f'<inertial><origin xyz="{xyz(rng)}" rpy="{xyz(rng)}"/>'
        f'<mass value="{float(mass.sum())!r}"/><inertia {written}/></inertial>'
    )


def random_urdf(seed, names=None, first=None):
    """Return the text of a random tree, and its moving joints: type, damping, friction, stops."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(5, 12))
    names = [f"l{k}" for k in range(count + 1)] if names is None else names
    parts, joints = [f"<link name={quoteattr(names[0])}/>"], {}
    for k in range(1, len(names)):
        kind = str(rng.choice(TYPES)) if first is None or k > 1 else first
        parent = names[int(rng.integers(0, k))]
        name = f"j {names[k]}"
        damping, friction = (float(x) for x in rng.uniform(0.1, 1.0, size=2))
        lower, upper = sorted(float(x) for x in rng.normal(size=2))
        # Pinocchio's planar joint moves in x and y whatever the file says of its axis.
        axis = "0 0 1" if kind == "planar" else xyz(rng)
        parts.append(f"<link name={quoteattr(names[k])}>{inertial(rng)}</link>")
        parts.append(
            f'<joint name={quoteattr(name)} type="{kind}"><parent link={quoteattr(parent)}/>'
            f'<child link={quoteattr(names[k])}/><origin xyz="{xyz(rng)}" rpy="{xyz(rng, 2.0)}"/>'
            f'<axis xyz="{axis}"/><dynamics damping="{damping!r}" friction="{friction!r}"/>'
            f'<limit lower="{lower!r}" upper="{upper!r}" effort="0" velocity="0"/></joint>'
        )
        if kind != "fixed":
            moving = kind in ("revolute", "continuous", "prismatic")
            stops = (lower, upper) if kind in ("revolute", "prismatic") else None
            joints[name] = (kind, damping, friction if moving else 0.0, stops)
    rng.shuffle(parts)
    text = "".join(parts)
    return f'<?xml version="1.0" encoding="UTF-8"?><robot name="r">{text}</robot>', joints


def written(folder, text):
    return saved(folder, "model.urdf", text)


def assert_same(path, names, free_base=False):
    ours = Read(path, free_base)
    root = (pin.JointModelFreeFlyer(),) if free_base else ()
    theirs = pin.buildModelFromUrdf(str(path), *root)
    if free_base:
        # Pinocchio calls it so; ours is named after the link.
        ours.imported.joints["root_joint"] = ours.scene.links[0].joint.name
    data = theirs.createData()
    for q, at in same_dynamics(ours, theirs, SAME, names):
        pin.framesForwardKinematics(theirs, data, q)
        size = max(np.abs(place.translation).max() for place in data.oMf)
        bodies = [i for i, f in enumerate(theirs.frames) if f.type == pin.FrameType.BODY]
        assert len(bodies) > 1
        for i in bodies:
            error = ours.pose(theirs.frames[i].name, at).homogeneous - data.oMf[i].homogeneous
            assert np.abs(error).max() <= SAME * max(size, 1.0)
    return ours


@pytest.mark.parametrize("seed", range(20))
def test_trees_move_and_weigh_the_same_as_in_pinocchio(tmp_path, seed):
    text, joints = random_urdf(seed, first=TYPES[seed % 3])
    ours = assert_same(written(tmp_path, text), joints)
    for name, (_, damping, friction, stops) in joints.items():
        joint = ours.written(name)
        assert (joint.damping, joint.friction) == (damping, friction)
        limits = joint.limits
        assert (limits and (limits.lower, limits.upper)) == stops


@pytest.mark.parametrize("seed", range(5))
def test_a_free_base_floats_as_pinocchios_does(tmp_path, seed):
    text, joints = random_urdf(100 + seed, first="revolute")
    text = text.replace('<link name="l0"/>', f'<link name="l0">{inertial_of(seed)}</link>')
    ours = assert_same(written(tmp_path, text), ["root_joint", *joints], free_base=True)
    assert ours.scene.links[0].joint.name == ours.imported.joints["l0_base"]
    assert ours.scene.links[0].joint.type == "free"


def inertial_of(seed):
    return inertial(np.random.default_rng(seed))


def test_names_that_scenes_do_not_allow_are_replaced_and_still_found(tmp_path):
    text, joints = random_urdf(3, ["base", *ODD], "revolute")
    ours = assert_same(written(tmp_path, text), joints)
    names = [link.name for link in ours.scene.links]
    names += [link.joint.name for link in ours.scene.links]
    assert len(set(names)) == len(names)
    assert set(ODD) <= set(ours.imported.places)


PLANAR = """<robot name="r"><link name="base"/><link name="a">{inertial}</link>
<joint name="j" type="planar"><parent link="base"/><child link="a"/>
<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/><axis xyz="{axis}"/></joint></robot>"""


@pytest.mark.parametrize("axis", ["0 0 1", "1 0 0", "0 -1 0", "0 0 -1", "0.3 -2 0.5"])
def test_a_planar_joint_moves_across_its_axis(tmp_path, axis):
    """Where the axis is turned to z, it is Pinocchio's planar joint; neutral is the origin."""
    path = written(tmp_path, PLANAR.format(inertial=inertial_of(1), axis=axis))
    ours = Read(path)
    place = pin.SE3(pin.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array((1.0, 2.0, 3.0)))
    assert (
        np.abs(ours.pose("a", pin.neutral(ours.model)).homogeneous - place.homogeneous).max() < SAME
    )
    rng = np.random.default_rng(2)
    q, v = random_state(ours.model, rng)
    normal = place.rotation @ np.array(axis.split(), dtype=float)
    normal /= np.linalg.norm(normal)
    moved = place.actInv(ours.pose("a", q))
    assert abs(normal @ (place.rotation @ moved.translation)) < SAME
    unit = place.rotation.T @ normal
    turn = pin.AngleAxis(np.arctan2(q[3], q[2]), unit).matrix()
    assert np.abs(moved.rotation - turn).max() < SAME
    link, own = ours.imported.places["a"]
    assert link == "a"
    pin.forwardKinematics(ours.model, ours.data, q, v)
    spun = pin.Motion(pin.getVelocity(ours.model, ours.data, 1, pin.WORLD))
    assert np.abs(spun.angular - v[2] * normal).max() < SAME * 10
    body = read_model(path).document["links"][0]["inertial"]
    theirs = pin.buildModelFromUrdf(str(path)).inertias[1].se3Action(own)
    assert np.abs(np.array(body["com"]) - theirs.lever).max() < SAME * 10


NOTED = """<robot name="r"><material name="m"/><gazebo/><transmission/><ros2_control/><odd/>
<link name="base"><visual/><visual/><collision/></link><link name="a"><visual/>{inertial}</link>
<link name="b">{inertial}</link>
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><safety_controller/>
<calibration/><limit lower="0" upper="0" effort="3" velocity="2"/></joint>
<joint name="k" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint>
</robot>"""


def test_what_a_scene_does_not_have_is_noted(tmp_path):
    imported = read_model(written(tmp_path, NOTED.format(inertial=inertial_of(1))))
    assert counts_in(imported) == {
        **dict.fromkeys(("material", "gazebo", "transmission", "ros2_control", "odd"), 1),
        **dict.fromkeys(("collision: nothing", "safety_controller", "calibration"), 1),
        "visual": 3,
        **dict.fromkeys(("effort limit", "velocity limit", "joint j: lower = upper"), 1),
    }
    assert all(note.why and str(note.count) in str(note) for note in notes_in(imported))


ROTORS = """<robot name="r" xmlns:drake="http://drake.mit.edu"><link name="base"/>
<link name="a">{inertial}</link><link name="b">{inertial}</link><link name="c">{inertial}</link>
<joint name="j" type="continuous"><parent link="base"/><child link="a"/></joint>
<joint name="k" type="prismatic"><parent link="a"/><child link="b"/>
<limit lower="-1" upper="1" effort="0" velocity="0"/></joint>
<joint name="f" type="fixed"><parent link="b"/><child link="c"/></joint>
<transmission><joint name="j"/><actuator name="m">
<drake:rotor_inertia value="2e-4"/><drake:gear_ratio value="-50"/></actuator></transmission>
<transmission><joint name="k"/><actuator name="n"><drake:rotor_inertia value="0.3"/></actuator>
</transmission>
<transmission><joint name="f"/><actuator name="o"><drake:rotor_inertia value="1"/></actuator>
</transmission></robot>"""


def test_rotors_that_drakes_tags_give_are_those_of_joints(tmp_path):
    ours = Read(written(tmp_path, ROTORS.format(inertial=inertial_of(1))))
    assert ours.written("j").armature == pytest.approx(2e-4 * 50**2)
    assert ours.written("k").armature == 0.3
    assert ours.notes["rotor of no revolute or prismatic joint"] == 1
    plain = pin.buildModelFromUrdf(str(tmp_path / "model.urdf"))
    q = np.zeros(2)
    full = mass_matrix(plain, plain.createData(), pin.neutral(plain)) + np.diag((0.5, 0.3))
    assert np.abs(ours.inertia(q) - full).max() <= SAME * np.abs(full).max()


IMPLIED = """<robot name="r"><link name="a">{inertial}</link><link name="b">{inertial}</link>
<joint name="j" type="revolute"><parent link="world"/><child link="a"/><origin xyz="0 0 1"/></joint>
<joint name="k" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="2"/></joint></robot>"""


def test_the_world_need_not_be_written_down_nor_a_limit(tmp_path):
    ours = Read(written(tmp_path, IMPLIED.format(inertial=inertial_of(1))))
    assert ours.written("j").limits is None
    assert (ours.written("k").limits.lower, ours.written("k").limits.upper) == (-1.0, 2.0)
    assert ours.notes["limit left out"] == 1
    assert ours.pose("a", np.zeros(2)).translation.tolist() == [0.0, 0.0, 1.0]


def test_a_mimic_is_a_coupling(tmp_path):
    text = NOTED.format(inertial=inertial_of(1))
    mimic = '<mimic joint="j" multiplier="-2" offset="0.5"/><axis xyz="0 1 0"/>'
    path = written(tmp_path, text.replace('<axis xyz="0 1 0"/>', mimic))
    (coupling,) = read_model(path).document["couplings"]
    name = coupling.pop("name")
    assert name == "k_mimics_j"
    assert coupling == {"joint": "k", "leader": "j", "ratio": -2.0, "offset": 0.5}


@pytest.mark.parametrize(
    ("lower", "upper", "stops"),
    [
        ("-1e16", "1e16", None),
        ("-1", "1.7976931348623157e+308", (-1.0, 1e15)),
    ],
)
def test_stops_beyond_reach_are_none(tmp_path, lower, upper, stops):
    text, joints = random_urdf(0, ["base", "a"], "revolute")
    own = joints["j a"][3]
    text = text.replace(
        f'lower="{own[0]!r}" upper="{own[1]!r}"', f'lower="{lower}" upper="{upper}"'
    )
    limits = Read(written(tmp_path, text)).written("j a").limits
    assert (limits and (limits.lower, limits.upper)) == stops


@pytest.mark.parametrize("free", [False, True])
def test_a_world_in_the_file_is_the_world_even_with_a_free_base(tmp_path, free):
    text, _ = random_urdf(0, ["world", "a", "b"], "revolute")
    imported = read_model(written(tmp_path, text), free)
    assert all(link["joint"]["type"] != "free" for link in imported.document["links"])


def test_a_joint_cannot_carry_the_world(tmp_path):
    text, _ = random_urdf(0, ["base", "world"], "revolute")
    refused(written(tmp_path, text), "carries the world")
