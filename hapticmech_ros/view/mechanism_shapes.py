# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Links, joints and closures as shapes; sizes are shares of the mechanism's length ``unit``, m.

The ellipsoid of the mass felt at an operational point has the masses of
:func:`~hapticmech_ros.operational.results.felt_masses` as half axes; where X has no response, m is
infinite and the half axis ends at the longest one that is drawn.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.results import felt_masses
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Joint
from hapticmech_ros.view import palette
from hapticmech_ros.view.placement import Placement
from hapticmech_ros.view.shapes import (
    Shape,
    box,
    capsule,
    cylinder,
    numbered,
    rotation_to,
    sphere,
    strip,
)
from hapticmech_ros.view.user_look import PLAIN, Look

LINK_DIAMETER = 0.07
JOINT_DIAMETER = 0.13
JOINT_LENGTH = 0.18
SLIDE_WIDTH = 0.03
CLOSURE_DIAMETER = 0.15
GAP_WIDTH = 0.015


def link_shapes(scene: Scene, placement: Placement, unit: float) -> list[Shape]:
    """Return a capsule for every limb; a ball for a link that has none."""
    thick = LINK_DIAMETER * unit
    shapes: list[Shape] = []
    for _, (start, end) in placement.limbs:
        shapes += capsule(start, end, thick, palette.LINK)
    drawn = {name for name, _ in placement.limbs}
    shapes += [
        sphere(placement.links[link.name].translation, thick, palette.LINK)
        for link in scene.links
        if link.name not in drawn
    ]
    return numbered("links", shapes)


def joint_shapes(scene: Scene, placement: Placement, unit: float) -> list[Shape]:
    """Return a shape for every joint that holds its link, and a line along which it slides."""
    shapes = [strip(line, SLIDE_WIDTH * unit, palette.JOINT) for line in placement.slides]
    for link in scene.links:
        pose, axis = placement.links[link.name], placement.axes[link.name]
        shapes += joint_shape(link.joint, pose, axis, unit)
    return numbered("joints", shapes)


def joint_shape(joint: Joint, pose: pin.SE3, axis: Array, unit: float) -> list[Shape]:
    """Return a cylinder about a hinge, a box along a slide, a ball in a socket.

    Args:
        joint: what it is.
        pose: frame of the link it carries, in the world.
        axis: (3,) unit vector, world axes.
        unit: characteristic length, m.
    """
    thick, length = JOINT_DIAMETER * unit, JOINT_LENGTH * unit
    if joint.type == "revolute":
        return [cylinder(pose.translation, length * axis, thick, palette.JOINT)]
    if joint.type == "prismatic":
        along = pin.SE3(rotation_to(axis), pose.translation)
        return [box(along, (0.6 * thick, 0.6 * thick, 2.0 * length), palette.JOINT)]
    if joint.type == "spherical":
        return [sphere(pose.translation, 1.2 * thick, palette.JOINT)]
    return []


def closure_shapes(placement: Placement, closed: Mapping[str, bool], unit: float) -> list[Shape]:
    """Return a ball where a loop is closed, a rod with its ends; two and the gap where it is open.

    Numbers do not depend on which are closed: 0 for the first closure, 3 for the second, ...
    """
    shapes = []
    for index, (name, (a, b)) in enumerate(placement.closures.items()):
        size = CLOSURE_DIAMETER * unit
        ends = np.array((a.translation, b.translation))
        namespace, colour = "open_closures", palette.OPEN
        if closed[name]:
            namespace, colour = "closures", palette.CLOSED
        if closed[name] and name not in placement.rods:
            found = [sphere(a.translation, size, colour)]
        else:
            found = [sphere(end, 0.7 * size, colour) for end in ends]
            found.append(strip(ends, GAP_WIDTH * unit, colour))
        shapes += numbered(namespace, found, first=3 * index)
    return shapes


MASS = "mass"
# Of a planar scene the ellipsoid is a disc, this thick as a share of its longest half axis.
_THIN = 0.02


def mass_ellipsoid(
    analysis: OperationalAnalysis,
    place: Array,
    metres_per_kg: float,
    longest: float,
    look: Look = PLAIN,
) -> list[Shape]:
    """Return the ellipsoid of the mass felt, a disc in a planar scene.

    Args:
        analysis: of the point.
        place: (3,) of the point, m, world axes.
        metres_per_kg: how long a half axis is drawn.
        longest: half axis that is drawn, m.
        look: of the user who feels it.
    """
    masses, directions = felt_masses(analysis)
    halves = np.minimum(metres_per_kg * masses, longest)
    axes = np.eye(3)
    axes[:, : masses.size] = directions
    sizes = np.full(3, _THIN * longest)
    sizes[: masses.size] = halves
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0
    x, y, z = (2.0 * sizes).tolist()
    pose = pin.SE3(axes, np.asarray(place))
    return [Shape(look.namespace(MASS), 0, "sphere", pose, (x, y, z), look.colour(MASS))]
