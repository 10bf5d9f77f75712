# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What ``scene check`` says of the mechanism's steps."""

import numpy as np
import pytest

from hapticmech_ros import Session, load_scene
from hapticmech_ros.plan.scene_plan import check_scene
from hapticmech_ros.plan.step_accuracy import step_accuracy
from hapticmech_ros.scene import document_of, scene_from_document


def stepped(name, **simulation):
    document = document_of(load_scene(name))
    document["simulation"] = {**document["simulation"], **simulation}
    document["experiment"] = {"duration": 0.5}
    return scene_from_document(document)


@pytest.mark.parametrize(("integrator", "order"), [("semi_implicit_euler", 1.0), ("rk2", 2.0)])
def test_the_difference_falls_with_the_order_of_the_integrator(integrator, order):
    one, two = (
        step_accuracy(stepped("two_link", integrator=integrator, substeps=n)) for n in (1, 2)
    )
    for name in ("position_m", "rotation_rad", "force_n"):
        assert abs(np.log2(getattr(one, name) / getattr(two, name)) - order) < 0.2
    assert one.position_m > 1e-9


def test_it_is_what_the_steps_do_to_a_session():
    """Against a step that is a hundred times shorter: the scene's error, less a tenth squared."""
    scene, finest = (stepped("two_link", integrator="rk2", substeps=n) for n in (1, 100))
    ends = [Session(one).run(750)["position"] for one in (scene, finest)]
    error = np.linalg.norm(ends[0] - ends[1], axis=1).max()
    assert step_accuracy(scene).position_m == pytest.approx(error, rel=0.02)


def test_rk4_at_a_millisecond_is_exact_to_rounding_at_a_hand_s_speed():
    found = step_accuracy(stepped("five_bar"))
    assert found.duration_s == 0.5
    assert 0.0 < found.position_m < 1e-12
    assert found.rotation_rad < 1e-11
    assert found.force_n < 1e-9
    assert abs(found.surplus_j) < 1e-9 * found.exchanged_j
    assert (found.refined, found.inaccurate, found.failed) == (0, 0, "")


def test_what_there_is_no_time_for_is_said():
    scene, told = stepped("five_bar"), []
    whole = step_accuracy(scene)

    def after(looks):
        left = iter([False] * looks + [True])
        return lambda: next(left)

    # 30 looks at the experiment of 750 ticks, then some at the other.
    found = step_accuracy(scene, after(40), told.append)
    assert found.left_out.startswith("the same with ten times shorter steps: ")
    assert (found.surplus_j, found.exchanged_j) == (whole.surplus_j, whole.exchanged_j)
    assert "steps of the experiment: 100%" in told
    assert step_accuracy(scene, after(0)).left_out.startswith("steps of the experiment: 3%")
    assert step_accuracy(scene, after(60)) == whole


def test_what_cannot_be_run_is_told():
    document = document_of(load_scene("two_link"))
    document["links"][1]["joint"] |= {"stiffness": 1e12, "rest": 0.0}
    check = check_scene(scene_from_document(document))
    assert "the step at" in check.accuracy.failed
    assert any("ends early: the step at" in warning for warning in check.warnings)
