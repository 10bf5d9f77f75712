# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""MJCF is read as MuJoCo reads it: the same inertia, bias forces, poses, constraints."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from formats.imports import Read, beside, counts_in, notes_in, refused, saved
from hapticmech_ros import load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.files.mjcf_compiler import compiled
from hapticmech_ros.formats import mjcf_compiled, read_model
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.operational.analysis import analyse

# Of the largest entry: rounding. MuJoCo keeps inertias as principal moments and quaternions, each
# rounded; angles go through roll, pitch, yaw in ours.
SAME = 1e-11
FREE, BALL_JOINT = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
INERTIAL = '<inertial mass="1.5" pos="0.1 0.2 0.3" diaginertia="1 2 2.5" euler="5 6 7"/>'
BALL = '<geom size="0.1" pos="0.3 0 0.1"/>'

TREES = {
    "nested": f"""<worldbody><body name="a" pos=".1 .2 .3" euler="10 20 30">
        <joint name="j" axis="1 2 3" pos=".1 0 0"/>{INERTIAL}
        <body name="b" pos="0 0 1" axisangle="1 1 0 50"><joint name="k" type="slide" axis="0 1 1"/>
        {BALL}</body></body></worldbody>""",
    "several trees": f"""<worldbody><body name="a" pos="1 0 0"><joint name="j"/>{BALL}</body>
        <body name="b" xyaxes="1 1 0 0 1 1"><joint name="k" axis="0 1 0"/>{BALL}</body></worldbody>
        <worldbody><body name="c" zaxis="0 1 1"><freejoint name="f"/>{INERTIAL}</body>
        </worldbody>""",
    "several joints": f"""<worldbody><body name="a" pos="1 0 0" quat="1 2 3 4">
        <joint name="j" axis="0 1 0" pos="1 2 3"/><joint name="k" type="slide" axis="1 0 0"/>
        <joint name="l" axis="1 0 1" pos=".3 .2 .1"/><joint name="m" type="ball" pos=".1 .1 .1"/>
        {INERTIAL}<body name="b" pos="0 1 0"><joint name="n" axis="1 1 0"/>{BALL}</body></body>
        </worldbody>""",
    "balls": f"""<worldbody><body name="a" pos="1 0 0"><joint name="j" type="ball" pos=".2 .1 0"/>
        {INERTIAL}<body name="b" pos="0 1 0"><joint name="k" type="ball"/>{BALL}</body></body>
        </worldbody>""",
    "free": f"""<worldbody><body name="a" pos="1 2 3" quat="1 2 3 4"><joint type="free" name="j"/>
        {INERTIAL}<body name="b" pos="0 1 0"><joint name="k" axis="1 1 0"/>{BALL}</body></body>
        </worldbody>""",
    "fixed between": f"""<worldbody><body name="still" pos="0 0 1" euler="0 90 0">
        <geom type="mesh" mesh="m"/><body name="a"><joint name="j"/>{BALL}
        <body name="b" pos="0 1 0" euler="0 10 0"><geom size=".2"/>
        <body name="c" pos="1 0 0"><joint name="k" axis="1 0 0"/>{INERTIAL}</body></body></body>
        </body></worldbody>""",
    "no names": f"""<worldbody><body><joint/>{BALL}<body pos="0 1 0"><joint axis="1 0 0"/>
        <joint axis="0 1 0"/>{BALL}</body></body></worldbody>""",
    "angles": f"""<compiler angle="radian" eulerseq="zYx"/><worldbody>
        <body name="a" euler="1 2 3"><joint name="j" range="-1 2"/>{BALL}</body></worldbody>""",
    "fixed axes": f"""<compiler eulerseq="XYZ"/><worldbody>
        <body name="a" euler="10 20 30"><joint name="j" axis="1 1 1"/>{INERTIAL}</body>
        </worldbody>""",
    "compiler twice": f"""<compiler angle="radian"/><compiler eulerseq="ZXZ"/><worldbody>
        <body name="a" euler="1 2 3"><joint name="j" axis="1 1 1"/>{INERTIAL}</body></worldbody>""",
    "classes": """<default><joint damping="1" axis="1 0 0"/><geom size=".2" density="500"/>
        <default class="x"><joint axis="0 1 0" type="slide"/><geom type="box" size=".1 .2 .1"/>
        <default class="y"><joint damping="3"/></default></default></default>
        <default><joint frictionloss=".5"/></default>
        <worldbody><body name="a" childclass="x"><joint name="j"/><geom/>
        <body name="b"><joint name="k" class="y"/><geom class="main"/>
        <body name="c" childclass="main"><joint name="l"/><geom class="x" pos="0 1 0"/></body>
        </body></body></worldbody>""",
    "class of that name": """<default class="main"><geom density="10"/></default><worldbody>
        <body name="a"><joint name="j"/><geom size=".1" pos="1 0 0" class="main"/></body>
        </worldbody>""",
    "frames": """<default><default class="x"><geom density="10"/></default></default>
        <worldbody><frame pos="1 2 3" euler="10 20 30" childclass="x">
        <body name="a" pos="1 0 0"><geom size=".1" pos="1 0 0"/>
        <frame pos="0 1 0" quat="1 1 0 0"><joint name="j" axis="1 1 0" pos="1 0 0"/>
        <geom size=".2"/><site name="s" pos="1 0 0"/></frame></body></frame></worldbody>""",
    "from here to there": """<worldbody><body name="a"><joint name="j" axis="1 0 0"/>
        <geom type="capsule" size=".1" fromto="0 0 0 .3 .2 .1"/>
        <geom type="cylinder" size=".1" fromto=".1 0 0 .3 .2 .1" mass="2"/>
        <geom type="box" size=".1" fromto=".1 0 0 .3 -.2 .1"/>
        <geom type="ellipsoid" size=".1" fromto=".1 0 2 .3 .2 .1"/></body></worldbody>""",
    "shapes": """<worldbody><body name="a"><joint name="j" type="ball"/>
        <geom type="capsule" size=".1 .4" pos="0 0 1"/><geom type="cylinder" size=".1 .3" mass="2"/>
        <geom type="box" size=".1 .2 .3" euler="10 20 30"/><geom mass="0" type="mesh" mesh="m"/>
        <geom type="ellipsoid" size=".1 .2 .3" axisangle="1 1 1 20" density="300"/></body>
        </worldbody>""",
    "groups": """<compiler inertiagrouprange="1 2"/><worldbody><body name="a"><joint name="j"/>
        <geom size=".1" group="1"/><geom size=".3" group="0"/></body></worldbody>""",
    "geoms before what is written": f"""<compiler inertiafromgeom="true"/><worldbody>
        <body name="a"><joint name="j"/>{INERTIAL}{BALL}</body></worldbody>""",
    "full inertia": """<compiler inertiafromgeom="false"/><worldbody><body name="a">
        <joint name="j" type="ball"/><geom size=".1"/>
        <inertial mass="1" pos=".1 .2 .3" fullinertia="1 2 2.5 .1 .2 .3"/></body></worldbody>""",
    "bounds": f"""<compiler boundmass="10" boundinertia="1.7"/><worldbody><body name="a">
        <joint name="j" type="ball"/>{INERTIAL}</body></worldbody>""",
    "balance": """<compiler balanceinertia="true"/><worldbody><body name="a"><joint name="j"/>
        <inertial mass="1" pos="0 0 1" diaginertia="1 1 5"/></body></worldbody>""",
    "ref": """<worldbody><body name="a" pos="1 0 0"><joint name="j" ref="30" axis="0 1 0"/>
        <geom size=".1" pos="1 0 0"/><body name="b" pos="1 0 0" euler="10 20 30">
        <joint name="k" type="slide" ref=".3" axis="0 1 1"/>
        <joint name="l" ref="-20" axis="1 0 1" pos=".1 .2 .3"/>
        <geom size=".1" pos="1 0 0"/></body></body></worldbody>""",
    "no gravity": f"""<option gravity="1 2 3"><flag gravity="disable"/></option><worldbody>
        <body name="a"><joint name="j" axis="0 1 0"/>{BALL}</body></worldbody>""",
    "gravity": f"""<option gravity="1 2 3"/><worldbody>
        <body name="a"><joint name="j" axis="0 1 0"/>{BALL}</body></worldbody>""",
    "mesh": """<worldbody><body name="a"><joint name="j" axis="0 1 0"/>
        <geom type="mesh" mesh="m" pos="1 2 3" euler="10 20 30"/><geom size=".1"/></body>
        <body name="b"><joint name="k"/><geom type="mesh" mesh="m" mass="2"/></body></worldbody>""",
    "mesh without a name": f"""<worldbody><body><joint name="j"/>{BALL}
        <body><joint name="k" axis="1 0 0"/><geom type="mesh" mesh="m" density="10"/></body></body>
        </worldbody>""",
    "total mass": f"""<compiler settotalmass="14"/><worldbody><geom size=".3"/>
        <body name="still"><geom size=".2"/></body><body name="a"><joint name="j" axis="0 1 0"/>
        {BALL}<geom size=".1 .2 .3" type="box" pos="1 0 0"/></body></worldbody>""",
    "total mass with a mesh": f"""<compiler settotalmass="14"/><worldbody><body name="a">
        <joint name="j" axis="0 1 0"/>{BALL}</body><body name="still">
        <geom type="mesh" mesh="m"/></body></worldbody>""",
    "shell": """<worldbody><body name="a"><joint name="j" axis="0 1 0"/>
        <geom type="box" size=".1 .2 .3" pos="1 0 0" shellinertia="true"/></body></worldbody>""",
    "replicas": f"""<compiler eulerseq="XYZ"/><default><default class="x"><geom size=".2"/>
        </default></default><worldbody><frame pos="1 2 3" euler="10 20 30">
        <replicate count="3" offset="0 1 .2" euler="5 10 30" sep="_" childclass="x">
        <body name="a" pos="1 0 0"><joint name="j" axis="0 1 1"/><geom pos=".1 0 0"/>
        <replicate count="2" offset=".3 0 0" euler="0 40 0"><body name="b" pos="0 0 1">
        <joint name="k" axis="1 0 0"/>{BALL}</body></replicate></body></replicate></frame>
        </worldbody>""",
    "replicated geoms": """<worldbody><body name="a"><joint name="j" axis="0 1 0"/>
        <replicate count="10" offset=".1 0 0" euler="0 0 20"><geom name="g" size=".05 .02 .01"
        type="box" pos=".3 0 .1"/></replicate></body></worldbody>""",
    "any order": f"""<worldbody><body name="a"><body name="b" pos="0 0 1">{BALL}
        <joint name="k" axis="1 0 0"/></body>{BALL}<joint name="j"/></body></worldbody>""",
}
# A tetrahedron, for geoms whose inertia does not count.
MESH = '<asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>'


