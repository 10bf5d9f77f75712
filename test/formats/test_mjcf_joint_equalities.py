# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joint equalities of MJCF: a lock without joint2, with a polynomial a coupling as MuJoCo's."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from formats.imports import refused, saved
from formats.test_locked_joints import assert_turns_as_one_body
from formats.test_mjcf import Theirs
from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.formats.reading import read_model
from hapticmech_ros.operational.analysis import coupling

ARM = """<mujoco model="arm"><compiler angle="radian"/><worldbody>
<body name="upper"><joint name="s" axis="0 0 1"/>
<inertial mass="1" pos="0.15 0 0" diaginertia="0.001 0.0075 0.0075"/>
<body name="fore" pos="0.3 0 0"><joint name="k" {joint}/>
<inertial mass="0.6" pos="0.125 0 0" diaginertia="0.0006 0.0031 0.0031"/></body></body>
</worldbody>{more}</mujoco>"""
HINGE, SLIDE = 'axis="0 0 1" ref="0.2"', 'type="slide" axis="1 0 0" ref="-0.1"'
LOCK = '<equality><joint joint1="k" polycoef="0.3 0.7 0.1 0 0"/></equality>'
KNEE = """<mujoco model="knee"><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
<body name="shank"><joint name="tx" type="slide" axis="1 0 0"/>
<joint name="ty" type="slide" axis="0 1 0"/><joint name="flex" axis="0 0 1"/>
<inertial mass="3" pos="0 -0.2 0" diaginertia="0.04 0.005 0.04"/>
<site name="foot" pos="0 -0.4 0"/></body></worldbody><equality>
<joint name="roll_x" joint1="tx" joint2="flex" polycoef="0 0.02 -0.01 0.002 0"/>
<joint name="roll_y" joint1="ty" joint2="flex" polycoef="0 0.01 0.005 0 0"/></equality></mujoco>"""
CURVES = {
    "knee": KNEE,
    "degree 4 from a hinge to a slide, with ref": ARM.format(
        joint=SLIDE,
        more='<equality><joint joint1="k" joint2="s" polycoef=".1 .2 -.3 .4 -.05"/></equality>',
    ),
    "degree 4 from a slide to a hinge, with ref": ARM.format(
        joint=SLIDE,
        more='<equality><joint joint1="s" joint2="k" polycoef="-.1 2 3 -4 5"/></equality>',
    ),
    "a chain of two": KNEE.replace('joint1="ty" joint2="flex"', 'joint1="ty" joint2="tx"').replace(
        'name="tx"', 'name="tx" ref="0.3"'
    ),
}


def written(folder, text):
    return saved(folder, "model.xml", text)


@pytest.mark.parametrize(("joint", "at"), [(HINGE, 0.5), (SLIDE, 0.2)])
def test_without_joint2_the_joint_is_locked_and_this_is_said_first(tmp_path, joint, at):
    path = written(tmp_path, ARM.format(joint=joint, more=LOCK))
    note = read_model(path).notes[0]
    assert str(note) == f"joint k: an equality without joint2 (1 x): locked at {at:g}"
    theirs = Theirs(path)
    theirs.data.qpos[:] = 0.0, at
    mujoco.mj_forward(theirs.model, theirs.data)
    assert np.abs(theirs.data.efc_pos).max() < 1e-15
    # The file draws the joint at its ref: from there it is 0.3 rad, or m.
    away = (0.725, 0.0) if joint is SLIDE else (0.3 + 0.125 * np.cos(0.3), 0.125 * np.sin(0.3))
    about = assert_turns_as_one_body(path, away, 1e-12)
    assert theirs.inertia()[0, 0] == pytest.approx(about, rel=1e-12)


def test_what_follows_a_locked_joint_is_locked_where_it_holds_it(tmp_path):
    more = """<equality><joint joint1="k" joint2="s" polycoef="0.1 0.5 2 0 0"/>
        <joint joint1="s" polycoef="0.4"/></equality>"""
    text = ARM.format(joint=SLIDE, more=more).replace(
        "</worldbody>",
        '<body name="c"><joint name="free"/><geom size=".1" pos="1 0 0"/></body></worldbody>',
    )
    found = read_model(written(tmp_path, text))
    assert "couplings" not in found.document
    start = found.document["initial_state"]["q"]
    assert start["s"] == pytest.approx(0.4)
    assert start["k"] == pytest.approx(-0.1 + 0.1 + 0.5 * 0.4 + 2.0 * 0.16)
    assert "k: follows a joint that is locked" in str(found.notes[1])
    assert Mechanism(load_scene(str(tmp_path / "model.xml"))).nv == 1


def test_a_keyframe_leaves_a_lock_alone(tmp_path):
    more = LOCK + '<keyframe><key name="bent" qpos="1 2" qvel="3 4"/></keyframe>'
    found = read_model(written(tmp_path, ARM.format(joint=HINGE, more=more)))
    assert found.keyframes["bent"] == ({"s": 1.0}, {"s": 3.0})


