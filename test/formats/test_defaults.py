# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a scene gets by a rule where its model's file is silent: start, stops, friction, metric."""

import numpy as np
import pytest

from formats.imports import beside, mass_matrix, saved
from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.simulation import Simulator

ARM = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.1 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>{dynamics}</joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/>
<origin xyz="0.2 0 0"/><axis xyz="0 0 1"/><limit lower="0.5" upper="2.5" effort="1" velocity="1"/>
</joint>
<joint name="mount" type="fixed"><parent link="lower"/><child link="tool"/>
<origin xyz="0.2 0 0"/></joint></robot>"""


@pytest.fixture
def arm(tmp_path):
    def write(scene="", dynamics=""):
        return beside(saved(tmp_path, "arm.urdf", ARM.format(dynamics=dynamics)), scene)

    return write


def joint(scene, name):
    return next(link.joint for link in scene.links if link.joint.name == name)


def inertia_met(scene, name):
    sim = Simulator(scene.model_copy(update={"closures": ()}))
    model = sim.mechanism.model
    whole = mass_matrix(model, model.createData(), sim.initial_state().q)
    index = sim.mechanism.tree.joint_names.index(name)
    return 1.0 / np.linalg.inv(whole)[index, index]


@pytest.mark.parametrize("period", [1e-3, 2.5e-4])
@pytest.mark.parametrize("name", ["shoulder", "elbow"])
def test_a_stop_swings_three_tenths_of_a_radian_a_step(arm, name, period):
    scene = arm(f"simulation: {{period: {period}}}")
    stop = joint(scene, name).limits
    swing = np.sqrt(stop.stiffness / inertia_met(scene, name)) * period
    assert swing == pytest.approx(0.3, rel=1e-12)
    ratio = stop.damping / (2.0 * np.sqrt(stop.stiffness * inertia_met(scene, name)))
    assert ratio == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("integrator", SCHEMES)
def test_thrown_at_its_stops_it_stays_within_and_loses_energy(arm, integrator):
    scene = arm(
        f"simulation: {{integrator: {integrator}}}\ninitial_state: {{v: {{shoulder: 3.0}}}}"
    )
    sim = Simulator(scene)
    state = sim.initial_state()
    moved = sim.run(state, 4000, None, 10)
    energies = [sum(sim.mechanism.energy(q, v)) for q, v in zip(moved.q, moved.v, strict=True)]
    assert max(energies) <= energies[0] * (1.0 + 1e-3)
    assert energies[-1] < 0.5 * energies[0]
    for name in ("shoulder", "elbow"):
        index = sim.mechanism.tree.joint_names.index(name)
        stop = joint(scene, name).limits
        assert moved.q[:, index].min() > stop.lower - 0.02
        assert moved.q[:, index].max() < stop.upper + 0.02


def test_a_joint_starts_at_the_stop_that_its_zero_is_beyond(arm):
    assert arm().initial_state.q == {"elbow": 0.5}
    assert arm("initial_state: {q: {elbow: 1.0}}").initial_state.q == {"elbow": 1.0}


def test_strong_friction_turns_around_over_more_than_a_step(arm):
    scene = arm(dynamics='<dynamics friction="50" damping="0.1"/>')
    shoulder = joint(scene, "shoulder")
    assert (shoulder.friction, shoulder.damping) == (50.0, 0.1)
    slope = shoulder.friction / shoulder.friction_speed
    assert slope * 1e-3 / inertia_met(scene, "shoulder") == pytest.approx(0.3, rel=1e-12)
    weak = joint(arm(dynamics='<dynamics friction="0.001"/>'), "shoulder")
    assert weak.friction_speed == 0.01


def test_a_tools_frame_is_held_with_the_mechanisms_metric(arm):
    (point,) = arm().operational_points
    assert (point.name, point.link) == ("tip_point", "tool")
    assert point.metric.mass == pytest.approx(3.0)
    assert point.metric.length == pytest.approx(np.sqrt((0.05 + 0.03) / (3.0 * 3.0)))
    held = arm("operational_points: [{name: here, link: lower}]").operational_points[0]
    assert held.metric is None


def test_nobody_pushes_what_nobody_was_told_to_push(arm):
    scene = arm()
    assert scene.hand.kind == "constant_wrench"
    assert scene.hand.force == scene.hand.torque == (0.0, 0.0, 0.0)


TWO_FINGERS = """<mujoco><worldbody><site name="tool_rack"/><body name="arm">
  <joint name="j" axis="0 1 0"/><geom size="0.1"/><site name="{}" pos="0 0 0.2"/>
  <body name="{}" pos="0 0 0.1"><joint name="k" axis="0 1 0"/><geom size="0.1"/>
  <body name="finger" pos="0 0 0.1"><joint name="l" axis="0 1 0"/><geom size="0.1"/></body></body>
  </body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("names", "link", "height"),
    [
        (("attachment_site", "wrist"), "arm", 0.2),
        (("wheel", "Hand"), "Hand", 0.0),
        (("hand", "tool0"), "tool0", 0.0),
        # In a word, or fixed in the world, it is not meant.
        (("stool", "handle"), "finger", 0.0),
    ],
)
def test_what_a_person_would_hold_is_held(tmp_path, names, link, height):
    (tmp_path / "one.xml").write_text(TWO_FINGERS.format(*names), encoding="utf-8")
    (point,) = load_scene(tmp_path / "one.xml").operational_points
    assert (point.name, point.link) == ("tip_point", link)
    assert point.origin.xyz == pytest.approx((0.0, 0.0, height))