def written(folder, text):
    return saved(folder, "model.xml", f'<mujoco model="m">{MESH}\n{text}</mujoco>')


class Theirs:
    """MuJoCo's reading of a file, at our coordinates."""

    def __init__(self, path):
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)

    def state(self, ours, rng, at=None):
        """Return our (q, v) at a random state, with theirs set to it; and dv_theirs/dv_ours."""
        model = self.model
        self.data.qpos[:] = model.qpos0 if at is None else at
        mujoco.mj_integratePos(model, self.data.qpos, rng.normal(size=model.nv), 1.0)
        q, turn = np.zeros(model.nq), np.eye(model.nv)
        for joint in range(model.njnt):
            a, d = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
            one = self.number(ours, joint)
            assert (ours.model.joints[one].idx_q, ours.model.joints[one].idx_v) == (a, d)
            kind = model.jnt_type[joint]
            if kind == FREE:
                q[a : a + 3] = self.data.qpos[a : a + 3]
                a += 3
            if kind in (FREE, BALL_JOINT):
                w, x, y, z = self.data.qpos[a : a + 4]
                q[a : a + 4] = (x, y, z, w)
                if kind == FREE:
                    turn[d : d + 3, d : d + 3] = pin.Quaternion(w, x, y, z).matrix()
            else:
                q[a] = self.data.qpos[a]
        v = rng.normal(size=model.nv)
        self.data.qvel[:] = turn @ v
        mujoco.mj_forward(model, self.data)
        return q, v, turn

    def has_bodies_where(self, ours, q, error):
        """Assert that bodies are where ours are at q."""
        for body in range(1, self.model.nbody):
            pose = ours.pose(self.model.body(body).name or f"body{body}", q)
            assert np.abs(pose.translation - self.data.xpos[body]).max() <= error
            assert np.abs(pose.rotation - self.data.xmat[body].reshape(3, 3)).max() <= error

    def number(self, ours, joint):
        name = self.model.joint(joint).name
        return ours.joint(name) if name else joint + 1

    def inertia(self):
        full = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, full)
        return full


