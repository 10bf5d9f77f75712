# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A validated, frozen scene.

It keeps every rule if it comes from :func:`scene_from_document`, :meth:`Scene.with_` or
:func:`~hapticmech_ros.loading.load_scene`. Its keys are those of
:class:`~hapticmech_ros.scene.document.SceneDocument`.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from hapticmech_ros.errors import check_one_of
from hapticmech_ros.scene.document import SceneDocument
from hapticmech_ros.scene.mechanism import OperationalPoint
from hapticmech_ros.scene.part import Part
from hapticmech_ros.scene.validation import validated, with_changes


class Scene(SceneDocument):
    """One virtual mechanism, the device that renders it, the hand that moves it, and the gains."""

    def __repr__(self) -> str:
        points = ", ".join(point.name for point in self.operational_points)
        return (
            f"Scene {self.name}: {len(self.links)} links, {len(self.closures)} closures, held at "
            f"{points}"
        )

    def with_(self, *changes: str, **keys: object) -> Scene:
        """Return a scene like this one, with some keys set, validated anew.

        ``scene.with_("device.mass=0.2", gravity=(0.0, 0.0, -9.81))``. Gains that a rule had filled
        in are kept.

        Args:
            changes: ``key=value`` each, see :func:`~hapticmech_ros.scene.validation.with_changes`.
            keys: of the scene's outermost level: numbers, texts, sequences, mappings, or parts.

        Raises:
            SceneError: a key that is none, or a rule that is broken.
        """
        written = [f"{key}={json.dumps(value, default=_plain)}" for key, value in keys.items()]
        document = with_changes(document_of(self), [*changes, *written], self.name)
        return scene_from_document(document, self.name)

    def stepped(self, **keys: object) -> Scene:
        """Return a scene like this one, with some keys of ``simulation``, which are not validated.

        Args:
            keys: ``integrator``, ``period``, ``substeps``, ``accuracy`` and others; they keep the
                rules of a scene.
        """
        simulation = self.simulation.model_copy(update=keys)
        return self.model_copy(update={"simulation": simulation})

    @property
    def held_points(self) -> tuple[str, ...]:
        """Names of the operational points that are held: those of ``hands``, or the first one."""
        held = tuple(entry.point for entry in self.hands)
        return held or (self.operational_points[0].name,)

    def held_at(self, point: str = "") -> Scene:
        """Return the scene as it is for the user who holds one of its points.

        ``device``, ``hand``, ``controller`` and ``connection`` are those of the point's entry among
        ``hands``, and so are its rules; without such an entry they are the scene's own.

        Args:
            point: name of an operational point; the first one that is held if empty.

        Raises:
            InvalidInputError: no such point.
        """
        name = self.operational_point(point or self.held_points[0]).name
        for entry in self.hands:
            if entry.point == name:
                return self.held_by(entry)
        return self.model_copy(update={"hands": ()}) if self.hands else self

    def operational_point(self, name: str = "") -> OperationalPoint:
        """Return the operational point ``name``; the first one if ``name`` is empty.

        Raises:
            InvalidInputError: no such point; the message lists those there are.
        """
        if not name:
            return self.operational_points[0]
        points = {point.name: point for point in self.operational_points}
        check_one_of("operational point", name, points)
        return points[name]


def scene_from_document(document: object, source: str = "<document>") -> Scene:
    """Return the scene that plain dictionaries, lists and numbers describe, validated.

    Args:
        document: a mapping of the keys of a scene.
        source: of it, for errors.

    Raises:
        SceneError: lists every broken rule with its key path and value.
    """
    return validated(Scene, document, source)


def document_of(scene: Scene) -> dict[str, Any]:
    """Return ``scene`` as plain dictionaries, lists and numbers, as in a YAML file."""
    return scene.model_dump(mode="json")


def _plain(value: object) -> object:
    """Return parts of scenes and arrays as mappings, lists and numbers.

    Raises:
        TypeError: it is neither.
    """
    if isinstance(value, Part):
        return value.model_dump(mode="json")
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{value!r} cannot be written into a scene")
