# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Geoms of MJCF that collide: where they are in their bodies, and how large."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.mjcf_classes import Context
from hapticmech_ros.formats.mjcf_inertias import shape_of
from hapticmech_ros.formats.model import Document, Solid
from hapticmech_ros.formats.shapes import above_zero, find_mesh, not_zero, refused_kind
from hapticmech_ros.formats.xml_nodes import Node

# MuJoCo's shape -> a scene's.
KINDS = {
    "plane": "half_space",
    "sphere": "sphere",
    "capsule": "capsule",
    "cylinder": "cylinder",
    "box": "box",
    "mesh": "mesh",
}
COLLIDES = "geom that collides"


def collides(context: Context, geom: Node) -> bool:
    """Return whether a geom, with its defaults, can collide with any other."""
    bits = (context.source.value(geom, key, 1.0) for key in ("contype", "conaffinity"))
    return any(bits)


def solid_of(context: Context, geom: Node, frame: pin.SE3, body: str) -> Solid:
    """Return a geom as a shape.

    Args:
        context: its file.
        geom: with its defaults.
        frame: that it is in, in the body's.
        body: that it is fixed in.
    """
    shape = context.word(geom, "type", "sphere")
    kind = KINDS.get(shape, shape)
    if shape != "mesh" and "mesh" in geom.attributes:
        kind = f"{shape} about a mesh"
    name = geom.attributes.get("name", "").strip()
    return Solid(name, body, kind, COLLIDES, partial(_read, context, geom, frame, kind))


def _read(context: Context, geom: Node, frame: pin.SE3, kind: str) -> tuple[pin.SE3, Document]:
    if kind not in KINDS.values():
        raise refused_kind(context.source, geom, kind)
    if kind == "mesh":
        within, geometry = _mesh(context, geom)
        return frame * context.place(geom) * within, geometry
    sizes, place = shape_of(context, geom)
    if kind != "half_space":
        sizes = tuple(above_zero(context.source, geom, sizes))
    return frame * place, {"kind": kind, **_sized(kind, sizes)}


def _sized(kind: str, sizes: tuple[float, ...]) -> Document:
    """Return sizes of a scene's shape from MuJoCo's, which are halves."""
    if kind == "sphere":
        return {"radius": sizes[0]}
    if kind == "box":
        return {"size": [2.0 * size for size in sizes]}
    return {} if kind == "half_space" else {"radius": sizes[0], "length": 2.0 * sizes[1]}


def _mesh(context: Context, geom: Node) -> tuple[pin.SE3, Document]:
    """Return a mesh's frame in its geom's, and the mesh: v becomes S R' (v - p)."""
    source = context.source
    asset = _asset(context, geom)
    if not asset.attributes.get("file", "").strip():
        raise source.error(asset, None, "a mesh for contacts needs a file")
    scale = np.array(not_zero(source, asset, source.values(asset, "scale", (1.0,) * 3)))
    ref = pin.SE3.Identity()
    ref.translation = np.array(source.values(asset, "refpos", (0.0, 0.0, 0.0)))
    ref.rotation = context.quaternion(asset, "refquat")
    turned = not np.allclose(ref.rotation, np.eye(3), rtol=0.0, atol=1e-12)
    if turned and np.ptp(scale) > 0.0:
        rule = "with refquat a mesh for contacts needs one scale for all its axes"
        raise source.error(asset, scale.tolist(), rule)
    within = pin.SE3(ref.rotation.T, -scale * (ref.rotation.T @ ref.translation))
    file = find_mesh(source, asset, _path(context, asset), source.path.parent)
    return within, {"kind": "mesh", "file": str(file), "scale": scale.tolist()}


def _asset(context: Context, geom: Node) -> Node:
    name = context.source.text(geom, "mesh")
    for assets in context.source.root.all("asset"):
        for mesh in assets.all("mesh"):
            file = mesh.attributes.get("file", "").strip()
            if (mesh.attributes.get("name", "").strip() or Path(file).stem) == name:
                return context.full(mesh)
    raise context.source.error(geom, name, "no such mesh in <asset>")


def _path(context: Context, asset: Node) -> str:
    """Return the file of a mesh from the main file's folder."""
    file = asset.attributes["file"].strip()
    if context.flag(context.compiler, "strippath"):
        file = Path(file).name
    folder = context.word(context.compiler, "assetdir", "")
    return str(Path(context.word(context.compiler, "meshdir", folder)) / file)