@pytest.mark.parametrize("text", TREES.values(), ids=TREES)
def test_trees_move_and_weigh_the_same_as_in_mujoco(tmp_path, text):
    assert_as_mujoco_has_it(written(tmp_path, text))


def assert_as_mujoco_has_it(path, poses=10 * SAME, least=1.0):
    """Compare inertia, bias forces and poses at three states; return ours and theirs.

    Args:
        path: of the file.
        poses: error of these.
        least: share of the largest inertia that bias forces are held against, if they are less.
    """
    ours, theirs = Read(path), Theirs(path)
    assert ours.model.nv == theirs.model.nv
    rng = np.random.default_rng(1)
    for _ in range(3):
        q, v, turn = theirs.state(ours, rng)
        inertia = turn.T @ theirs.inertia() @ turn
        assert np.abs(ours.inertia(q) - inertia).max() <= SAME * np.abs(inertia).max()
        # Rates of a free joint are along axes of the world in theirs: T' v is more to bear.
        moved = np.zeros(ours.model.nv)
        for joint in range(theirs.model.njnt):
            if theirs.model.jnt_type[joint] == FREE:
                d = theirs.model.jnt_dofadr[joint]
                moved[d : d + 3] = turn[d : d + 3, d : d + 3] @ np.cross(
                    v[d + 3 : d + 6], v[d : d + 3]
                )
        bias = turn.T @ (theirs.data.qfrc_bias + theirs.inertia() @ moved)
        size = max(np.abs(bias).max(), least * np.abs(inertia).max())
        assert np.abs(ours.bias(q, v) - bias).max() <= SAME * size
        theirs.has_bodies_where(ours, q, poses)
        for site in range(theirs.model.nsite):
            pose = ours.pose(theirs.model.site(site).name, q)
            assert np.abs(pose.translation - theirs.data.site_xpos[site]).max() <= poses
    return ours, theirs


