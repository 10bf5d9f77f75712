# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How large numbers may be: what a scene says of it, and that its own figures lie within."""

import pytest

from hapticmech_ros.errors import SceneError
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.scene.rules import check_limits
from hapticmech_ros.wire.bounds import FIXED
from hapticmech_ros.wire.messages import (
    DeviceStateMessage,
    LocalFeedbackGain,
    OperationalModelMessage,
)
from hapticmech_ros.wire.state import StateLayout


def scene(**limits):
    document = document_of(load_scene("five_bar"))
    document["limits"] = limits
    return scene_from_document(document)


def test_what_is_left_out_has_a_default_and_what_is_given_counts():
    assert scene().limits == Limits()
    assert scene(force=50.0).limits == Limits(force=50.0)


@pytest.mark.parametrize("bad", [0.0, -1.0, 1e16, float("nan"), "1"])
def test_a_limit_is_a_number_above_zero_of_which_products_stay_finite(bad):
    with pytest.raises(SceneError, match=r"limits\.force"):
        scene(force=bad)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        (["limits.force=10.0"], r"device\.force_limit"),
        (["limits.torque=0.1"], r"device\.torque_limit"),
        (["limits.stiffness=100.0"], r"joint_constraint\.stiffness"),
        (["limits.damping=1.0"], r"joint_constraint\.damping"),
        # A start that is faster than joints may be.
        (
            ["limits.joint_velocity=40.0", "initial_state.v.joint1=50.0"],
            r"initial_state\.v\.joint1.*joint_velocity, 40",
        ),
    ],
)
def test_what_the_scene_itself_says_lies_within(changes, key):
    given = load_scene("five_bar").with_(*changes)
    with pytest.raises(SceneError, match=key):
        check_limits(given)


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_are_far_from_their_limits(name):
    found = load_scene(name)
    check_limits(found)
    assert found.device.force_limit <= 1e-3 * found.limits.force
    assert found.controller.joint_constraint.stiffness <= 1e-3 * found.limits.stiffness


def test_every_quantity_in_messages_has_a_limit_and_every_limit_a_quantity():
    state = StateLayout(Mechanism(load_scene("five_bar"))).fields
    layouts = (
        DeviceStateMessage.layout,
        OperationalModelMessage.layout,
        LocalFeedbackGain.layout,
        state,
    )
    used = {name for layout in layouts for name in layout.quantities()}
    assert used == {*Limits.model_fields, *FIXED}
