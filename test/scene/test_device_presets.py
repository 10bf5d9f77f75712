"""Real devices by name: each has its sources, runs, and gives way to what a scene says itself."""

import pytest
from typer.testing import CliRunner

from hapticmech_ros.cli import app
from hapticmech_ros.scene import document_of, scene_from_document
from hapticmech_ros.scene.arm_impedances import ARM_IMPEDANCES
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.device_presets import device_presets
from hapticmech_ros.scene.hand import ArmHand, Waypoint
from hapticmech_ros.session import Session

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


@pytest.mark.parametrize("name", NAMES)
def test_every_preset_renders_a_scene(planar, name):
    """With gains for its mass, and no torque of the hand, which nothing would resist."""
    planar["device"] = {"preset": name}
    planar["hand"]["torque"] = [0.0, 0.0, 0.0]
    gains = planar["controller"]["joint_constraint"]
    gains["stiffness"], gains["damping"] = 200.0, 4.0
    scene = scene_from_document(planar)
    assert document_of(scene)["device"]["preset"] == name
    session = Session(scene)
    samples = [session.tick() for _ in range(600)]
    assert all(abs(sample.device.twist).max() < 5.0 for sample in samples)


@pytest.mark.parametrize("name", ARM_IMPEDANCES)
def test_an_arm_starts_from_measured_figures(name):
    arm = ArmHand(kind="arm", impedance=name, waypoints=(Waypoint(time=0.0),), damping=1.5)
    assert arm.damping == 1.5
    assert arm.mass == ARM_IMPEDANCES[name]["mass"]
    assert arm.angular_stiffness == ARM_IMPEDANCES[name]["angular_stiffness"]
    assert ArmHand.model_validate(arm.model_dump(mode="json")) == arm


def test_the_command_lists_them():
    found = CliRunner().invoke(app, ["device", "list"])
    assert found.exit_code == 0, found.output
    assert all(name in found.output for name in NAMES)