@pytest.mark.parametrize("name", ["ref", "free", "nested"])
def test_a_scene_starts_where_the_file_draws_it(tmp_path, name):
    path = written(tmp_path, TREES[name])
    theirs, scene = Theirs(path), load_scene(path)
    mujoco.mj_forward(theirs.model, theirs.data)
    q, _ = authored_state(scene, Mechanism(scene).tree)
    theirs.has_bodies_where(Read(path), q, SAME)


def test_a_scene_file_may_start_elsewhere_in_part(tmp_path):
    scene = beside(written(tmp_path, TREES["ref"]), "initial_state: {q: {k: 0.1}, v: {l: 2.0}}")
    q, v = authored_state(scene, Mechanism(scene).tree)
    assert q == pytest.approx([np.deg2rad(30), 0.1, np.deg2rad(-20)], rel=SAME)
    assert v.tolist() == [0.0, 0.0, 2.0]


ACTING = """<compiler autolimits="true"/><worldbody><body name="a"><joint name="j" stiffness="3"
    springref="30" damping="2" frictionloss=".3" range="-40 50" ref="10" axis="0 1 0"/>{ball}
    <body name="b"><joint name="k" type="slide" stiffness="2" springref=".4" range="-.1 .2"
    limited="true" ref=".05"/>{ball}<body name="c"><joint name="l" limited="false" range="0 1"
    springdamper=".5 .7"/>
    {ball}</body></body></body></worldbody>"""


def test_what_acts_in_joints_is_what_mujoco_has_act(tmp_path):
    """Spring and damper against their qfrc; stops and friction against their model."""
    path = written(tmp_path, ACTING.format(ball=BALL))
    ours, theirs = Read(path), Theirs(path)
    q, v, _ = theirs.state(ours, np.random.default_rng(3))
    for name in ("j", "k", "l"):
        joint, theirs_joint = ours.written(name), theirs.model.joint(name)
        at, rate = q[theirs_joint.qposadr[0]], v[theirs_joint.dofadr[0]]
        force = -joint.stiffness * (at - joint.rest) - joint.damping * rate
        passive = theirs.data.qfrc_passive[theirs_joint.dofadr[0]]
        assert abs(force - passive) <= SAME * max(abs(passive), 1.0)
        assert joint.friction == theirs.model.dof_frictionloss[theirs_joint.dofadr[0]]
        stops = tuple(theirs_joint.range) if theirs_joint.limited[0] else None
        if stops is None:
            assert joint.limits is None
        else:
            found = (joint.limits.lower, joint.limits.upper)
            assert found == pytest.approx(stops, rel=SAME)


LOOPS = """<default><equality active="true"/></default><worldbody>
    <body name="a" pos="0 0 1" euler="10 20 30"><joint name="j1" axis="1 2 3" ref="20"/>{inertial}
    <site name="s" pos=".1 .2 .3" euler="30 20 10"/><body name="b" pos=".5 0 0" quat="1 2 3 4">
    <joint name="j2" type="ball" pos="0 .1 0"/>{inertial}</body></body>
    <body name="c" pos="1 1 0" euler="5 6 7"><freejoint name="j3"/>{inertial}
    <site name="t" pos=".3 .2 .1" zaxis="1 1 1"/></body></worldbody>
    <equality>{equality}</equality>"""
EQUALITIES = {
    "connect bodies": '<connect body1="b" body2="c" anchor=".1 .2 .3"/>',
    "connect to the world": '<connect body1="c" anchor=".1 .2 .3"/>',
    "connect sites": '<connect site1="s" site2="t"/>',
    "weld bodies": '<weld body1="b" body2="c"/>',
    "weld to the world": '<weld body1="b"/>',
    "weld with relpose": '<weld body1="b" body2="c" relpose=".1 .2 .3 1 2 3 4"/>',
    "weld with relpose and anchor": (
        '<weld body1="b" body2="c" relpose=".1 .2 .3 1 2 3 4" anchor=".3 .1 -.2"/>'
    ),
    "weld with anchor": '<weld body1="b" body2="c" anchor=".3 .1 -.2"/>',
    "weld without turn": '<weld body1="b" body2="c" relpose=".1 .2 .3 0 0 0 0"/>',
    "weld sites": '<weld site1="s" site2="t"/>',
}


