# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of URDF: where they are in their links, and how large."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.mesh_files import find_mesh
from hapticmech_ros.formats.model import Document, Solid
from hapticmech_ros.formats.shapes import above_zero, not_zero, refused_kind
from hapticmech_ros.formats.xml_nodes import Node, Source

# Attributes of each, as URDF and scenes call them.
SIZES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}


def placement_in(source: Source, node: Node | None) -> pin.SE3:
    """Return the transform of an element's xyz and rpy; the identity without."""
    xyz = source.values(node, "xyz", (0.0, 0.0, 0.0))
    rpy = source.values(node, "rpy", (0.0, 0.0, 0.0))
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(xyz))


def solid_of(source: Source, node: Node, link: str) -> Solid:
    """Return a <collision> of a link."""
    geometry = node.first("geometry")
    kind = geometry.children[0].tag if geometry is not None and geometry.children else "nothing"
    name = node.attributes.get("name", "").strip()
    return Solid(name, link, kind, "collision", partial(_read, source, node, kind))


def _read(source: Source, node: Node, kind: str) -> tuple[pin.SE3, Document]:
    place = placement_in(source, node.first("origin"))
    geometry = node.first("geometry")
    if geometry is None or not geometry.children:
        raise refused_kind(source, node, kind)
    shape = geometry.children[0]
    if kind in SIZES:
        sizes = above_zero(source, shape, [source.value(shape, key) for key in SIZES[kind]])
        return place, {"kind": kind, **dict(zip(SIZES[kind], sizes, strict=True))}
    if kind == "box":
        size = source.numbers(shape, source.text(shape, "size"), 3, "size")
        return place, {"kind": kind, "size": above_zero(source, shape, size)}
    if kind != "mesh":
        raise refused_kind(source, shape, kind)
    file = find_mesh(source, shape, source.text(shape, "filename"), source.path.parent)
    scale = not_zero(source, shape, source.values(shape, "scale", (1.0, 1.0, 1.0)))
    return place, {"kind": kind, "file": str(file), "scale": scale}
