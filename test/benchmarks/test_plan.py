# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path

import pytest

from benchmarks.graph.plan import Plan, scene_at_rate
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.scene import document_of


@pytest.mark.parametrize(
    ("changes", "rule"),
    [
        ({"rates_hz": ()}, "must have a rate"),
        ({"rates_hz": (0.0,)}, "rate"),
        ({"rates_hz": (float("nan"),)}, "rate"),
        ({"layouts": ("scattered",)}, "separate, composed"),
        ({"recorded": ()}, "record or not"),
        ({"views_hz": ()}, "a view rate"),
        ({"views_hz": (5000.0,)}, "view rate"),
        ({"transports": ()}, "a transport"),
        ({"transports": ("pigeon",)}, "auto, middleware"),
        ({"seconds": 0.5}, "1 or more"),
        ({"seconds": float("inf")}, "1 or more"),
        ({"repeats": 0}, "1 or more"),
    ],
)
def test_plans_that_make_no_sense_are_refused(changes: dict[str, object], rule: str) -> None:
    given: dict[str, object] = {"scene": "five_bar", "rates_hz": (1000.0,), **changes}
    with pytest.raises(InvalidInputError, match=rule):
        Plan(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", sorted(shipped_scenes()))
def test_a_scene_at_another_rate_differs_in_its_period_alone(name: str, tmp_path: Path) -> None:
    document = document_of(load_scene(name))
    copy = document_of(load_scene(scene_at_rate(name, 2000.0, tmp_path / "scenes")))
    assert copy["simulation"].pop("period") == 1.0 / 2000.0
    assert document["simulation"].pop("period") != 1.0 / 2000.0
    assert copy == document