@pytest.mark.parametrize("equality", EQUALITIES.values(), ids=EQUALITIES)
def test_loops_close_where_mujocos_do(tmp_path, equality):
    """Rates that one allows, the other allows; both are met at the same places."""
    path = written(tmp_path, LOOPS.format(inertial=INERTIAL, equality=equality))
    ours, theirs = Read(path), Theirs(path)
    mechanism = Mechanism(ours.scene)
    rng = np.random.default_rng(4)
    on = mechanism.initially_active
    q, _, turn = theirs.state(ours, rng)
    # From there to a place where their loop is closed, by their rows.
    for _ in range(60):
        mujoco.mj_forward(theirs.model, theirs.data)
        rows = theirs.data.efc_J.reshape(-1, theirs.model.nv)
        step = -np.linalg.lstsq(rows, theirs.data.efc_pos, rcond=None)[0]
        step *= 0.5 / max(0.5, np.abs(step).max())
        mujoco.mj_integratePos(theirs.model, theirs.data.qpos, step, 1.0)
    mujoco.mj_forward(theirs.model, theirs.data)
    assert np.abs(theirs.data.efc_pos).max() < 1e-13
    q, turn = q_of(theirs, ours)
    closing = mechanism.closing_terms(q, on)
    assert np.abs(closing.residual).max() < SAME
    rows = theirs.data.efc_J.reshape(-1, theirs.model.nv) @ turn
    assert closing.jacobian.shape == rows.shape
    # The same row space: theirs of a turn are half as large, and along other axes.
    _, sigma, across = np.linalg.svd(closing.jacobian)
    rank = int((sigma > 1e-9 * sigma[0]).sum())
    left = rows @ across[rank:].T
    assert np.linalg.matrix_rank(rows, tol=1e-9) == rank > 0
    assert np.abs(left).max(initial=0.0) < SAME * np.abs(rows).max() * 10


def q_of(theirs, ours):
    """Return our q where they are, and dv_theirs/dv_ours."""

    class Still:
        def normal(self, size):
            return np.zeros(size)

    q, _, turn = theirs.state(ours, Still(), theirs.data.qpos.copy())
    return q, turn


def test_an_inactive_equality_waits(tmp_path):
    text = LOOPS.format(inertial=INERTIAL, equality='<weld body1="b" active="false" name="w"/>')
    (closure,) = Read(written(tmp_path, text)).scene.closures
    assert (closure.name, closure.active) == ("w", False)


TENDON = """<tendon><fixed name="t"><joint joint="j" coef=".4"/><joint joint="k" coef="-.6"/>
    </fixed></tendon>"""


@pytest.mark.parametrize("leader", [-0.3, 0.0, 0.7])
@pytest.mark.parametrize(
    ("equality", "more"),
    [
        ('<joint joint1="j" joint2="k" polycoef=".2 -1.5"/>', ""),
        ('<tendon tendon1="t"/>', TENDON),
        ('<tendon tendon1="t" polycoef=".1"/>', TENDON),
    ],
    ids=["joint", "tendon", "tendon, longer"],
)
def test_an_equality_is_a_coupling_where_mujoco_meets_it(tmp_path, equality, more, leader):
    path = written(tmp_path, TREES["ref"] + more + f"<equality>{equality}</equality>")
    (coupling,) = read_model(path).document["couplings"]
    theirs = Theirs(path)
    j, k = (theirs.model.joint(name).qposadr[0] for name in ("j", "k"))
    theirs.data.qpos[k] = leader
    theirs.data.qpos[j] = coupling["ratio"] * leader + coupling["offset"]
    mujoco.mj_forward(theirs.model, theirs.data)
    assert np.abs(theirs.data.efc_pos).max() < SAME


NOTED = f"""<option wind="1 0 0"><flag contact="disable"/></option><actuator><motor joint="j"/>
    </actuator><sensor><jointpos joint="j"/></sensor><keyframe><key/><key/></keyframe>
    <contact><exclude body1="a" body2="b"/></contact><custom/><worldbody><light/><camera/>
    <geom size="1"/><body name="m" mocap="true"/><body name="a" gravcomp="1">{BALL}
    <joint name="j" springdamper="1 1"/>
    <body name="b">{BALL}<joint type="ball" range="0 1" stiffness="1" frictionloss="1"/></body>
    </body><body name="c" pos="0 0 1">{BALL}<freejoint align="true"/></body>
    <body name="d" pos="0 0 2">{BALL}<joint name="f" type="free" armature=".1"/></body></worldbody>
    <tendon><fixed name="t" armature="1"><joint joint="j" coef="1"/></fixed></tendon>
    <actuator><motor tendon="t" armature="1"/></actuator><equality>
    <connect body1="a" anchor="0 0 0" solref=".1 1"/></equality>"""


def test_what_a_scene_does_not_have_is_noted(tmp_path):
    imported = read_model(written(tmp_path, NOTED))
    assert counts_in(imported) == {
        **dict.fromkeys(("sensor", "contact", "custom", "light", "camera", "tendon"), 1),
        **dict.fromkeys(("mocap", "align", "fluid"), 1),
        **dict.fromkeys(("armature of a free joint", "armature of a tendon"), 1),
        "armature of an actuator on no hinge or slide": 1,
        "actuator": 2,
        **dict.fromkeys(("flag", "range of a ball", "solref or solimp of an equality"), 1),
        "stiffness of a ball or free joint": 1,
        "frictionloss of a ball or free joint": 1,
        "geom that collides": 5,
    }
    assert all(note.why for note in notes_in(imported))
    # What may change what is felt comes first.
    assert {note.what for note in imported.notes[-3:]} == {"sensor", "light", "camera"}


