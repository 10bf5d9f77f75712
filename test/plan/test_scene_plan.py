# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a scene says what runs: it follows the scene, and the session that is made of it."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict

import pytest

from benchmarks.accuracy import cases, n_four_bar
from commands import ran
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.kernels.many_rows import SOME_ROWS
from hapticmech_ros.plan.scene_plan import ScenePlan, plan_scene
from hapticmech_ros.scene import Scene, document_of, scene_from_document
from hapticmech_ros.session import Session


def taken(plan: ScenePlan) -> dict[str, str]:
    return {choice.about: choice.taken for choice in plan.choices}


SCENES = [load_scene(name) for name in shipped_scenes()] + [case.scene for case in cases()]
# How often a rule evaluates the equations of motion in a step.
STAGES = {"rk4": 4, "tsit5": 6, "linearly_implicit": 4, "rk2": 2, "semi_implicit_euler": 1}


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_numbers_are_those_of_the_scene_and_of_its_session(scene: Scene) -> None:
    plan = plan_scene(scene)
    sample = Session(scene).tick()
    moving = [link.joint for link in scene.links if link.joint.type != "fixed"]
    assert plan.joints == Counter(joint.type for joint in moving if not joint.locked)
    assert sum(plan.joints.values()) + plan.still_joints == len(scene.links)
    assert (plan.nq, plan.nv) == (sample.mechanism.q.size, sample.mechanism.v.size)
    assert plan.task_rows == sample.analysis.spectrum.s.size
    assert plan.points == tuple(point.name for point in scene.operational_points)
    assert plan.analysed == plan.points[0]
    assert tuple(closure.active for closure in plan.closures) == sample.mechanism.active
    assert plan.rows == sum(closure.rows for closure in plan.closures)
    assert plan.active_rows == sum(closure.rows for closure in plan.closures if closure.active)
    assert plan.rank == plan.active_rows - len(plan.redundant_rows) == plan.nv - plan.mobility
    assert (plan.topology == "closed") == (plan.active_rows > 0)
    assert plan.period == scene.simulation.period
    simulation = Mechanism(scene).scene.simulation
    assert (plan.integrator, plan.substeps) == (simulation.integrator, simulation.substeps)
    assert plan.stages == STAGES[plan.integrator]
    sizes = {array.name: array.shape for array in plan.arrays}
    assert sizes["q"] == sample.mechanism.q.shape
    assert sizes["of which joint_jacobian"] == (plan.nv, 6)
    assert sizes["Ẇv"] == (plan.active_rows,)
    assert sizes["J_h of each point"][1:] == sample.point.jacobian.shape
    assert json.loads(json.dumps(asdict(plan)))["scene"] == scene.name


def test_redundant_rows_are_named() -> None:
    bricard = next(case.scene for case in cases() if case.name == "bricard")
    plan = plan_scene(bricard)
    assert (plan.active_rows, plan.rank, len(plan.redundant_rows)) == (5, 4, 1)
    assert plan.closures[0].redundant == plan.redundant_rows


def test_some_rows_are_factored_by_qr_and_fewer_by_svd() -> None:
    few, some = (dense(n_four_bar(SOME_ROWS // 2 - less)) for less in (1, 0))
    assert taken(plan_scene(few))["closure factorisation"] == "SVD"
    assert taken(plan_scene(some))["closure factorisation"] == "pivoted QR"


def test_what_reaches_few_rates_is_factored_inside_a_band() -> None:
    found = taken(plan_scene(n_four_bar(10)))
    assert found["factorisation"] == "sparse, linear in size"
    assert found["closure factorisation"] == "banded QR"
    assert taken(plan_scene(dense(n_four_bar(10))))["factorisation"] == "dense"
    assert taken(plan_scene(load_scene("five_bar")))["factorisation"] == "dense"


def dense(scene: Scene) -> Scene:
    """Return a scene whose integrator needs D as a matrix."""
    return scene.stepped(integrator="linearly_implicit")


def test_the_choices_are_those_of_the_scene() -> None:
    start = taken(plan_scene(load_scene("five_bar")))
    assert start["stabilisation"] == "projection"
    pulled = load_scene("five_bar", changes=["simulation.stabilisation=baumgarte"])
    assert taken(plan_scene(pulled)) == start | {"stabilisation": "baumgarte"}
    loose = plan_scene(load_scene("five_bar", changes=["closures.ground_pin.active=false"]))
    assert (loose.topology, loose.active_rows) == ("serial", 0)
    nothing = {"closure factorisation": "none", "stabilisation": "none"}
    assert taken(loose) == start | nothing


def test_an_open_closure_can_latch_if_it_has_a_distance() -> None:
    (closure,) = plan_scene(load_scene("four_bar_closing")).closures
    assert (closure.active, closure.can_latch) == (False, True)
    without = "closures[0].latch_distance=null"
    (closure,) = plan_scene(load_scene("four_bar_closing", changes=[without])).closures
    assert not closure.can_latch


def test_a_free_joint_is_on_a_manifold() -> None:
    document = document_of(load_scene("spatial_arm"))
    joint = document["links"][0]["joint"]
    joint["type"] = "free"
    document["initial_state"]["q"].pop(joint["name"])
    plan = plan_scene(scene_from_document(document))
    assert plan.nq == plan.nv + 1
    assert taken(plan)["configuration"] == "on a manifold"


def test_another_point_can_be_held_and_an_unknown_one_cannot() -> None:
    document = document_of(load_scene("two_link"))
    document["operational_points"].append({"name": "elbow", "link": "link1"})
    scene = scene_from_document(document)
    assert plan_scene(scene, "elbow").analysed == "elbow"
    with pytest.raises(InvalidInputError, match="elbow"):
        plan_scene(scene, "foot")


def test_the_command_prints_the_plan() -> None:
    printed = json.loads(ran("scene", "plan", "four_bar_closing", "--json"))
    plan = asdict(plan_scene(load_scene("four_bar_closing")))
    assert printed == json.loads(json.dumps(plan))
    text = ran("scene", "plan", "four_bar_closing")
    for words in ("serial", "3 revolute", "open, can latch", "no closure is active"):
        assert words in text
