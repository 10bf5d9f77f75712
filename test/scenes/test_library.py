# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The library's page has every scene, its picture and its command; numbers: ``test_all_scenes``."""

from pathlib import Path

import pytest
from matplotlib import image

from hapticmech_ros import load_scene
from hapticmech_ros.loading import shipped_scenes

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")
PICTURES = ROOT / "docs" / "images" / "scenes"
SCENES = sorted(shipped_scenes())


def test_there_are_no_other_pictures():
    assert sorted(path.stem for path in PICTURES.glob("*")) == SCENES


@pytest.mark.parametrize("name", SCENES)
def test_each_scene_has_its_row_and_picture(name):
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| [{name}]("))
    assert f"](../config/scenes/{name}.yaml)" in row
    assert f"![{name}](images/scenes/{name}.png)" in row
    assert f"| {load_scene(name).description} |" in row
    assert f"`hapticmech run {name}`" in row
    path = PICTURES / f"{name}.png"
    assert path.stat().st_size < 40_000
    assert image.imread(path).shape[:2] == (400, 400)
