# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of a live session: shapes, hulls of meshes, and which of them can be dragged.

Meshes that may touch are drawn as their hulls, others as they are, or coarser: a browser without a
GPU needs few triangles.

Shapes are instances of a few unit bodies: arrays that a page sends whole, one set for each body.

An instance keeps its place in the arrays as long as its shape is drawn: the place identifies a
grabbed shape. Free places are drawn without size.

A page sends a picture as lines and sets of instances: of one body, all to be grabbed or none, all
opaque or none. A browser draws what is translucent last, and so it hides nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Literal, NamedTuple, cast

import numpy as np
import pinocchio as pin

from hapticmech_ros.contact.hull import drawn_meshes, mesh_hulls
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.live.commands import Draggable, LiveState, Opened, UserState
from hapticmech_ros.loading import find_scene
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import quaternion_of
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.observation import Observation
from hapticmech_ros.operational.results import felt_masses
from hapticmech_ros.scene.contacts import Box, Capsule, Cylinder, HalfSpace, Mesh, Sphere
from hapticmech_ros.view import Picture, Placement, Placer, Shape, Snapshot, UserSnapshot, palette
from hapticmech_ros.view.drawn import ABOVE, ASIDE, scale_of
from hapticmech_ros.view.palette import Colour, hues, looks
from hapticmech_ros.view.picture import DEVICE_DIAMETER
from hapticmech_ros.view.shapes import MASS, LinkShape, mass_ellipsoid, rotation_to

Body = Literal["sphere", "cylinder", "box", "cone"]
BODIES: tuple[Body, ...] = ("sphere", "cylinder", "box", "cone")
# Corners around the axis of round bodies, and of those that are seen large, such as the ellipsoid.
AROUND, AROUND_LARGE = 16, 32
# Places are added in such steps: one more arrow seldom needs a new set. Spheres are no parts of
# arrows, and have many corners, which take time even where nothing is drawn.
_STEP: dict[Body, int] = {"sphere": 1, "cylinder": 4, "box": 4, "cone": 4}
# Size of undrawn instances, m: with 0 their transform would be singular.
_NOTHING = 1e-9
_UPRIGHT = np.array((1.0, 0.0, 0.0, 0.0))
# (body, part of the shape, centre, quaternion w x y z, scale, colour)
_Part = tuple[Body, int, Array, Array, Array, Colour]


@dataclass(slots=True)
class InstanceArrays:
    """Instances of one body.

    Attributes:
        positions: (n, 3) m.
        quaternions: (n, 4) w, x, y, z.
        scales: (n, 3) m.
        colours: (n, 3) red, green and blue, 0 to 255.
        opacities: (n,) 0 to 1.
        shapes: drawn at each place; None for a free one.
    """

    positions: Array
    quaternions: Array
    scales: Array
    colours: Array
    opacities: Array
    shapes: list[Shape | None]


class Instances:
    """Instances of one body, frame by frame.

    Args:
        body: that they are of.
    """

    def __init__(self, body: Body) -> None:
        self._step = _STEP[body]
        self._places: dict[tuple[str, int, int], int] = {}
        self._free: list[int] = []
        self._size = 0

    def arranged(self, parts: Sequence[tuple[Shape, _Part]]) -> InstanceArrays:
        """Return the arrays of a frame; they grow where more is drawn than ever before."""
        keys = [(*shape.key, part[1]) for shape, part in parts]
        for gone in self._places.keys() - set(keys):
            self._free.append(self._places.pop(gone))
        for key in keys:
            if key not in self._places:
                if not self._free:
                    self._free = list(range(self._size + self._step - 1, self._size - 1, -1))
                    self._size += self._step
                self._places[key] = self._free.pop()
        n = self._size
        found = InstanceArrays(
            np.zeros((n, 3), dtype=np.float32),
            np.tile(_UPRIGHT.astype(np.float32), (n, 1)),
            np.full((n, 3), _NOTHING, dtype=np.float32),
            np.zeros((n, 3), dtype=np.uint8),
            np.zeros(n, dtype=np.float32),
            [None] * n,
        )
        for key, (shape, (_, _, centre, quaternion, scale, colour)) in zip(
            keys, parts, strict=True
        ):
            at = self._places[key]
            found.positions[at], found.quaternions[at] = centre, quaternion
            found.scales[at] = np.maximum(scale, _NOTHING)
            found.colours[at] = [round(255 * part) for part in colour[:3]]
            found.opacities[at] = colour[3]
            found.shapes[at] = shape
        return found