KEYS = f"""<worldbody><body name="f" pos="1 0 0"><freejoint/>{INERTIAL}</body>
    <body name="a"><joint name="j" axis="0 1 0" ref="20"/>{{ball}}
    <body name="b" pos=".3 0 0"><joint name="k" type="ball"/>{{ball}}
    <body name="c" pos=".2 0 0"><joint name="l" type="slide" axis="1 1 0"/>{INERTIAL}</body></body>
    </body></worldbody><keyframe>
    <key name="home" qpos="1 2 3 .5 -.5 .5 .5 .1 2 0 0 1 .05"
        qvel="1 2 3 4 5 6 .1 .2 .3 .4 .5"/>
    <key qvel="0 0 0 0 0 0 0 0 0 0 7"/></keyframe>"""


def scene_at(folder, state):
    """Return a scene of the model that starts as it is told."""
    said = "gravity: [0, 0, 0]\noperational_points: [{name: p, link: c}]\n"
    return beside(written(folder, KEYS.format(ball=BALL)), f"{said}initial_state: {state}")


@pytest.mark.parametrize(("name", "number"), [("home", 0), ("'1'", 1)])
def test_a_scene_starts_at_a_keyframe_as_mujoco_does(tmp_path, name, number):
    scene = scene_at(tmp_path, f"{{keyframe: {name}}}")
    theirs = Theirs(tmp_path / "model.xml")
    mujoco.mj_resetDataKeyframe(theirs.model, theirs.data, number)
    mujoco.mj_forward(theirs.model, theirs.data)
    mechanism = Mechanism(scene)
    q, v = authored_state(scene, mechanism.tree)
    theirs.has_bodies_where(Read(tmp_path / "model.xml"), q, SAME * 10)
    # The same motion: its energy, and the twist of the last body.
    full = theirs.inertia()
    kinetic = 0.5 * theirs.data.qvel @ full @ theirs.data.qvel
    assert mechanism.energy(q, v)[0] == pytest.approx(kinetic, rel=1e-11)
    twist = mechanism.evaluate(q, v, mechanism.initially_active).points[0].twist
    jacobian = np.zeros((6, theirs.model.nv))
    last = theirs.model.body("c").id
    mujoco.mj_jacBody(theirs.model, theirs.data, jacobian[:3], jacobian[3:], last)
    assert np.abs(twist - jacobian @ theirs.data.qvel).max() <= SAME * 100


def test_what_a_scene_says_goes_before_its_keyframe(tmp_path):
    scene = scene_at(tmp_path, "{keyframe: home, q: {l: 0.5}, v: {j: 9.0}}")
    assert (scene.initial_state.q["l"], scene.initial_state.v["j"]) == (0.5, 9.0)
    assert scene.initial_state.q["j"] == 0.1


@pytest.mark.parametrize("name", ["away", 1, "[home]"])
def test_an_unknown_keyframe_is_refused(tmp_path, name):
    with pytest.raises(SceneError, match=r"initial_state.keyframe.*'1', 'home'"):
        scene_at(tmp_path, f"{{keyframe: {name}}}")


ROTORS = f"""<default><joint armature=".1"/><position armature=".2" gear="3"/>
    <default class="x"><general armature=".4"/></default></default><worldbody>
    <body name="a"><joint name="j" axis="0 1 0"/>{{ball}}
    <body name="b" pos=".3 0 0"><joint name="k" type="slide" axis="1 1 0" armature=".7"/>{{ball}}
    <body name="c" pos=".2 0 0"><joint name="l" type="ball" armature=".03"/>{INERTIAL}
    <body name="d" pos="0 .2 0"><joint name="m" axis="1 0 0" armature="0"/>{{ball}}
    <site name="tip" pos=".1 .2 0"/></body></body></body></body></worldbody>
    <actuator><motor joint="j"/><motor jointinparent="k" class="x" gear="2"/>
    <position joint="k" armature="0"/><velocity joint="j" gear="-.5 9"/></actuator>"""


def test_rotors_of_joints_and_actuators_are_felt_as_in_mujoco(tmp_path):
    path = written(tmp_path, ROTORS.format(ball=BALL))
    ours, theirs = Read(path), Theirs(path)
    assert not any("armature" in note for note in ours.notes)
    assert [ours.written(name).armature for name in "jklm"] == pytest.approx(
        [0.1 + 0.2 * 9 + 0.2 * 0.25, 0.7 + 0.4 * 4, 0.03, 0.0]
    )
    mechanism = Mechanism(beside(path, "operational_points: [{name: tip, link: tip}]"))
    rng = np.random.default_rng(4)
    for _ in range(3):
        q, v, _ = theirs.state(ours, rng)
        full = theirs.inertia()
        assert np.abs(ours.inertia(q) - full).max() <= SAME * np.abs(full).max()
        assert np.abs(ours.bias(q, v) - theirs.data.qfrc_bias).max() <= SAME * np.abs(full).max()
        jacobian = np.zeros((6, theirs.model.nv))
        mujoco.mj_jacSite(theirs.model, theirs.data, jacobian[:3], jacobian[3:], 0)
        inverse = jacobian @ np.linalg.solve(full, jacobian.T)
        found = analyse(mechanism, q, "tip").inverse_inertia
        assert np.abs(found - inverse).max() <= 100 * SAME * np.abs(inverse).max()
        assert mechanism.energy(q, v)[0] == pytest.approx(0.5 * v @ full @ v, rel=1e-13)


