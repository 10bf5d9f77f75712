# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a scene says what runs: it follows the scene, and what is counted while it runs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import pytest
from typer.testing import CliRunner

from benchmarks.accuracy import cases, n_four_bar
from hapticmech_ros.cli import app
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.kernels.many_rows import SOME_ROWS
from hapticmech_ros.plan.scene_plan import ScenePlan, plan_scene
from hapticmech_ros.scene import Scene, document_of, scene_from_document
from hapticmech_ros.session import Session

Change = Callable[[dict[str, Any]], None]


def changed(name: str, change: Change) -> Scene:
    document = document_of(load_scene(name))
    change(document)
    return scene_from_document(document)


def computed(plan: ScenePlan) -> dict[str, int]:
    return {part.what: part.times for part in plan.tick if part.computed}


def taken(plan: ScenePlan) -> dict[str, str]:
    return {choice.about: choice.taken for choice in plan.choices}


SCENES = [load_scene(name) for name in shipped_scenes()] + [case.scene for case in cases()]


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
    sizes = {array.name: array.shape for array in plan.arrays}
    assert sizes["q"] == sample.mechanism.q.shape
    assert sizes["of which joint_jacobian"] == (plan.nv, 6)
    assert sizes["Ẇv"] == (plan.active_rows,)
    assert sizes["J_h of each point"][1:] == sample.point.jacobian.shape
    assert json.loads(json.dumps(asdict(plan)))["scene"] == scene.name


# How often a rule evaluates the equations of motion in a step.
STAGES = {"rk4": 4, "tsit5": 6, "linearly_implicit": 4, "rk2": 2, "semi_implicit_euler": 1}


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_a_step_factors_once_in_each_stage(scene: Scene) -> None:
    simulation = Mechanism(scene).scene.simulation
    found = computed(plan_scene(scene))["D, joint Jacobians, poses; Cholesky of D"]
    assert found == STAGES[simulation.integrator] * simulation.substeps


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
    implicit = scene.simulation.model_copy(update={"integrator": "linearly_implicit"})
    return scene.model_copy(update={"simulation": implicit})


def open_pin(document: dict[str, Any]) -> None:
    document["closures"][0]["active"] = False


def pull_down(document: dict[str, Any]) -> None:
    document["gravity"] = [0.0, -9.81, 0.0]


def two_substeps(document: dict[str, Any]) -> None:
    document["simulation"]["substeps"] = 2


def rub(document: dict[str, Any]) -> None:
    document["links"][0]["joint"]["friction"] = 0.01


def pull_together(document: dict[str, Any]) -> None:
    ends = {"a": {"link": "link2"}, "b": {"link": "world"}}
    document["springs"] = [{"name": "spring", "stiffness": 10.0, **ends}]


def coarse_encoders(document: dict[str, Any]) -> None:
    document["device"]["position_resolution"] = 1e-5


def implicit(document: dict[str, Any]) -> None:
    document["simulation"]["integrator"] = "linearly_implicit"


def baumgarte(document: dict[str, Any]) -> None:
    document["simulation"]["stabilisation"] = "baumgarte"


CLOSING = {
    "W and its factorisation",
    "projection onto the closures",
    "projection of S onto closed-loop motions",
}


@pytest.mark.parametrize(
    ("change", "gone", "come"),
    [
        (open_pin, CLOSING, {"frames of open closures"}),
        (pull_down, set(), set()),
        (two_substeps, set(), set()),
        (rub, set(), {"springs, friction, stops of joints"}),
        (pull_together, set(), {"springs between points"}),
        (coarse_encoders, set(), {"rounding to encoder steps"}),
        (implicit, set(), {"factorisation of D with stiffness and damping"}),
        (baumgarte, {"projection onto the closures"}, set()),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_tick_computes_what_the_scene_has_and_nothing_else(
    change: Change, gone: set[str], come: set[str]
) -> None:
    before = computed(plan_scene(load_scene("five_bar")))
    after = computed(plan_scene(changed("five_bar", change)))
    assert set(before) - set(after) == gone
    assert set(after) - set(before) == come


def test_substeps_multiply_what_a_substep_computes() -> None:
    once = computed(plan_scene(load_scene("five_bar")))
    twice = computed(plan_scene(changed("five_bar", two_substeps)))
    within = {"evaluate": 1, "analyse": 1, "control": 1, "step": 2, "device": 1}
    plan = plan_scene(load_scene("five_bar"))
    for part in plan.tick:
        if part.computed:
            assert twice[part.what] == within[part.stage] * once[part.what]


def test_everything_left_out_has_a_reason() -> None:
    for scene in SCENES:
        for part in plan_scene(scene).tick:
            assert part.why


def test_what_latches_is_looked_for_until_it_is_closed() -> None:
    plan = plan_scene(load_scene("four_bar_closing"))
    (closure,) = plan.closures
    assert closure.can_latch
    assert computed(plan)["distance of closures that can latch"] == 1
    closed = changed(
        "five_bar", lambda document: document["closures"][0].update(latch_distance=None)
    )
    assert "distance of closures that can latch" not in computed(plan_scene(closed))


def test_a_free_joint_is_on_a_manifold() -> None:
    def free(document: dict[str, Any]) -> None:
        joint = document["links"][0]["joint"]
        joint["type"] = "free"
        document["initial_state"]["q"].pop(joint["name"])

    plan = plan_scene(changed("spatial_arm", free))
    assert plan.nq == plan.nv + 1
    assert taken(plan)["configuration"] == "on a manifold"
    assert computed(plan)["integration on a manifold"] == plan.stages


def test_another_point_can_be_held_and_an_unknown_one_cannot() -> None:
    def second(document: dict[str, Any]) -> None:
        point = {"name": "elbow", "link": "link1"}
        document["operational_points"].append(point)

    scene = changed("two_link", second)
    plan = plan_scene(scene, "elbow")
    assert plan.analysed == "elbow"
    assert computed(plan)["pose, Jacobian, twist, drift of points"] == 2
    with pytest.raises(InvalidInputError, match="elbow"):
        plan_scene(scene, "foot")


def test_contacts_are_looked_for_only_where_pairs_are_declared() -> None:
    what = "bounding boxes of declared pairs"
    assert what not in computed(plan_scene(load_scene("two_link")))

    def floor(document: dict[str, Any]) -> None:
        document["simulation"]["substeps"] = 3
        tip = {"name": "tip", "link": "link2", "geometry": {"kind": "sphere", "radius": 0.01}}
        wall = {"name": "wall", "link": "world", "geometry": {"kind": "half_space"}}
        document["shapes"] = [tip, wall]
        document["contacts"] = [{"name": "touch", "a": "tip", "b": "wall", "stiffness": 1e3}]

    plan = plan_scene(changed("two_link", floor))
    assert computed(plan)[what] == 3
    assert any(part.what == what and part.why == "1 declared pair" for part in plan.tick)


def test_the_command_prints_the_plan() -> None:
    run = CliRunner().invoke(app, ["scene", "plan", "four_bar_closing", "--json"])
    assert run.exit_code == 0
    assert json.loads(run.stdout) == json.loads(
        json.dumps(asdict(plan_scene(load_scene("four_bar_closing"))))
    )
    text = CliRunner().invoke(app, ["scene", "plan", "four_bar_closing"]).stdout
    for words in ("serial", "3 revolute", "open, can latch", "omitted", "no closure is active"):
        assert words in text
