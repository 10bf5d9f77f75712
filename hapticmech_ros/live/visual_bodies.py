# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a model's file draws of its links, as triangles: primitives, and meshes as their hulls.

A hull has few triangles, which is what a browser without a GPU needs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.live.instances import unit_body
from hapticmech_ros.loading import find_scene
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.scene.contacts import Box, Capsule, Cylinder, HalfSpace, Mesh, Sphere


class VisualBody(NamedTuple):
    """A body that is drawn of a link.

    Attributes:
        link: of the scene, or ``world``.
        place: its frame in the link's.
        corners: (n, 3) m, in its frame.
        triangles: (k, 3) of corners.
    """

    link: str
    place: pin.SE3
    corners: Array
    triangles: Array


def visual_bodies(scene: str) -> list[VisualBody]:
    """Return what the model's file of a scene draws; what cannot be read is left out.

    Args:
        scene: name of a shipped one, or a path.
    """
    # Here, so that scenes without a file of a model do not load what reads them.
    from hapticmech_ros.formats import drawn_shapes

    try:
        shapes = drawn_shapes(find_scene(scene))
    except HapticMechError:
        return []
    hulls = iter(_hulls_of([one.geometry for one in shapes if isinstance(one.geometry, Mesh)]))
    found = []
    for shape in shapes:
        geometry = shape.geometry
        body = next(hulls) if isinstance(geometry, Mesh) else _primitive(geometry)
        if body is not None:
            found.append(VisualBody(shape.link, se3(shape.origin), *body))
    return found


def _hulls_of(meshes: list[Mesh]) -> list[tuple[Array, Array] | None]:
    if not meshes:
        return []
    from hapticmech_ros.contact.mesh_hulls import drawn_hulls

    found = drawn_hulls(meshes)
    return [None if one is None else (one.vertices, one.triangles) for one in found]


def _primitive(
    geometry: Sphere | Box | Cylinder | Capsule | HalfSpace,
) -> tuple[Array, Array] | None:
    """Return corners and triangles of a body; None for a half-space, which has no end."""
    if isinstance(geometry, HalfSpace):
        return None
    if isinstance(geometry, Box):
        corners, triangles = unit_body("box")
        return corners * np.array(geometry.size), triangles
    thick = 2.0 * geometry.radius
    if isinstance(geometry, Cylinder):
        corners, triangles = unit_body("cylinder")
        return corners * np.array((thick, thick, geometry.length)), triangles
    corners, triangles = unit_body("sphere")
    if isinstance(geometry, Sphere):
        return thick * corners, triangles
    # A capsule: a ball whose halves are apart.
    apart = 0.5 * geometry.length * np.sign(np.round(corners[:, 2:], 9))
    return thick * corners + apart * np.array((0.0, 0.0, 1.0)), triangles
