# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Real devices by name: each has its sources, runs, and gives way to what a scene says itself."""

import numpy as np
import pytest

from commands import ran
from hapticmech_ros.plan.scene_plan import check_scene
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.device import Device, device_presets
from hapticmech_ros.scene.hand import ARM_IMPEDANCES, ArmHand, Waypoint
from hapticmech_ros.session import Session
from sampling import sampled

NAMES = sorted(device_presets())
# Of these keys a preset need not say where its number is from.
OWN_CHOICE = {"force_sensor"}


def test_there_are_devices_with_and_without_torque():
    kinds = {Device(preset=name).actuated for name in NAMES}
    assert kinds == {"all", "translation"}
    assert len(NAMES) >= 3


@pytest.mark.parametrize("name", NAMES)
def test_every_figure_has_a_source_or_says_how_it_was_chosen(name):
    preset = device_presets()[name]
    assert preset.description
    sourced = set()
    for source in preset.sources:
        keys, _, where = source.partition(":")
        assert len(where) > 20, "a source says what it is"
        sourced |= {key.strip() for key in keys.split(",")}
    chosen = {key for key, why in preset.chosen.items() if why}
    assert set(preset.device) - OWN_CHOICE <= sourced | chosen
    assert not sourced & chosen
    assert sourced | chosen <= set(Device.model_fields)


@pytest.mark.parametrize("name", NAMES)
def test_a_preset_fills_what_the_scene_leaves_out(name):
    said = device_presets()[name].device
    device = Device(preset=name, mass=0.123, workspace={"angle": 1.0})
    assert device.mass == 0.123
    assert device.force_limit == said["force_limit"]
    assert device.workspace.radius == said["workspace"]["radius"]
    assert device.workspace.angle == 1.0
    # Written out and read again it is the same device.
    assert Device.model_validate(device.model_dump(mode="json")) == device
    assert Device() == Device.model_validate({})


@pytest.mark.parametrize("name", sampled(NAMES, every=2))
def test_every_preset_renders_a_scene_to_an_arm(planar, name):
    """With gains a fifth of the scene's, which even the lightest device bears."""
    planar["device"] = {"preset": name}
    move = {"time": 1.0, "xyz": [-0.02, 0.01, 0.0]}
    planar["hand"] = {"kind": "arm", "waypoints": [move]}
    for part in ("joint_constraint", "position_channel"):
        for key in ("stiffness", "damping", "angular_stiffness", "angular_damping"):
            if key in planar["controller"][part]:
                planar["controller"][part][key] *= 0.2
    scene = scene_from_document(planar)
    assert document_of(scene)["device"]["preset"] == name
    (point,) = check_scene(scene).points
    assert point.loop.periods >= 1
    session = Session(scene)
    samples = [session.tick() for _ in range(2250)]
    speeds = [np.linalg.norm(sample.device.twist[:3]) for sample in samples]
    # The move's own peak is 15/8 of 22 mm/s; a slip out of friction F_c, against the arm's spring k
    # with the device's and the arm's mass, adds up to 2 F_c / sqrt(k m), 0.07 m/s, and overshoots.
    assert max(speeds) < 0.2
    # A second after it next to nothing moves.
    assert max(speeds[-50:]) < 5e-3


@pytest.mark.parametrize("name", ARM_IMPEDANCES)
def test_an_arm_starts_from_measured_figures(name):
    arm = ArmHand(kind="arm", impedance=name, waypoints=(Waypoint(time=0.0),), damping=1.5)
    assert arm.damping == 1.5
    assert arm.mass == ARM_IMPEDANCES[name]["mass"]
    assert arm.angular_stiffness == ARM_IMPEDANCES[name]["angular_stiffness"]
    assert ArmHand.model_validate(arm.model_dump(mode="json")) == arm


def test_the_command_lists_them():
    shown = ran("device", "list")
    assert all(name in shown for name in NAMES)
