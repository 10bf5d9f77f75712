# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes as frozen descriptions: the source of markers and of any other picture.

Positions are in ``world``, m. A shape is known by its namespace and number, which stay the same
from picture to picture.

Links, joints and closures as shapes; sizes are shares of the mechanism's length ``unit``, m.

The ellipsoid of the mass felt at an operational point has the masses of
:func:`~hapticmech_ros.operational.results.felt_masses` as half axes; where X has no response, m is
infinite and the half axis ends at the longest one that is drawn.

Wrenches and directions as shapes: forces are arrows, torques are rings about their axis.

Columns n_i of the spectrum are unique only where their μ are: any rotation among equal ones will
do, and which one comes out changes from sample to sample. Drawn as they come they would flicker, so
they are turned first: forces are gathered into as few columns as possible.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Literal, NamedTuple

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.operational.results import felt_masses
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.contacts import Mesh
from hapticmech_ros.scene.mechanism import Joint
from hapticmech_ros.view import palette
from hapticmech_ros.view.palette import PLAIN, Colour, Look
from hapticmech_ros.view.placement import Placement
from hapticmech_ros.wire.contact_points import ContactPoints


class Direction(NamedTuple):
    """A wrench as shares of the largest ones of unit length in the metric; axes of the world.

    Attributes:
        force: (3,) of length 0 to 1.
        torque: (3,) of length 0 to 1.
    """

    force: Array
    torque: Array


def directions(
    analysis: OperationalAnalysis, count: int
) -> tuple[list[Direction], list[Direction]]:
    """Return rigid directions, ``count`` of them, and free ones: all the others.

    Raises:
        InvalidInputError: count is negative, or more than there are directions.
    """
    wrenches = np.zeros((6, analysis.rows.size))
    wrenches[analysis.rows] = analysis.spectrum.wrenches
    size = wrenches.shape[1]
    if not 0 <= count <= size:
        raise InvalidInputError("count", count, f"must be 0 to {size}")
    # I_ℓ is the sum of all n_i n_iᵀ, so the largest force and torque of a unit wrench are these.
    metric = wrenches @ wrenches.T
    largest_force = np.sqrt(np.linalg.eigvalsh(metric[:3, :3])[-1])
    largest_torque = np.sqrt(np.linalg.eigvalsh(metric[3:, 3:])[-1])
    parts = []
    for columns in (wrenches[:, size - count :], wrenches[:, : size - count]):
        turned = gathered(columns)
        parts.append([Direction(n[:3] / largest_force, n[3:] / largest_torque) for n in turned.T])
    return parts[0], parts[1]


def gathered(columns: Array) -> Array:
    """Return ``columns`` (6, k) turned among themselves, those of the largest force first.

    The forces of the result are perpendicular to each other, and the span is the same.

    Args:
        columns: (6, k) wrenches, forces first, world axes, in any unit.
    """
    if columns.shape[1] < 2:
        return columns
    _, _, turn = np.linalg.svd(columns[:3])
    return np.asarray(columns @ turn.T)


# Sizes as shares of the mechanism's characteristic length.
FORCE_SHAFT = 0.045
RIGID_SHAFT = 0.03
FREE_SHAFT = 0.012
DIRECTION_LENGTH = 0.6
RING_RADIUS = 0.4
# Shorter shapes than this are not drawn.
SMALLEST = 0.01
TORQUE = "/torque"


@dataclass(frozen=True, slots=True)
class Scales:
    """How long a wrench is drawn.

    Attributes:
        unit: the mechanism's characteristic length, m, for widths.
        force: length of an arrow, m per N.
        torque: radius of a ring, m per N m.
    """

    unit: float
    force: float
    torque: float


