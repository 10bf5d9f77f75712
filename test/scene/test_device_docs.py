# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""docs/devices.md: every snippet is a scene's, every key and every preset is there."""

import re
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.scene.device import Compensation, Device, Workspace, device_presets
from hapticmech_ros.scene.hand import (
    ARM_IMPEDANCES,
    ArmHand,
    ConstantWrenchHand,
    ScriptedHand,
    Tremor,
)

PAGE = (Path(__file__).parents[2] / "docs" / "devices.md").read_text(encoding="utf-8")
SNIPPETS = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
PARTS = (Device, Workspace, Compensation, ArmHand, ConstantWrenchHand, ScriptedHand, Tremor)


@pytest.mark.parametrize("index", range(len(SNIPPETS)))
def test_snippets_are_parts_of_scenes(planar, index, tmp_path):
    said = YAML(typ="safe", pure=True).load(SNIPPETS[index])
    if said.get("hand", {}).get("kind") == "scripted":
        (table,) = re.findall(r"```\n(time,.*?)```", PAGE, re.DOTALL)
        file = tmp_path / said["hand"]["file"]
        file.write_text(table)
        said["hand"]["file"] = str(file)
    scene = scene_from_document({**planar, **said})
    for part, keys in said.items():
        for key in keys:
            assert key in getattr(scene, part).model_fields_set


@pytest.mark.parametrize("part", PARTS)
def test_every_key_is_explained(part):
    short = PAGE.replace("`angular_...`", "`angular_stiffness`, `angular_damping`")
    missing = [key for key in part.model_fields if not re.search(rf"[`{{ ]{key}\b", short)]
    assert not missing


def test_every_preset_stands_there_with_its_figures():
    rows = {
        row[0]: row
        for line in PAGE.splitlines()
        if (row := [cell.strip(" `ᵃᵇᶜᵈ*") for cell in line.strip("|").split("|")])
    }
    for name in device_presets():
        device = Device(preset=name)
        torque = device.torque_limit if device.actuated == "all" else None
        _, _, force, found, mass, friction, step, reach = rows[name]
        assert found == "–" if torque is None else float(found) == torque
        assert float(force) == device.force_limit
        assert float(mass) == device.mass
        assert float(friction) == device.coulomb_friction
        assert float(step) == pytest.approx(1e6 * device.position_resolution)
        assert float(reach) == device.workspace.radius
    for name, figures in ARM_IMPEDANCES.items():
        (row,) = (rows[key] for key in rows if key.split("`")[0] == name)
        assert [float(cell) for cell in row[1:4]] == [
            figures[key] for key in ("mass", "damping", "stiffness")
        ]
