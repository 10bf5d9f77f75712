# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Documents of scenes with something wrong in them, and what is said of it."""

import re

import pytest

from hapticmech_ros.errors import SceneError
from hapticmech_ros.scene import scene_from_document


def place(document, path, value):
    """Set ``value`` at a key path such as ``links[0].joint.axis``."""
    keys = [int(k) if k.isdigit() else k for k in re.findall(r"[^.\[\]]+", path)]
    for key in keys[:-1]:
        document = document[key]
    document[keys[-1]] = value


def problems_of(document):
    with pytest.raises(SceneError) as caught:
        scene_from_document(document, source="scene.yaml")
    for problem in caught.value.problems:
        assert f"{problem.key_path}: {problem.rule}" in str(caught.value)
    assert str(caught.value).startswith("scene.yaml: ")
    return caught.value.problems
