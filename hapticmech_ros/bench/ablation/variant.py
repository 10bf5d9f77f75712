"""A scene made by code from another one."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from hapticmech_ros.scene import Scene, scene_from_document

Document = dict[str, Any]
Change = Callable[[Document], None]


@dataclass(frozen=True, slots=True)
class Variant:
    """A scene, and what sets it apart.

    Attributes:
        name: for people, such as ``gravity``.
        document: the scene as plain dictionaries, lists and numbers.
    """

    name: str
    document: Document

    def scene(self) -> Scene:
        """Return the validated scene.

        Raises:
            SceneError: the document breaks a rule.
        """
        return scene_from_document(self.document, self.name)

    def changed(self, name: str, *changes: Change) -> Variant:
        """Return a variant with changes, in order; this one stays as it is."""
        document = deepcopy(self.document)
        for change in changes:
            change(document)
        return Variant(name, document)