@pytest.mark.parametrize(("stops", "said"), [("-1 0.05", False), ("0.1 1", True)])
def test_stops_that_a_curve_never_reaches_are_said(tmp_path, stops, said):
    """tx is at most at 0.016, where flex is at its stop at 2."""
    knee = KNEE.replace('name="tx"', f'name="tx" range="{stops}"')
    knee = knee.replace('name="flex"', 'name="flex" range="0 2"')
    notes = read_model(written(tmp_path, knee)).notes
    assert any("roll_x: stops leave no travel" in note.what for note in notes) == said


@pytest.mark.parametrize("text", CURVES.values(), ids=CURVES)
def test_on_the_curve_everything_is_as_mujoco_has_it(tmp_path, text):
    """Residual, Jacobian and inertia; its own solver lets go of the curve, so no motion."""
    path = written(tmp_path, text)
    scene = load_scene(str(path))
    mechanism = Mechanism(scene)
    on = mechanism.initially_active
    theirs = Theirs(path)
    model, data = theirs.model, theirs.data
    names = list(mechanism.tree.joint_names)
    order = [names.index(model.joint(i).name) for i in range(model.njnt)]
    lead = names.index("flex" if "flex" in names else scene.couplings[0].leader)
    for at in (-0.4, 0.3, 1.1):
        q = np.zeros(mechanism.nq)
        q[lead] = at
        for _ in range(3):  # by their residual, whose slope in the follower is 1
            data.qpos[:] = q[order]
            mujoco.mj_forward(model, data)
            for row, found in enumerate(scene.couplings):
                q[names.index(found.joint)] -= data.efc_pos[row]
        assert np.abs(data.efc_pos).max() < 1e-14
        closing = mechanism.closing_terms(q, on)
        assert np.abs(closing.residual).max() < 1e-14
        rows = data.efc_J.reshape(-1, model.nv)
        ours = closing.jacobian[:, order]
        assert rows.shape == ours.shape == (len(scene.couplings), model.nv)
        assert np.abs(rows - ours).max() < 1e-13
        own = mechanism.evaluate(q, np.zeros(mechanism.nv), on).inertia
        assert np.abs(own[np.ix_(order, order)] - theirs.inertia()).max() < 1e-13


FOOT = """format: hapticmech-scene/1
model: model.xml
operational_points: [{name: foot, link: foot}]
"""


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.7])
def test_a_rolling_knee_is_felt_as_its_curve_says(tmp_path, angle):
    """X at the foot is j jᵀ / (Jᵀ M J), J the slopes along the curve."""
    written(tmp_path, KNEE)
    mechanism = Mechanism(load_scene(saved(tmp_path, "scene.yaml", FOOT)))
    x, y = np.array((0.02, -0.01, 0.002)), np.array((0.01, 0.005, 0.0))
    powers = angle ** np.arange(1, 4)
    q = np.array((x @ powers, y @ powers, angle))
    steps = np.arange(1, 4) * angle ** np.arange(3)
    slope_x, slope_y = x @ steps, y @ steps

    def moves(down):
        """Return the rate of a point below the hinge, at a rate of 1."""
        turned = down * np.cos(angle), down * np.sin(angle)
        return np.array((slope_x + turned[0], slope_y + turned[1]))

    felt = 3.0 * moves(0.2) @ moves(0.2) + 0.04
    along = np.array((*moves(0.4), 0.0, 0.0, 0.0, 1.0))
    found = coupling(mechanism.evaluate(q, np.zeros(3), mechanism.initially_active))[0, 0]
    assert np.abs(found - np.outer(along, along) / felt).max() < 1e-11 / felt


BALL = 'type="ball"'
REFUSED = {
    "a lock of a ball": (BALL, LOCK, "only HINGE and SLIDE joint allowed"),
    "a curve to a ball": (
        BALL,
        '<equality><joint joint1="s" joint2="k" polycoef="0 1 1"/></equality>',
        "hold its body by <weld>",
    ),
    "nobody": (HINGE, LOCK.replace('"k"', '"kk"'), "unknown element 'kk'"),
    "two places": (HINGE, LOCK + LOCK.replace("0.3", "0.4"), "locked at 0.5 already"),
    "a leader of a locked joint": (
        HINGE,
        LOCK.replace("<joint", '<joint joint1="k" joint2="s" polycoef="0 1 1"/><joint'),
        "lock joint2 at its position",
    ),
}


@pytest.mark.parametrize(("joint", "more", "rule"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_is_refused_with_what_to_write_instead(tmp_path, joint, more, rule):
    refused(written(tmp_path, ARM.format(joint=joint, more=more)), rule)


@pytest.mark.parametrize("more", ["", ' joint2="s"'])
def test_an_inactive_one_is_not_read_and_noted(tmp_path, more):
    text = ARM.format(joint=HINGE, more=LOCK.replace("/>", f'{more} active="false"/>'))
    found = read_model(written(tmp_path, text))
    assert "couplings" not in found.document
    assert [note.what for note in found.notes] == ["inactive equality of a joint or tendon"]
    assert Mechanism(load_scene(str(tmp_path / "model.xml"))).nv == 2
