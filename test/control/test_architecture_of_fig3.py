# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The three controllers joined: what the device and the mechanism get in one period."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros import Simulator, analyse, load_scene
from hapticmech_ros.control import ControlArchitecture, DeviceMeasurement, PointMeasurement
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.scene import document_of, scene_from_document

PLANE = np.array([1.0, 1.0, 0, 0, 0, 1.0])


def parts(name, **gains):
    document = document_of(load_scene(name))
    document["controller"].update(gains)
    scene = scene_from_document(document)
    simulator = Simulator(scene)
    state = simulator.initial_state()
    found = analyse(simulator.mechanism, state.q)
    point = simulator.evaluate(state).points[0]
    return ControlArchitecture(scene), found, point


def compute(name, time=1.0, push=None, contact=None, shift=None, rate=None, duration=0.0, **gains):
    control, found, point = parts(name, **gains)
    zero = np.zeros(6)
    step = zero if shift is None else shift
    pose = pin.SE3(pin.exp3(step[3:]) @ point.pose.rotation, point.pose.translation + step[:3])
    out = control.compute(
        time,
        engage(0.0, point.pose, point.pose, duration),
        DeviceMeasurement(pose, zero if rate is None else rate, zero if push is None else push),
        PointMeasurement(point.pose, zero, zero if contact is None else contact),
        operational_model_of(found),
    )
    return control, found, out


@pytest.mark.parametrize("name", ["five_bar", "two_link", "spatial_arm"])
@pytest.mark.parametrize("beta", [0.0, 1.0])
def test_in_place_the_device_obeys_the_impedance_law(name, beta):
    push, contact = np.arange(1.0, 7.0) * 0.01, np.arange(6.0, 0.0, -1.0) * 0.01
    constraint = {"feedforward": beta}
    control, found, out = compute(name, push=push, contact=contact, joint_constraint=constraint)
    task = PLANE if name != "spatial_arm" else np.ones(6)
    whole = task * (push + contact)
    expected = control.device_inertia @ (found.inverse_inertia @ whole + found.free_acceleration)
    expected += (1.0 - beta) * (found.wrench_projector @ whole)
    # Λ_d X goes up to 1e2 in units of the push: rounding of 1e-14, with margin.
    assert np.abs(task * push + out.device - expected).max() < 1e-12
    # The pose error is a rounding error of 1e-16 m or rad, met by 300 N/m and 2000 N/m.
    assert np.abs(out.joint_constraint).max() < 1e-12
    assert np.abs(out.mechanism - task * push).max() < 1e-12


def test_the_parts_add_up_to_the_device_s_wrench():
    rng = np.random.default_rng(0)
    _, _, out = compute("spatial_arm", push=rng.normal(size=6) * 0.01, shift=1e-4 * np.ones(6))
    total = out.impedance + out.joint_constraint + out.four_channel
    assert np.abs(total - out.device).max() < 1e-15


@pytest.mark.parametrize("beta", [0.0, 1.0])
def test_at_the_moment_of_engagement_forces_act_and_springs_do_not(beta):
    """The device accelerates as the operational point: the joints balance the rest of the push."""
    push, contact, shift = 0.1 * PLANE, 0.03 * PLANE, 1e-4 * PLANE
    constraint = {"feedforward": beta}

    def at(time):
        gains = {"duration": 0.1, "joint_constraint": constraint}
        return compute("five_bar", time=time, push=push, contact=contact, shift=shift, **gains)

    control, found, start = at(0.0)
    moved = found.inverse_inertia @ (push + contact) + found.free_acceleration
    expected = PLANE * (control.device_inertia @ moved) - push
    assert np.abs(start.device - expected).max() < 1e-15
    assert np.array_equal(start.joint_constraint, np.zeros(6))
    assert np.array_equal(start.mechanism, push)
    # Nothing moves: springs come in over the second half.
    (_, _, half), (_, _, full) = at(0.075), at(0.1)
    assert np.array_equal(at(0.05)[2].device, start.device)
    assert np.linalg.norm(full.device - start.device) > 0.01
    assert np.abs(2.0 * half.device - start.device - full.device).max() < 1e-14
    assert np.abs(2.0 * half.mechanism - start.mechanism - full.mechanism).max() < 1e-14


def test_a_planar_scene_gets_no_wrench_out_of_its_plane():
    rng = np.random.default_rng(1)
    arguments = {key: rng.normal(size=6) for key in ("push", "contact", "shift", "rate")}
    _, _, out = compute("five_bar", **arguments)
    for wrench in (out.device, out.mechanism, out.error):
        assert np.array_equal(wrench * (1.0 - PLANE), np.zeros(6))
        assert np.linalg.norm(wrench) > 0.0


def test_actuators_limits_hold_on_both_sides():
    _, _, out = compute("spatial_arm", push=1e3 * np.ones(6), shift=0.5 * np.ones(6))
    device = load_scene("spatial_arm").device
    for wrench in (out.device, out.mechanism):
        assert np.linalg.norm(wrench[:3]) <= device.force_limit * (1.0 + 1e-15)
        assert np.linalg.norm(wrench[3:]) <= device.torque_limit * (1.0 + 1e-15)


def test_position_channel_pulls_both_sides_together():
    shift = np.array([1e-3, 0, 0, 0, 0, 0])
    _, _, out = compute("spatial_arm", shift=shift)
    # 300 N/m of the scene's default on 1 mm; equal and opposite where nothing is rigid.
    assert abs(out.mechanism[0] - 0.3) < 1e-12
    assert np.abs(out.four_channel + out.mechanism).max() < 1e-12
