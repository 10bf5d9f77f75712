# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Of which link a shape of the picture is, so that whoever grabs it drags that link."""

from __future__ import annotations

from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.contacts import Capsule, Mesh
from hapticmech_ros.view import Placement
from hapticmech_ros.view.mechanism_shapes import joint_shape
from hapticmech_ros.view.shapes import Key

# A limb is a capsule: a cylinder and two balls. Of a mesh there is no shape, but a hull.
_CAPSULE = 3


def shape_links(scene: Scene, placement: Placement) -> dict[Key, str]:
    """Return shape -> name of the link that it moves with; what is fixed is left out."""
    drawn = [name for name, _ in placement.limbs for _ in range(_CAPSULE)]
    limbs = {name for name, _ in placement.limbs}
    drawn += [link.name for link in scene.links if link.name not in limbs]
    joints = [link.name for link in scene.links if link.joint.type == "prismatic"]
    for link in scene.links:
        pose, axis = placement.links[link.name], placement.axes[link.name]
        joints += [link.name] * len(joint_shape(link.joint, pose, axis, 1.0))
    solids: list[str] = []
    for shape in scene.shapes:
        parts = _CAPSULE if isinstance(shape.geometry, Capsule) else 1
        solids += [shape.link] * (0 if isinstance(shape.geometry, Mesh) else parts)
    found = {
        (namespace, number): name
        for namespace, names in (("links", drawn), ("joints", joints), ("solids", solids))
        for number, name in enumerate(names)
    }
    for point in scene.operational_points:
        for axes in (f"point/{point.name}", f"point/{point.name}_world"):
            found.update({(axes, number): point.link for number in range(3)})
    return {key: name for key, name in found.items() if name in placement.links}