BROKEN = {
    "include": ('<include file="x.xml"/><worldbody/>', "no such file in"),
    "key's size": (
        '<worldbody><body><joint/><geom size="1"/></body></worldbody>'
        '<keyframe><key qpos="1 2"/></keyframe>',
        "invalid qpos size, expected 1, got 2",
    ),
    "keys twice": (
        '<worldbody><body><joint/><geom size="1"/></body></worldbody>'
        '<keyframe><key name="x"/><key name="x"/></keyframe>',
        "repeated name 'x' in key",
    ),
    "replicate": ("<worldbody><replicate/></worldbody>", "attribute missing: 'count'"),
    "composite": ('<worldbody><body><composite type="cable"/></body></worldbody>', "written out"),
    "type": (
        '<worldbody><body><joint type="screw"/></body></worldbody>',
        "invalid keyword: 'screw'",
    ),
    "axis": ('<worldbody><body><joint axis="0 0 0"/></body></worldbody>', "axis too small"),
    "quat": ('<worldbody><body quat="0 0 0 0"><joint/></body></worldbody>', "zero quaternion"),
    "zaxis": ('<worldbody><body zaxis="0 0 0"/></worldbody>', "zaxis too small"),
    "xyaxes": (
        '<worldbody><body xyaxes="1 0 0 2 0 0"/></worldbody>',
        "yaxis too small",
    ),
    "two turns": (
        '<worldbody><body zaxis="0 0 1" euler="1 2 3"/></worldbody>',
        "multiple orientation",
    ),
    "sequence": (
        '<compiler eulerseq="xyw"/><worldbody><body euler="1 2 3"/></worldbody>',
        "euler sequence can only",
    ),
    "mesh": (
        '<worldbody><body><joint/><geom type="mesh" mesh="gone"/></body></worldbody>',
        "give the body an <inertial>",
    ),
    "size": (
        '<worldbody><body><joint/><geom type="box" size="1"/></body></worldbody>',
        "size 1 must be positive",
    ),
    "fromto": (
        '<worldbody><body><joint/><geom type="box" size="1" fromto="0 0 0 0 0 0"/></body>'
        "</worldbody>",
        "points too close",
    ),
    "density": ('<worldbody><body><joint/><geom size="1" density="-1"/></body></worldbody>', "neg"),
    "pos": (
        '<worldbody><body><joint/><inertial mass="1" diaginertia="1 1 1"/></body></worldbody>',
        "attribute missing: 'pos'",
    ),
    "class": (
        '<worldbody><body><joint class="gone"/></body></worldbody>',
        "unknown default class name 'gone'",
    ),
    "classes": (
        '<default><default class="a"/><default class="a"/></default><worldbody/>',
        "repeated default class",
    ),
    "bodies": ('<worldbody><body name="a"/><body name="a"/></worldbody>', "repeated name 'a'"),
    "world": ('<worldbody><body name="world"/></worldbody>', "repeated name 'world'"),
    "joints": (
        '<worldbody><body><joint name="a"/><joint name="a"/></body></worldbody>',
        "repeated name 'a' in joint",
    ),
    "balls": (
        '<worldbody><body><joint name="a" type="ball"/><joint name="a"/></body></worldbody>',
        "repeated name 'a' in joint",
    ),
    "free joints": (
        '<worldbody><body><freejoint name="a"/></body><body><freejoint name="a"/></body>'
        "</worldbody>",
        "repeated name 'a' in joint",
    ),
    "world joint": ("<worldbody><joint/></worldbody>", "World body cannot have joints"),
    "free": ("<worldbody><body><freejoint/><joint/></body></worldbody>", "more than 6 dofs"),
    "free within": (
        "<worldbody><body><joint/><body><freejoint/></body></body></worldbody>",
        "free joint can only be used on top level",
    ),
    "range": (
        '<worldbody><body><joint range="2 1"/></body></worldbody>',
        "range[0] must not be above range[1]",
    ),
    "autolimits": (
        '<compiler autolimits="false"/><worldbody><body><joint range="1 2"/></body></worldbody>',
        "has `range` but not `limited`",
    ),
    "polycoef": (
        '<worldbody><body><joint name="j"/></body></worldbody><equality>'
        '<joint joint1="j" joint2="j" polycoef="0 1 2 3 4 5"/></equality>',
        "polycoef",
    ),
    "equality": ("<worldbody/><equality><flex/></equality>", "attribute missing: 'flex'"),
    "long tendon": (
        '<worldbody><body><joint name="j"/></body></worldbody><tendon><fixed name="t">'
        '<joint joint="j" coef="1"/></fixed></tendon><equality><tendon tendon1="t"/></equality>',
        "a fixed tendon of two joints",
    ),
    "site": ('<worldbody/><equality><weld site1="a" site2="b"/></equality>', "unknown element 'a'"),
    "one site": (
        '<worldbody/><equality><weld site1="a"/></equality>',
        "one of ('site1', 'site2'), 'body1' must",
    ),
    "body": ('<worldbody/><equality><weld body1="a"/></equality>', "unknown element 'a'"),
    "global": (
        '<compiler coordinate="global"/><worldbody/>',
        "global coordinates no longer",
    ),
}


