# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a study gives a worker, and what the worker does with it.

Workers import this and what is measured, and nothing that draws or writes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.loading.loader import scene_as_written
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.changes import with_changes
from hapticmech_ros.study.design import Design
from hapticmech_ros.study.measures import measure_named

# Numbers of each scene by its index, or why it has none.
Numbers = list[tuple[int, dict[str, float] | str]]


@dataclass(frozen=True, slots=True)
class Task:
    """Scenes to measure, and all that another process needs to know for that.

    Attributes:
        document: as written, of which keys are set.
        path: of its file.
        measures: what is measured.
        point: operational point; the scene's first one if empty.
        changes: index of each scene, and what is set in it, ``key=value`` each.
    """

    document: object
    path: Path
    measures: tuple[str, ...]
    point: str
    changes: tuple[tuple[int, tuple[str, ...]], ...] = ()

    def __str__(self) -> str:
        return f"scenes {', '.join(str(index) for index, _ in self.changes)}"

    def of(self, indices: Sequence[int], design: Design) -> Task:
        """Return the task of measuring other scenes of a design."""
        changes = tuple((index, design.changes(index)) for index in indices)
        return replace(self, changes=changes)

    def scene(self, changes: Sequence[str]) -> Scene:
        """Return the scene with some keys set, ``key=value`` each.

        Raises:
            SceneError: keys that are none, or rules that are broken.
        """
        document = with_changes(self.document, changes, str(self.path))
        return scene_as_written(document, self.path)

    def measured(self, scene: Scene) -> dict[str, float]:
        """Return a scene's numbers.

        Raises:
            InvalidInputError: an unknown measure or point, two with a number of one name, or none.
            HapticMechError: it cannot be measured.
        """
        found: dict[str, float] = {}
        for name in self.measures:
            numbers = measure_named(name)(scene, self.point)
            twice = sorted(found.keys() & numbers.keys())
            if twice:
                raise InvalidInputError("measures", self.measures, f"two of them have {twice}")
            found |= {str(key): float(value) for key, value in numbers.items()}
        if not found:
            raise InvalidInputError("measures", self.measures, "have no numbers")
        return found


def carry_out(task: Task) -> Numbers:
    """Return the numbers of each scene of a task, or why it has none."""
    found = Numbers()
    for index, changes in task.changes:
        try:
            found.append((index, task.measured(task.scene(changes))))
        except HapticMechError as error:
            found.append((index, str(error)))
    return found