class NodeKey(NamedTuple):
    """A set of instances.

    Attributes:
        body: that they are of.
        grabbed: whether they can be grabbed.
        opaque: whether they hide what is behind them.
    """

    body: Body
    grabbed: bool
    opaque: bool


# Shapes that can be grabbed, by the first part of their namespace: arrows do not block others.
_GRABBED = frozenset({"links", "joints", "solids", "device", "point"})


def instance_parts(shapes: Sequence[Shape]) -> dict[NodeKey, list[tuple[Shape, _Part]]]:
    """Return shapes as parts, by set; lines are none, and texts and triangles are left out."""
    found: dict[NodeKey, list[tuple[Shape, _Part]]] = {}
    for shape in shapes:
        grabbed, opaque = shape.meaning in _GRABBED, shape.colour[3] == 1.0
        for part in _parts(shape):
            found.setdefault(NodeKey(part[0], grabbed, opaque), []).append((shape, part))
    return found


def line_segments(shapes: Sequence[Shape]) -> tuple[Array, Array]:
    """Return (n, 2, 3) ends, m, and (n, 2, 3) colours, 0 to 255, of the lines among shapes.

    Of none a line without length, as a page takes no empty set.
    """
    ends, rgb = [], []
    for shape in shapes:
        if shape.kind == "strip":
            ends.append(np.stack((shape.points[:-1], shape.points[1:]), axis=1))
            rgb.append(np.tile(np.array(shape.colour[:3]), (len(shape.points) - 1, 2, 1)))
    if not ends:
        return np.zeros((1, 2, 3)), np.zeros((1, 2, 3), dtype=np.uint8)
    return np.concatenate(ends), np.round(255.0 * np.concatenate(rgb)).astype(np.uint8)


def _parts(shape: Shape) -> list[_Part]:
    colour = shape.colour
    if shape.kind in ("sphere", "cylinder", "box"):
        body, turned = cast(Body, shape.kind), _wxyz(shape.pose.rotation)
        return [(body, 0, shape.pose.translation, turned, np.array(shape.size), colour)]
    if shape.kind == "arrow":
        tail, tip = shape.points
        shaft, head, length = shape.size
        along = (tip - tail) / float(np.linalg.norm(tip - tail))
        neck, turned = tip - length * along, _wxyz(rotation_to(along))
        long = float(np.linalg.norm(neck - tail))
        return [
            ("cylinder", 0, 0.5 * (tail + neck), turned, np.array((shaft, shaft, long)), colour),
            ("cone", 1, 0.5 * (neck + tip), turned, np.array((head, head, length)), colour),
        ]
    return []


def _wxyz(rotation: Array) -> Array:
    return np.roll(quaternion_of(rotation), 1)