def wrench_shapes(
    meaning: str, number: int, place: Array, wrench: Array, scales: Scales, look: Look = PLAIN
) -> list[Shape]:
    """Return an arrow and a ring for a wrench (6,) at ``place`` (3,), tail and centre there.

    Of several wrenches in a namespace each has its number.

    Args:
        meaning: of the wrench, by which it is named and coloured.
        number: of this wrench in the namespace.
        place: (3,) m, world axes.
        wrench: (6,) N and N m, world axes.
        scales: characteristic length (m), m/N and m/(N m).
        look: of the user whose it is.
    """
    namespace, colour = look.namespace(meaning), look.colour(meaning)
    width = FORCE_SHAFT * scales.unit
    force, radius = scales.force * wrench[:3], scales.torque * float(np.linalg.norm(wrench[3:]))
    shapes: list[Shape] = []
    if np.linalg.norm(force) > SMALLEST * scales.unit:
        found = arrow(place, place + force, width, colour)
        shapes += numbered(namespace, found, first=number)
    if radius > SMALLEST * scales.unit:
        found = ring(place, wrench[3:], radius, 0.4 * width, colour, sense=True)
        shapes += numbered(namespace + TORQUE, found, first=2 * number)
    return shapes


def direction_shapes(
    meaning: str, found: Sequence[Direction], place: Array, unit: float, look: Look = PLAIN
) -> list[Shape]:
    """Return a double-headed arrow and a ring for every direction at ``place`` (3,).

    A direction has no sense, so a ring has no head. The longest arrow has ``DIRECTION_LENGTH`` to
    either side, the largest ring ``RING_RADIUS``, as shares of ``unit`` (m).

    Args:
        meaning: ``rigid_directions`` or ``free_directions``.
        found: the directions.
        place: (3,) m, world axes.
        unit: the mechanism's characteristic length, m.
        look: of the user who feels them.
    """
    namespace, colour = look.namespace(meaning), look.colour(meaning)
    shaft = (RIGID_SHAFT if meaning == "rigid_directions" else FREE_SHAFT) * unit
    shapes: list[Shape] = []
    for index, direction in enumerate(found):
        half = DIRECTION_LENGTH * unit * direction.force
        if np.linalg.norm(half) > SMALLEST * unit:
            arrows = double_arrow(place, half, shaft, colour)
            shapes += numbered(namespace, arrows, first=2 * index)
        radius = RING_RADIUS * unit * float(np.linalg.norm(direction.torque))
        if radius > SMALLEST * unit:
            circle = ring(place, direction.torque, radius, 0.5 * shaft, colour, sense=False)
            shapes += numbered(namespace + TORQUE, circle, first=index)
    return shapes


HULLS, FORCES = "hulls", "touch_force"


class Hulls:
    """Draws the convex hulls of a scene's meshes.

    Args:
        scene: that has them, or none.

    Raises:
        SceneError: a mesh that cannot be read.
    """

    def __init__(self, scene: Scene) -> None:
        self._corners: dict[int, Array] = {}
        if any(isinstance(shape.geometry, Mesh) for shape in scene.shapes):
            # Imported here: scenes without meshes do not need it.
            from hapticmech_ros.contact.hull import mesh_hulls

            hulls = mesh_hulls(scene.shapes)
            self._corners = {i: hull.vertices[hull.triangles.ravel()] for i, hull in hulls.items()}

    def draw(self, placement: Placement) -> list[Shape]:
        """Return every hull where its link is; its number is that of the scene's shape."""
        shapes, colour, size = [], palette.MEANING[HULLS], (1.0, 1.0, 1.0)
        for index, corners in self._corners.items():
            pose = placement.solids[index]
            points = corners @ pose.rotation.T + pose.translation
            world = pin.SE3.Identity()
            shapes.append(Shape(HULLS, index, "triangles", world, size, colour, points))
        return shapes


def touch_shapes(found: ContactPoints, scales: Scales) -> list[Shape]:
    """Return the force on shape a at each point of contact, as an arrow from there."""
    shapes: list[Shape] = []
    for number, (place, force) in enumerate(zip(found.points, found.forces, strict=True)):
        shapes += wrench_shapes(FORCES, number, place, np.append(force, np.zeros(3)), scales)
    return shapes


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
    for name, (start, end) in placement.limbs:
        shapes += moving_with(name, capsule(start, end, thick, palette.LINK))
    drawn = {name for name, _ in placement.limbs}
    for link in scene.links:
        if link.name not in drawn:
            ball = sphere(placement.links[link.name].translation, thick, palette.LINK)
            shapes += moving_with(link.name, [ball])
    return numbered("links", shapes)


def joint_shapes(scene: Scene, placement: Placement, unit: float) -> list[Shape]:
    """Return a shape for every joint that holds its link, and a line along which it slides."""
    shapes = [strip(line, SLIDE_WIDTH * unit, palette.JOINT) for line in placement.slides]
    for link in scene.links:
        pose, axis = placement.links[link.name], placement.axes[link.name]
        shapes += moving_with(link.name, joint_shape(link.joint, pose, axis, unit))
    return numbered("joints", shapes)


