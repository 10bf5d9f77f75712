# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes of SDFormat: where they are in their links, and how large."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.model import Document, Solid, from_z
from hapticmech_ros.formats.shapes import SIZES, find_mesh, not_zero, refused_kind, sized
from hapticmech_ros.formats.xml_nodes import Node, Source

# Of sizes that are left out; all others are 1 m.
DEFAULTS = {("capsule", "radius"): 0.5}
KINDS = {"plane": "half_space"}


def solid_of(source: Source, node: Node, link: str, place: Callable[[], pin.SE3]) -> Solid:
    """Return a <collision> of a link.

    Args:
        source: the file.
        node: the element.
        link: that it is in.
        place: returns the element's frame in the link's.
    """
    geometry = node.first("geometry")
    shape = geometry.children[0] if geometry is not None and geometry.children else None
    kind = "nothing" if shape is None else KINDS.get(shape.tag, shape.tag)
    name = node.attributes.get("name", "").strip()
    if shape is None:
        shape = node
    return Solid(name, link, kind, "collision", partial(_read, source, shape, kind, place))


def _read(
    source: Source, shape: Node, kind: str, place: Callable[[], pin.SE3]
) -> tuple[pin.SE3, Document]:
    if kind in SIZES:
        return place(), sized(
            source,
            shape,
            kind,
            lambda key, count: source.inside(shape, key, (DEFAULTS.get((kind, key), 1.0),) * count),
        )
    if kind == "half_space":
        return place() * _above(source, shape), {"kind": kind}
    if kind != "mesh":
        raise refused_kind(source, shape, kind)
    uri = shape.first("uri")
    if uri is None:
        raise source.error(shape, None, "a mesh needs a <uri>")
    if shape.first("submesh") is not None:
        raise source.error(shape, uri.text.strip(), "parts of meshes are not read")
    file = find_mesh(source, uri, uri.text.strip(), source.path.parent)
    scale = not_zero(source, shape, source.inside(shape, "scale", (1.0, 1.0, 1.0)))
    return place(), {"kind": kind, "file": str(file), "scale": scale}


def _above(source: Source, shape: Node) -> pin.SE3:
    """Return a frame whose z axis is a plane's normal."""
    normal = np.array(source.inside(shape, "normal", (0.0, 0.0, 1.0)))
    size = float(np.linalg.norm(normal))
    if not size > 0.0:
        raise source.error(shape, normal.tolist(), "a normal must not be zero")
    return from_z(normal / size)