@cache
def unit_body(body: Body, around: int = AROUND) -> tuple[Array, Array]:
    """Return corners (n, 3) and triangles (k, 3) of a body of diameter, edges and height 1.

    Its centre is at the origin, and its axis along z; a cone's tip is at z = 0.5. Seen from outside
    each triangle turns left.

    Args:
        body: its kind.
        around: how many corners a round one has around its axis; a multiple of 4.
    """
    if body == "box":
        corners = np.array(
            [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
        )
        sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        return corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    if body == "sphere":
        tilt = np.linspace(0.0, np.pi, around // 2 + 1)
        profile = np.column_stack((0.5 * np.sin(tilt), 0.5 * np.cos(tilt)))
    elif body == "cylinder":
        profile = np.array(
            ((0.0, 0.5), (0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (0.5, -0.5), (0.0, -0.5))
        )
    else:
        profile = np.array(((0.0, 0.5), (0.5, -0.5), (0.5, -0.5), (0.0, -0.5)))
    return _turned(profile, around)


def _turned(profile: Array, corners_around: int) -> tuple[Array, Array]:
    """Return a body of revolution about z; profile (m, 2) of radius and height goes downwards."""
    turn = np.linspace(0.0, 2.0 * np.pi, corners_around, endpoint=False)
    corners: list[tuple[float, float, float]] = []
    rows: list[list[int]] = []
    for radius, height in profile.tolist():
        around = turn if radius > _NOTHING else turn[:1]
        first = len(corners)
        corners += [(radius * np.cos(a), radius * np.sin(a), height) for a in around]
        rows.append([first + i % len(around) for i in range(corners_around + 1)])
    triangles = []
    for above, below in pairwise(rows):
        for i in range(corners_around):
            a, b, c, d = above[i], above[i + 1], below[i], below[i + 1]
            triangles += [t for t in ((a, c, d), (a, d, b)) if len(set(t)) == len(t)]
    places, found = np.array(corners), np.array(triangles)
    edges = places[found]
    area = np.linalg.norm(np.cross(edges[:, 1] - edges[:, 0], edges[:, 2] - edges[:, 0]), axis=1)
    return places, found[area > _NOTHING**2]


class Solid(NamedTuple):
    """A body with corners of its own that is drawn of a link; of a mesh that may touch its hull.

    Attributes:
        link: of the scene, or ``world``.
        place: its frame in the link's.
        corners: (n, 3) m, in its frame.
        triangles: (k, 3) of corners.
        colour: of its file, or of the palette.
    """

    link: str
    place: pin.SE3
    corners: Array
    triangles: Array
    colour: Colour


def visual_bodies(scene: str) -> list[Solid]:
    """Return the drawn shapes of a scene's model file; unreadable ones are left out.

    Args:
        scene: name of a shipped one, or a path.
    """
    # Imported here: scenes without a model file do not need it.
    from hapticmech_ros.formats import drawn_shapes

    try:
        shapes = drawn_shapes(find_scene(scene))
    except HapticMechError:
        return []
    geometries = [one.shape.geometry for one in shapes]
    meshes = iter(drawn_meshes([one for one in geometries if isinstance(one, Mesh)]))
    found = []
    for (shape, colour), geometry in zip(shapes, geometries, strict=True):
        body = next(meshes) if isinstance(geometry, Mesh) else _primitive(geometry)
        if body is not None and (colour is None or colour[3] > 0.0):
            place = se3(shape.origin)
            found.append(
                Solid(shape.link, place, *body, palette.LINK if colour is None else colour)
            )
    return found


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


# Arrows and rings: length of the device's largest wrench, as a share of the mechanism.
FORCE_SHARE, TORQUE_SHARE = 1.0, 0.5
# Half axes of the ellipsoid: the lightest direction at the start, and the longest one drawn.
LIGHTEST_SHARE, LONGEST_SHARE = 0.15, 0.6
# The ball of the hand is larger than elsewhere, as users grab it.
_BALL = 1.6
# First distance of the camera, as a share of the picture's size.
DISTANCE = 1.6
# The ground: squares of at most this share of the picture's size, how far it goes to each side, and
# how far it is behind a planar mechanism.
_CELL, _GROUND, _BEHIND = 0.2, 1.0, 0.1
# The layer of a model file's drawn shapes, in place of rods.
VISUALS = "shapes of the model's file"
# Layers that users may hide, and the prefixes of their shapes' namespaces.
LAYERS: dict[str, tuple[str, ...]] = {
    "forces": ("hand_force", "device_command", "contact_force", "point_command"),
    "rigid and free directions": ("rigid_directions", "free_directions"),
    "mass felt": (MASS,),
    "axes": ("point/",),
    VISUALS: (),
}


@dataclass(frozen=True, slots=True)
class LiveFrame:
    """One picture.

    Attributes:
        shapes: in it.
        solids: number of a solid -> pose in the world.
        placement: where all is.
        analyses: of each point that is held, by its name.
        masses: (k,) felt there, kg, lightest first, infinite in directions that are rigid to
            the scene's ``perception``.
    """

    shapes: list[Shape]
    solids: dict[int, pin.SE3]
    placement: Placement
    analyses: dict[str, OperationalAnalysis]
    masses: dict[str, Array]


class LivePicture:
    """Draws the states of a scene.

    Args:
        opened: the scene.

    Attributes:
        closures: names, as a state has them.
        solids: number of a mesh among the scene's shapes -> its hull; shapes drawn by the model's
            file have negative numbers.
        unit: the mechanism's length, m.
        ball: radius of a hand's ball, m.
        planar: whether all is in a plane.
        directions: in which the devices render.
        users: operational points that are held.
        hues: of the users, where there are several.

    Raises:
        SceneError: a mesh that cannot be read.
    """

    def __init__(self, opened: Opened) -> None:
        scene = opened.scene
        self._scene, self.users = scene, opened.users
        self.hues, self._looks = hues(opened.users), looks(opened.users)
        self._mechanism = mechanism = Mechanism(scene)
        self.closures = [closure.name for closure in mechanism.closures]
        self._analysers = {point: Analyser(mechanism, point) for point in opened.users}
        self._placer = Placer(mechanism)
        self.unit, self.planar = mechanism.length, scene.task_space == "planar"
        self.ball = 0.5 * _BALL * DEVICE_DIAMETER * self.unit
        self.directions = len(scene.task_rows)
        held = {point: scene.held_at(point) for point in opened.users}
        devices = [one.device for one in held.values()]
        self._rigid_below = {point: one.perception.s_on for point, one in held.items()}
        self._picture = Picture(
            mechanism,
            FORCE_SHARE * self.unit / max((one.force_limit for one in devices), default=1.0),
            TORQUE_SHARE * self.unit / max((one.torque_limit for one in devices), default=1.0),
        )
        visuals = visual_bodies(opened.asked.scene)
        self.solids = {-1 - i: one for i, one in enumerate(visuals)}
        for number, hull in mesh_hulls(scene.shapes).items():
            shape = scene.shapes[number]
            place, colour = se3(shape.origin), palette.MEANING["hulls"]
            self.solids[number] = Solid(shape.link, place, hull.vertices, hull.triangles, colour)
        self._covered = {visual.link for visual in visuals}
        self._metres_per_kg = 0.0
        self._instances: dict[NodeKey, Instances] = {}

    def draw(self, state: LiveState, hidden: frozenset[str] = frozenset()) -> LiveFrame:
        """Return the picture of a state of this scene, without some layers."""
        placement = self._placer.at(state.q)
        analyses = {user.point: self._analysis(user) for user in state.users}
        masses = {point: self._masses(point, found) for point, found in analyses.items()}
        snapshot = Snapshot(
            active=state.active,
            users=tuple(
                UserSnapshot(
                    user.point,
                    pin.SE3(user.device[:, :3], user.device[:, 3]),
                    user.hand_wrench,
                    user.on_hand,
                    analyses[user.point],
                    user.count,
                )
                for user in state.users
            ),
            contacts={user.point: user.contact for user in state.users},
            point_commands={user.point: user.on_mechanism for user in state.users},
        )
        lightest = min((float(found[0]) for found in masses.values()), default=np.inf)
        if self._metres_per_kg == 0.0 and np.isfinite(lightest):
            self._metres_per_kg = LIGHTEST_SHARE * self.unit / lightest
        longest = LONGEST_SHARE * self.unit
        shapes = self._picture.draw(snapshot, placement)
        for point, found in analyses.items():
            place, look = placement.points[point].translation, self._looks[point]
            shapes += mass_ellipsoid(found, place, self._metres_per_kg, longest, look)
        shapes = [_enlarged(one) if one.meaning == "device" else one for one in shapes]
        without = tuple(start for layer in hidden for start in LAYERS[layer])
        shown = [s for s in shapes if s.kind != "text" and not s.namespace.startswith(without)]
        with_visuals = VISUALS not in hidden
        links = {**placement.links, "world": pin.SE3.Identity()}
        poses = {
            number: links[one.link] * one.place
            for number, one in self.solids.items()
            if number >= 0 or with_visuals
        }
        if with_visuals:
            shown = [
                s for s in shown if s.namespace != "links" or self.link_of(s) not in self._covered
            ]
        return LiveFrame(shown, poses, placement, analyses, masses)

    def drawn(self, state: LiveState, hidden: frozenset[str]) -> Drawn:
        """Return the picture of a state as a page sends it, without some layers.

        Shapes keep their places in the arrays from picture to picture.
        """
        frame, instances = self.draw(state, hidden), {}
        parts = instance_parts(frame.shapes)
        for key in {**self._instances, **parts}:
            known = self._instances.setdefault(key, Instances(key.body))
            instances[key] = known.arranged(parts.get(key, []))
        return Drawn(self, state, frame, instances, line_segments(frame.shapes))

    def link_of(self, drawn: Shape | Solid) -> str | None:
        """Return the link that a shape moves with; None for shapes of no link, such as arrows."""
        link = drawn.link if isinstance(drawn, LinkShape | Solid) else None
        return link if any(one.name == link for one in self._scene.links) else None

    def hand_at(self, state: LiveState, eye: Array, place: Array) -> str | None:
        """Return the hand on the ray to a place, even if another shape is in front of it.

        Args:
            state: that is seen.
            eye: (3,) from where it is seen, m, world axes.
            place: (3,) that is pointed at, likewise.

        Returns:
            The operational point that the hand holds: of several at that place the nearest one to
            the ray; None if none is meant.
        """
        if not state.users:
            return None
        ray = (place - eye) / max(float(np.linalg.norm(place - eye)), 1e-12)
        there = np.array([user.device[:, 3] - eye for user in state.users])
        aside = np.linalg.norm(there - np.outer(there @ ray, ray), axis=1)
        within = aside.min() < self.ball
        return state.users[int(aside.argmin())].point if within else None

    def _masses(self, point: str, found: OperationalAnalysis) -> Array:
        """Return the masses (k,) felt, kg: infinite where a direction is a joint constraint."""
        masses, directions = felt_masses(found)
        rows = found.rows < 3
        # Of the link alone 1/m is f·I_ℓ⁻¹ f, and s² the ratio of the two.
        alone = np.square(found.spectrum.duals[rows].T @ directions[found.rows[rows]]).sum(axis=0)
        rigid = 1.0 / masses <= self._rigid_below[point] ** 2 * alone
        return np.where(rigid, np.inf, masses)

    def _analysis(self, user: UserState) -> OperationalAnalysis:
        analyser = self._analysers[user.point]
        nv = self._mechanism.nv
        return Observation(user.observation, analyser.rows, nv).analysis


def _enlarged(shape: Shape) -> Shape:
    x, y, z = shape.size
    size = (_BALL * x, _BALL * y, _BALL * z)
    return replace(shape, size=size) if shape.kind == "sphere" else shape


def first_view(shapes: Sequence[Shape], planar: bool) -> tuple[Array, Array, Array]:
    """Return the camera's place (3,) and target (3,), m, and its upward direction (3,).

    A planar scene is seen from above, with y upwards. Forces at the start, as in a running graph,
    have no effect.
    """
    centre, size, _ = _extent(shapes)
    towards = ABOVE if planar else ASIDE / np.linalg.norm(ASIDE)
    up = np.array((0.0, 1.0, 0.0)) if planar else ABOVE
    return centre + DISTANCE * size * towards, centre, up


class Ground(NamedTuple):
    """A grid of squares below a mechanism; one of its lines' crossings is below the origin.

    Attributes:
        centre: (3,) m.
        side: of the whole, m.
        cell: side of a square, m.
        words: the same with its unit.
    """

    centre: Array
    side: float
    cell: float
    words: str

    @property
    def lines(self) -> tuple[Array, Array]:
        """Ends (n, 2, 3), m, of its lines, and which (n,) are a fifth one from the origin's."""
        half, found = round(0.5 * self.side / self.cell), []
        for along, across in ((0, 1), (1, 0)):
            ends = np.tile(self.centre, (2 * half + 1, 2, 1))
            ends[:, :, along] += (-0.5 * self.side, 0.5 * self.side)
            ends[:, :, across] += self.cell * np.arange(-half, half + 1)[:, None]
            found.append((ends, np.round(ends[:, 0, across] / self.cell) % 5 == 0))
        return np.concatenate([one[0] for one in found]), np.concatenate([one[1] for one in found])


def ground_below(shapes: Sequence[Shape], planar: bool) -> Ground:
    """Return the ground below shapes; of a planar scene it is behind the plane."""
    centre, size, low = _extent(shapes)
    cell, words = scale_of(_CELL * size)
    place = cell * np.round(centre / cell)
    place[2] = low - _BEHIND * size if planar else min(low, 0.0)
    return Ground(place, 2.0 * cell * float(np.ceil(_GROUND * size / cell)), cell, words)


def _extent(shapes: Sequence[Shape]) -> tuple[Array, float, float]:
    """Return centre (3,), diagonal and lowest height of the places of shapes, m, without forces."""
    places = np.vstack(
        [
            one.points if len(one.points) else one.pose.translation[None]
            for one in shapes
            if not one.namespace.startswith(LAYERS["forces"])
        ]
    )
    low, high = places.min(axis=0), places.max(axis=0)
    return 0.5 * (low + high), max(float(np.linalg.norm(high - low)), 1e-3), float(low[2])


@dataclass(frozen=True, slots=True)
class Drawn:
    """A picture of a state.

    Attributes:
        picture: that drew it.
        state: that it is of.
        frame: its shapes.
        instances: of each set -> arrays.
        lines: (n, 2, 3) ends, m, and (n, 2, 3) colours, 0 to 255; at least one.
    """

    picture: LivePicture
    state: LiveState
    frame: LiveFrame
    instances: dict[NodeKey, InstanceArrays]
    lines: tuple[Array, Array]

    def link_at(self, key: NodeKey, place: int | None) -> str | None:
        """Return the link of an instance; None for instances of no link, such as hands."""
        shapes = self.instances[key].shapes
        shape = shapes[place] if place is not None and place < len(shapes) else None
        return None if shape is None else self.picture.link_of(shape)

    def body_at(self, eye: Array, place: Array, link: str | None) -> Draggable | None:
        """Return the body to drag; None for nothing.

        Args:
            eye: (3,) from where it is seen, m, world axes.
            place: (3,) that is pointed at, likewise.
            link: that is there; None for none.
        """
        hand = self.picture.hand_at(self.state, eye, place)
        if hand is not None:
            return Draggable("hand", hand)
        return None if link is None else Draggable("link", link)

    def held(self, body: Draggable, place: Array) -> tuple[Array, Array]:
        """Return where (3,), m, world axes, a body is held that is taken at a place.

        Args:
            body: that is taken.
            place: (3,) m, world axes.

        Returns:
            That place, and the same (3,) in the frame of the link, m; of a hand it is the device's.
        """
        if body.kind == "hand":
            return self.state.user(body.name).device[:, 3], np.zeros(3)
        return place, np.asarray(self.frame.placement.links[body.name].actInv(place))