def joint_shape(joint: Joint, pose: pin.SE3, axis: Array, unit: float) -> list[Shape]:
    """Return a cylinder about a hinge, a box along a slide, a ball in a socket.

    Args:
        joint: its description.
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


Kind = Literal["cylinder", "sphere", "box", "arrow", "strip", "text", "triangles"]
Key = tuple[str, int]
# An arrow's head is no longer than this share of the arrow.
LONGEST_HEAD = 0.4
# A ring is open by this share of a turn, which shows its arrowhead; drawn by corners.
RING_GAP = 0.15
RING_CORNERS = 32
# Shorter than this (m) nothing has a direction.
_NOTHING = 1e-9


@dataclass(frozen=True, slots=True)
class Shape:
    """One shape.

    Attributes:
        namespace, number: together its name.
        kind: ``cylinder`` along its z, ``sphere``, ``box``; ``arrow`` or line (``strip``) through
            ``points``; ``text`` that faces the viewer; ``triangles``, three ``points`` each.
        pose: frame of the shape in the world; identity where ``points`` suffice.
        size: m. Diameters and length of a cylinder, diameters of a sphere, edges of a box;
            diameters of shaft and head and length of the head of an arrow; width of a strip;
            height of letters last for a text; ones for triangles.
        colour: red, green, blue and opacity, 0 to 1.
        points: (n, 3) in the world: tail and tip of an arrow, corners of a strip or of triangles.
        text: of a text shape.
    """

    namespace: str
    number: int
    kind: Kind
    pose: pin.SE3
    size: tuple[float, float, float]
    colour: Colour
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    text: str = ""

    @property
    def key(self) -> Key:
        """Return namespace and number."""
        return self.namespace, self.number

    @property
    def meaning(self) -> str:
        """Return its meaning: its namespace up to the first slash."""
        return self.namespace.partition("/")[0]


def numbered(namespace: str, shapes: Iterable[Shape], first: int = 0) -> list[Shape]:
    """Return the shapes under a namespace, numbered from ``first``."""
    return [replace(s, namespace=namespace, number=i) for i, s in enumerate(shapes, first)]


@dataclass(frozen=True, slots=True)
class LinkShape(Shape):
    """A shape that moves with a link, as arrows do not.

    Attributes:
        link: its name, or ``world``.
    """

    link: str = ""


def moving_with(link: str, shapes: Iterable[Shape]) -> list[LinkShape]:
    """Return the shapes as those of a link."""
    names = [one.name for one in fields(Shape)]
    return [LinkShape(**{n: getattr(shape, n) for n in names}, link=link) for shape in shapes]


def vanished(before: Iterable[Key], now: Iterable[Shape]) -> list[Key]:
    """Return the keys that were shown before and are no more, in a fixed order."""
    return sorted(set(before) - {shape.key for shape in now})


def cylinder(centre: Array, along: Array, diameter: float, colour: Colour) -> Shape:
    """Return a cylinder about ``centre``; ``along`` (3,) is its axis times its length, m.

    Args:
        centre: (3,) m.
        along: (3,) its axis times its length, m.
        diameter: m.
        colour: of the palette.
    """
    length = float(np.linalg.norm(along))
    pose = pin.SE3(rotation_to(along), np.asarray(centre))
    return Shape("", 0, "cylinder", pose, (diameter, diameter, length), colour)


def capsule(start: Array, end: Array, diameter: float, colour: Colour) -> list[Shape]:
    """Return a cylinder from ``start`` to ``end`` with round ends.

    Args:
        start: (3,) m.
        end: (3,) m.
        diameter: m.
        colour: of the palette.
    """
    ends = [sphere(point, diameter, colour) for point in (start, end)]
    return [cylinder(0.5 * (start + end), end - start, diameter, colour), *ends]


def sphere(centre: Array, diameter: float, colour: Colour) -> Shape:
    """Return a sphere.

    Args:
        centre: (3,) m.
        diameter: m.
        colour: of the palette.
    """
    pose = pin.SE3(np.eye(3), np.asarray(centre))
    return Shape("", 0, "sphere", pose, (diameter,) * 3, colour)


def box(pose: pin.SE3, size: tuple[float, float, float], colour: Colour) -> Shape:
    """Return a box with its edges along the axes of ``pose``."""
    return Shape("", 0, "box", pose, size, colour)


def arrow(tail: Array, tip: Array, shaft: float, colour: Colour) -> list[Shape]:
    """Return an arrow with a shaft of diameter ``shaft``, m; none where it has no length.

    Args:
        tail: (3,) m.
        tip: (3,) m.
        shaft: its diameter, m.
        colour: of the palette.
    """
    length = float(np.linalg.norm(tip - tail))
    if length < _NOTHING:
        return []
    head = min(4.0 * shaft, LONGEST_HEAD * length)
    size = (shaft, 2.5 * shaft, head)
    points = np.array((tail, tip))
    return [Shape("", 0, "arrow", pin.SE3.Identity(), size, colour, points)]


def double_arrow(centre: Array, half: Array, shaft: float, colour: Colour) -> list[Shape]:
    """Return two arrows from ``centre``, along ``half`` (3,), m, and against it.

    Args:
        centre: (3,) m.
        half: (3,) from the centre to a tip, m.
        shaft: its diameter, m.
        colour: of the palette.
    """
    return [
        *arrow(centre, centre + half, shaft, colour),
        *arrow(centre, centre - half, shaft, colour),
    ]


def strip(points: Array, width: float, colour: Colour) -> Shape:
    """Return a line through ``points`` (n, 3).

    Args:
        points: (n, 3) m.
        width: m.
        colour: of the palette.
    """
    return Shape("", 0, "strip", pin.SE3.Identity(), (width, 0.0, 0.0), colour, points)


def ring(
    centre: Array, axis: Array, radius: float, width: float, colour: Colour, sense: bool
) -> list[Shape]:
    """Return a ring about ``axis`` (3,).

    Args:
        centre: (3,) m.
        axis: (3,) normal of its plane, of any length; of length zero: nothing is drawn.
        radius: m.
        width: of the line, m.
        colour: of line and arrowhead.
        sense: leave it open and put an arrowhead on its end, turning right-handed about the axis.
    """
    if np.linalg.norm(axis) < _NOTHING or radius < _NOTHING:
        return []
    turn = 2.0 * np.pi * (1.0 - RING_GAP if sense else 1.0)
    angles = np.linspace(0.0, turn, RING_CORNERS + 1)
    across = rotation_to(axis)[:, :2]
    corners = centre + radius * np.column_stack((np.cos(angles), np.sin(angles))) @ across.T
    shapes = [strip(corners, width, colour)]
    if sense:
        forward = across @ np.array((-np.sin(turn), np.cos(turn)))
        head = min(5.0 * width, radius)
        tip = corners[-1] + head * forward
        size = (0.5 * width, 3.0 * width, 0.98 * head)
        points = np.array((corners[-1], tip))
        shapes.append(Shape("", 0, "arrow", pin.SE3.Identity(), size, colour, points))
    return shapes


def axes(
    pose: pin.SE3, length: float, shaft: float, colours: tuple[Colour, Colour, Colour]
) -> list[Shape]:
    """Return cylinders from the origin of ``pose`` along its x, y and z."""
    ends = [length * pose.rotation[:, i] for i in range(3)]
    return [
        cylinder(pose.translation + 0.5 * end, end, shaft, colour)
        for end, colour in zip(ends, colours, strict=True)
    ]


def text(place: Array, words: str, height: float, colour: Colour) -> Shape:
    """Return words that face the viewer, ``height`` m high.

    Args:
        place: (3,) m.
        words: the text.
        height: m.
        colour: of the palette.
    """
    pose = pin.SE3(np.eye(3), np.asarray(place))
    return Shape("", 0, "text", pose, (0.0, 0.0, height), colour, text=words)


def rotation_to(direction: Array) -> Array:
    """Return a rotation (3, 3) whose z is along ``direction`` (3,); identity where it has none.

    Args:
        direction: (3,).
    """
    length = float(np.linalg.norm(direction))
    if length < _NOTHING:
        return np.eye(3)
    z = direction / length
    # The world's axis that is least along z makes a right angle with it most safely.
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack((x, np.cross(z, x), z))
