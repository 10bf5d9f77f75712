# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Models in models of SDFormat: their parts as those of one, by names such as arm::hand::finger."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from hapticmech_ros.formats.loops import BALL
from hapticmech_ros.formats.model import WORLD
from hapticmech_ros.formats.xml_nodes import Node, Source

HERE = "__model__"
# Attributes and elements that name links, joints and frames of their model.
NAMING = {"relative_to", "attached_to", "expressed_in"}
NAMING_ELEMENTS = {"parent", "child", "gearbox_reference_body"}
NAMING_ELEMENTS |= {f"{BALL}_body_A", f"{BALL}_body_B"}
NAMED = {"link", "joint", "frame"}
# Characters of the names of models that are in each other; every name in them begins so.
PREFIX_LIMIT = 200


@dataclass(frozen=True, slots=True)
class Scope:
    """The model that something is in.

    Attributes:
        prefix: of all names in it.
        canonical: link that moves its frame; empty if it has none.
    """

    prefix: str
    canonical: str

    @property
    def here(self) -> str:
        """The name of its frame."""
        return self.prefix + HERE


def opened(source: Source, model: Node, prefix: str = "") -> Iterator[tuple[Node, Scope]]:
    """Yield what is in a model and in the models in it, with names from outside.

    A model in it comes as an element of that kind, with its frame's name and its pose alone.

    Raises:
        SceneError: a model in it is placed by another frame than its own, or its name is too long.
    """
    scope = Scope(prefix, _canonical(source, model, prefix))
    for node in model.children:
        if node.tag != "model":
            yield (_renamed(node, prefix) if prefix else node), scope
            continue
        inner = f"{prefix}{source.text(node, 'name')}::"
        if len(inner) > PREFIX_LIMIT:
            rule = f"names of models in each other have at most {PREFIX_LIMIT} characters"
            raise source.error(node, inner, rule)
        if "placement_frame" in node.attributes:
            rule = "a model is placed by its own frame"
            raise source.error(node, node.attributes["placement_frame"], rule)
        placed = [_renamed(pose, prefix) if prefix else pose for pose in node.all("pose")]
        yield replace(node, attributes={"name": inner + HERE}, children=placed), scope
        yield from opened(source, node, inner)


def _canonical(source: Source, model: Node, prefix: str) -> str:
    """Return the link that a model names as the one that moves its frame; else its first."""
    if "canonical_link" in model.attributes:
        return prefix + source.text(model, "canonical_link")
    first = model.first("link")
    if first is not None:
        return prefix + source.text(first, "name")
    for inner in model.all("model"):
        found = _canonical(source, inner, f"{prefix}{source.text(inner, 'name')}::")
        if found:
            return found
    return ""


def _renamed(node: Node, prefix: str) -> Node:
    """Return an element of a model with its name and those that it refers to as from outside."""
    attributes = dict(node.attributes)
    naming = NAMING | ({"name"} if node.tag in NAMED else set())
    if node.tag == "mimic":
        naming = {"joint"}
    for key in naming & attributes.keys():
        attributes[key] = _outside(attributes[key], prefix)
    text = _outside(node.text, prefix) if node.tag in NAMING_ELEMENTS else node.text
    children = [_renamed(child, prefix) for child in node.children]
    return replace(node, attributes=attributes, text=text, children=children)


def _outside(name: str, prefix: str) -> str:
    name = name.strip()
    return name if name in ("", WORLD) else prefix + name
