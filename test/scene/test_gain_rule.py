# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gains of the joint constraint where a scene gives none."""

import numpy as np
import pytest

from hapticmech_ros.control.loop_stability import LoopTerms, spectral_radius
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.scene import document_of, scene_from_document


def scene(device=None, connection=None, period=0.001, **joint):
    document = document_of(load_scene("five_bar"))
    document["controller"] = {"joint_constraint": joint}
    document["device"] = device or {}
    document["connection"] = connection or {}
    document["simulation"]["period"] = period
    return scene_from_document(document)


def gains(*arguments, **keywords):
    return scene(*arguments, **keywords).controller.joint_constraint


def test_what_is_given_stands():
    found = gains(stiffness=5000.0, damping=7.0)
    assert (found.stiffness, found.damping) == (5000.0, 7.0)


def test_damping_follows_a_stiffness_that_is_given():
    found = gains(stiffness=500.0)
    assert found.stiffness == 500.0
    # 2 ζ √(k m) with 0.3 kg.
    assert found.damping == pytest.approx(1.6 * (500.0 * 0.3) ** 0.5)
    heavy = gains({"mass": 1.2}, stiffness=500.0)
    assert heavy.damping == pytest.approx(2.0 * found.damping)


@pytest.mark.parametrize("name", shipped_scenes())
def test_scenes_that_are_shipped_have_the_rule_s(name):
    found = load_scene(name).controller.joint_constraint
    assert found.stiffness == 2000.0
    assert found.damping == pytest.approx(1.6 * (2000.0 * load_scene(name).device.mass) ** 0.5)


@pytest.mark.parametrize("period", [0.00025, 0.001, 0.004, 0.02])
@pytest.mark.parametrize("local", [True, False])
@pytest.mark.parametrize("delay", [0.0, 0.01, 0.05])
@pytest.mark.parametrize("mass", [0.03, 0.3, 3.0])
def test_the_rule_leaves_a_gain_margin_of_two(period, local, delay, mass):
    made = scene({"mass": mass}, {"delay": delay}, period, local=local)
    joint = made.controller.joint_constraint
    assert joint.stiffness <= 2000.0
    late = 1 + round(2.0 * delay / period)
    spring, damper = ([[2.0 * gain / mass]] for gain in (joint.stiffness, joint.damping))
    nothing = np.zeros((1, 1)), np.zeros((1, 1))
    acting = np.array(spring), np.array(damper)
    terms = LoopTerms(nothing, acting) if local else LoopTerms(acting, nothing)
    assert spectral_radius(terms, period, late) < 1.0 + 1e-9


def test_a_filtered_velocity_counts_as_lag():
    plain = gains({"mass": 0.03}, period=0.004)
    stepped = gains({"mass": 0.03, "position_resolution": 1e-5}, period=0.004)
    assert stepped.stiffness < plain.stiffness