def test_a_file_without_joints_is_told_how_bodies_move_in_it(tmp_path):
    path = written(tmp_path, '<worldbody><body><geom size="1"/></body></worldbody>')
    with pytest.raises(SceneError, match=r"no joint moves: a <freejoint/> makes a body float"):
        read_model(path)


@pytest.mark.parametrize(("text", "rule"), BROKEN.values(), ids=BROKEN)
def test_errors_name_line_element_and_rule(tmp_path, text, rule):
    where = refused(written(tmp_path, text), rule)
    # MuJoCo has no lines of keys.
    assert where.startswith("line 1, <mujoco>" if "qpos" in rule else "line 2, <")


def test_without_mujoco_a_file_is_refused_with_the_line_that_installs_it(tmp_path, monkeypatch):
    path = written(tmp_path, TREES["nested"])
    monkeypatch.setattr(mjcf_compiled, "find_spec", lambda name: None)
    with pytest.raises(SceneError, match=r"not installed: pip install 'hapticmech_ros\[mjcf\]'"):
        load_scene(path)


MISSING = """<asset><texture name="t" type="2d" file="gone.png"/><material name="s" texture="t"/>
    <hfield name="h" file="gone.png" size="1 1 1 1"/><mesh name="g" file="gone.stl"/></asset>
    <worldbody><geom type="hfield" hfield="h"/><geom type="mesh" mesh="g"/><body name="a">
    <joint name="j"/>{}<geom type="mesh" mesh="g" material="s"/></body></worldbody>"""


def test_files_that_are_missing_are_asked_for_where_an_inertia_comes_from_them(tmp_path):
    assert Read(written(tmp_path, MISSING.format(INERTIAL))).model.nv == 1
    with pytest.raises(SceneError, match=r"line 5, <geom>: .*gone\.stl.*give the body an"):
        load_scene(written(tmp_path, MISSING.format(BALL)))


def test_warnings_of_mujoco_leave_no_file(tmp_path, monkeypatch):
    text = '<mujoco><worldbody><body pos="nan 0 0"><joint/>{}</body></worldbody></mujoco>'
    monkeypatch.chdir(tmp_path)
    said = compiled({"text": text.format(BALL), "folder": str(tmp_path)})
    assert said["elements"]["joint"] == [["", 1, "hinge"]]
    assert not list(tmp_path.iterdir())


UNUSUAL = {
    "mass": '<body><joint/><geom size="1"/><body name="a"><joint/>{}</body></body>',
    "number": '<body name="a" pos="nan 0 0"><joint/>{}<geom size="1"/></body>',
    "size": '<body name="a" pos="1e31 0 0"><joint/>{}<geom size="1"/></body>',
}


@pytest.mark.parametrize("inside", ["", '<inertial mass="0" pos="0 0 0" diaginertia="0 0 0"/>'])
def test_a_body_without_mass_is_one(tmp_path, inside):
    imported = read_model(
        written(tmp_path, f"<worldbody>{UNUSUAL['mass']}</worldbody>".format(inside))
    )
    inertial = imported.document["links"][1]["inertial"]
    assert inertial["mass"] == 0.0
    assert not any(inertial["inertia"].values())


@pytest.mark.parametrize("name", ["number", "size"])
def test_numbers_that_mujoco_takes_and_a_scene_does_not_are_named(tmp_path, name):
    with pytest.raises(SceneError, match=r"line 2, <body>: pos must be finite, and not above"):
        read_model(written(tmp_path, f"<worldbody>{UNUSUAL[name]}</worldbody>".format("")))


@pytest.mark.parametrize("attribute", ['range="30 30"', 'range="30 30" limited="true"'])
def test_a_joint_whose_stops_leave_no_travel_is_locked_there(tmp_path, attribute):
    text = f'<worldbody><body><joint name="j" {attribute}/>{BALL}<body><joint/>{BALL}</body></body>'
    note = read_model(written(tmp_path, f"{text}</worldbody>")).notes[0]
    assert str(note) == f"joint j: lower = upper (1 x): locked at {np.deg2rad(30):g}"
