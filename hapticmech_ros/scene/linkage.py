# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Linkages by points: ``linkage`` of a scene, expanded to links, joints and loops.

Bars that share a point are pinned there. The tree has the bars in their order: the first shared
point with earlier bars carries a bar; each further one closes a loop.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import Field, ValidationError

from hapticmech_ros.errors import SceneError, listed, nearest, scene_error
from hapticmech_ros.scene.mechanism import MOMENTS
from hapticmech_ros.scene.part import Name, NonNegative, Part, Positive, Real, Vector3
from hapticmech_ros.scene.validation import problems_of

WORLD = "world"
# Radius of a bar in space over its length, if none is given.
SLENDER = 1.0 / 40.0
# Points of a bar that are nearer than this share of the longest coordinate are one.
SAME = 1e-9
Array = np.ndarray
Document = dict[str, Any]
Point = Annotated[tuple[Real, ...], Field(min_length=2, max_length=3)]


class PinJoint(Part):
    """Forces in the joint that carries a bar or slider: keys of a scene's joint.

    Attributes:
        name: of the joint; left out: ``<bar>_at_<point>``.
        damping: viscous damping, N m s/rad or N s/m.
        armature: inertia of a rotor as the joint feels it, kg m² or kg.
        friction: Coulomb friction, N m or N.
        friction_speed: rad/s or m/s, at which friction is nearly full.
    """

    name: Name | None = None
    damping: NonNegative = 0.0
    armature: NonNegative = 0.0
    friction: NonNegative = 0.0
    friction_speed: Positive = 0.01


class Bar(Part):
    """A rigid bar through points: a rod between two, or rods from each to the next one.

    Mass is uniform along the rods unless ``com`` and ``inertia`` are given.

    Attributes:
        name: of the link.
        points: that it has.
        mass: kg; this or ``density``.
        density: kg/m.
        radius: m, of its rods; left out: 1/40 of their length in space, and 0 in the plane.
        com: centre of mass where it is drawn, coordinates as of a point.
        inertia: about the centre of mass, kg m²; the same about all axes.
        joint: forces in the joint that carries it.
    """

    name: Name
    points: Annotated[tuple[Name, ...], Field(min_length=2)]
    mass: Positive | None = None
    density: Positive | None = None
    radius: NonNegative | None = None
    com: Point | None = None
    inertia: Positive | None = None
    joint: PinJoint = PinJoint()


class Slider(Part):
    """A block at a point that slides along a line, and to which the bars there are pinned.

    Attributes:
        name: of the link.
        point: where it is.
        along: direction of the line where it is drawn, 2 or 3 numbers.
        on: bar with the line, or ``world``.
        mass: kg.
        joint: forces along the line.
    """

    name: Name
    point: Name
    along: Point
    on: Name = WORLD
    mass: Positive
    joint: PinJoint = PinJoint()


class Rod(Part):
    """A rod without mass between two points of different bars; its ends are balls.

    Attributes:
        name: of the closure.
        points: its two ends.
    """

    name: Name
    points: tuple[Name, Name]


class Linkage(Part):
    """A mechanism by the points of its bars as it is drawn, in place of ``links``.

    In the plane bars turn about the points that they share; in space they are on balls there, or on
    hinges. The scene's ``closures``, ``springs``, ``operational_points`` and ``shapes`` may name a
    ``point`` in place of ``link`` and ``origin``.

    Attributes:
        points: m, by name: x and y in the plane, x, y and z in space.
        ground: points that are fixed in the world.
        bars: in the order in which they carry each other.
        sliders: blocks on lines.
        rods: rods without mass.
        hinges: axis by point, in space: bars turn about it there.
    """

    points: dict[Name, Point]
    ground: tuple[Name, ...] = ()
    bars: Annotated[tuple[Bar, ...], Field(min_length=1)]
    sliders: tuple[Slider, ...] = ()
    rods: tuple[Rod, ...] = ()
    hinges: dict[Name, Vector3] = Field(default_factory=dict)


def with_linkage(document: object, source: str) -> object:
    """Return a scene's document with the links of its ``linkage``; unchanged without one.

    The document's own closures and positions are added to these, and go before them.

    Args:
        document: as written.
        source: of the scene, for errors.

    Raises:
        SceneError: the linkage breaks a rule; names bar and point.
    """
    if not isinstance(document, Mapping) or "linkage" not in document:
        return document
    for key in ("links", "model"):
        if key in document:
            raise scene_error(source, key, document[key], "links come from the linkage: give one")
    try:
        linkage = Linkage.model_validate(document["linkage"])
    except ValidationError as error:
        raise SceneError(source, problems_of(error, "linkage")) from None
    planar = document.get("task_space", "spatial") == "planar"
    drawing = _Drawing(linkage, planar, source)
    rest = {key: value for key, value in document.items() if key != "linkage"}
    found: Document = {**rest, "links": drawing.links}
    found["closures"] = [*drawing.closures, *_list(rest.get("closures"))]
    state = rest.get("initial_state", {})
    if isinstance(state, Mapping) and isinstance(state.get("q", {}), Mapping):
        found["initial_state"] = {**state, "q": {**drawing.start, **state.get("q", {})}}
    for key in ("operational_points", "shapes"):
        if key in found:
            places = enumerate(_list(found[key]))
            found[key] = [drawing.placed(item, f"{key}[{at}]") for at, item in places]
    for key in ("closures", "springs"):
        if key in found:
            found[key] = [
                {
                    end: drawing.placed(value, f"{key}[{at}].{end}") if end in "ab" else value
                    for end, value in item.items()
                }
                if isinstance(item, Mapping)
                else item
                for at, item in enumerate(_list(found[key]))
            ]
    return found


@dataclass(frozen=True, slots=True)
class _Body:
    """A link as it is drawn: where its frame is in the world, and its x axis in the plane."""

    name: str
    points: tuple[str, ...]
    origin: Array
    angle: float = 0.0

    def inside(self, vector: Array) -> Array:
        """Return a vector (3,) of the world in the link's axes."""
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        x, y, z = vector
        return np.array((cos * x + sin * y, cos * y - sin * x, z))


class _Drawing:
    """A linkage as parts of a document.

    Attributes:
        links, closures: as in a scene's document.
        start: positions of joints.
    """

    def __init__(self, linkage: Linkage, planar: bool, source: str) -> None:
        self._linkage, self._planar, self._source = linkage, planar, source
        self.links: list[Document] = []
        self.closures: list[Document] = []
        self.start: dict[str, float] = {}
        self._points = {
            name: self._vector(f"linkage.points.{name}", at) for name, at in linkage.points.items()
        }
        self._check_names()
        self._bodies = {WORLD: _Body(WORLD, linkage.ground, np.zeros(3))}
        self._grow()
        for index, rod in enumerate(linkage.rods):
            self._rod(f"rods[{index}]", rod)

    def placed(self, item: object, key: str) -> object:
        """Return something with ``point`` as ``link`` and ``origin``."""
        if not isinstance(item, Mapping) or "point" not in item:
            return item
        name = item["point"]
        if not isinstance(name, str) or name not in self._points:
            raise self._error(f"{key}.point", name, self._unknown(name))
        if "origin" in item:
            raise self._error(f"{key}.origin", item["origin"], "give a point, or link and origin")
        owner = item.get("link", None)
        if owner is None:
            bodies = [one for one in self._owners(name) if one.name != WORLD]
            body = (bodies or self._owners(name))[0]
        elif owner in self._bodies:
            body = self._bodies[owner]
        else:
            rule = f"must be one of {listed(self._bodies)}{nearest(owner, self._bodies)}"
            raise self._error(f"{key}.link", owner, rule)
        rest = {k: v for k, v in item.items() if k not in ("point", "link")}
        return {**rest, "link": body.name, "origin": self._origin(body, name)}

    def _vector(self, key: str, given: Sequence[float]) -> Array:
        size = 2 if self._planar else 3
        if len(given) != size:
            space = "planar" if self._planar else "spatial"
            raise self._error(key, given, f"a {space} scene has {size} coordinates")
        return np.array((*given, 0.0)[:3], dtype=float)

    def _check_names(self) -> None:
        linkage = self._linkage
        used = [("ground", name) for name in linkage.ground]
        used += [("hinges", name) for name in linkage.hinges]
        named = [(f"bars[{at}]", bar.points) for at, bar in enumerate(linkage.bars)]
        named += [(f"rods[{at}]", rod.points) for at, rod in enumerate(linkage.rods)]
        used += [(f"{key}.points", name) for key, points in named for name in points]
        used += [(f"sliders[{at}].point", one.point) for at, one in enumerate(linkage.sliders)]
        for key, name in used:
            if name not in self._points:
                raise self._error(f"linkage.{key}", name, self._unknown(name))
        names = [*(bar.name for bar in linkage.bars), *(one.name for one in linkage.sliders)]
        for name in names:
            if names.count(name) > 1 or name == WORLD:
                rule = "names of bars and sliders must be unique, and not 'world'"
                raise self._error("linkage.bars", name, rule)
        if self._planar and linkage.hinges:
            rule = "in the plane bars turn about z: hinges are for space"
            raise self._error("linkage.hinges", list(linkage.hinges), rule)
        scale = max((float(np.abs(at).max()) for at in self._points.values()), default=0.0)
        for index, bar in enumerate(linkage.bars):
            for first, second in combinations(bar.points, 2):
                if not np.linalg.norm(self._points[first] - self._points[second]) > SAME * scale:
                    rule = f"points {first} and {second} of bar {bar.name} are at the same place"
                    raise self._error(f"linkage.bars[{index}].points", bar.points, rule)

    def _grow(self) -> None:
        """Add bar after bar, each at its first shared point with earlier ones."""
        waiting: list[tuple[str, Bar | Slider]] = [
            *((f"linkage.sliders[{at}]", one) for at, one in enumerate(self._linkage.sliders)),
            *((f"linkage.bars[{at}]", one) for at, one in enumerate(self._linkage.bars)),
        ]
        while waiting:
            for place, (key, one) in enumerate(waiting):
                done = self._slide(key, one) if isinstance(one, Slider) else self._carry(key, one)
                if done:
                    del waiting[place]
                    break
            else:
                key, one = waiting[0]
                if isinstance(one, Slider):
                    rule = f"must be 'world' or a bar{nearest(one.on, self._bodies)}"
                    raise self._error(f"{key}.on", one.on, rule)
                rule = (
                    f"bar {one.name} shares no point with the ground, "
                    f"{listed(self._linkage.ground)}, or with a bar or slider that does"
                )
                raise self._error(f"{key}.points", one.points, rule)

    def _slide(self, key: str, slider: Slider) -> bool:
        if slider.on not in self._bodies:
            return False
        line = self._vector(f"{key}.along", slider.along)
        if not np.linalg.norm(line) > 0.0:
            raise self._error(f"{key}.along", slider.along, "a direction must not be zero")
        parent = self._bodies[slider.on]
        axis = parent.inside(line / np.linalg.norm(line))
        body = _Body(slider.name, (slider.point,), self._points[slider.point], parent.angle)
        joint = {"type": "prismatic", "axis": axis.tolist()}
        inertial = {"mass": slider.mass, "inertia": {"ixx": 0.0, "iyy": 0.0, "izz": 0.0}}
        self._add(body, parent, slider.point, joint, inertial, slider.joint)
        return True

    def _carry(self, key: str, bar: Bar) -> bool:
        carrying = next((name for name in bar.points if self._owners(name)), None)
        if carrying is None:
            return False
        at, parent = self._points[carrying], self._owners(carrying)[0]
        towards = self._points[next(name for name in bar.points if name != carrying)] - at
        angle = float(np.arctan2(towards[1], towards[0])) if self._planar else 0.0
        body = _Body(bar.name, bar.points, at, angle)
        inertial = self._inertial(key, bar, body)
        owners = {name: self._owners(name) for name in bar.points if name != carrying}
        joint = self._pin(carrying, parent)
        name = self._add(body, parent, carrying, joint, inertial, bar.joint)
        if self._planar:
            # Between -π and π.
            turned = angle - parent.angle
            self.start[name] = float(np.arctan2(np.sin(turned), np.cos(turned)))
        for point, others in owners.items():
            if others:
                self.closures.append(self._loop(body, others[0], point))
        return True

    def _add(
        self,
        body: _Body,
        parent: _Body,
        point: str,
        joint: Document,
        inertial: Document,
        acting: PinJoint,
    ) -> str:
        name = acting.name or f"{body.name}_at_{point}"
        given = acting.model_dump(exclude_unset=True, exclude={"name"})
        whole = {"name": name, **joint, "origin": self._origin(parent, point), **given}
        link = {"name": body.name, "parent": parent.name, "joint": whole, "inertial": inertial}
        self.links.append(link)
        self._bodies[body.name] = body
        return name

    def _pin(self, point: str, parent: _Body) -> Document:
        if self._planar:
            return {"type": "revolute", "axis": [0.0, 0.0, 1.0]}
        if point in self._linkage.hinges:
            return {"type": "revolute", "axis": parent.inside(self._axis(point)).tolist()}
        return {"type": "spherical"}

    def _loop(self, body: _Body, other: _Body, point: str) -> Document:
        ends: list[Document] = [
            {"link": one.name, "origin": self._origin(one, point)} for one in (body, other)
        ]
        kind = "planar_pin" if self._planar else "spherical"
        if point in self._linkage.hinges:
            kind = "revolute"
            for end in ends:
                end["origin"]["rpy"] = _onto(self._axis(point))
        return {"name": f"{body.name}_at_{point}", "kind": kind, "a": ends[0], "b": ends[1]}

    def _rod(self, key: str, rod: Rod) -> None:
        owners = [self._owners(name) for name in rod.points]
        for name, found in zip(rod.points, owners, strict=True):
            if not found:
                rule = f"point {name} is of no bar, slider or the ground"
                raise self._error(f"linkage.{key}.points", name, rule)
        a, b = owners[0][0], owners[1][0]
        length = float(np.linalg.norm(self._points[rod.points[0]] - self._points[rod.points[1]]))
        if a is b or not length > 0.0:
            rule = "a rod joins points of two bars that are apart"
            raise self._error(f"linkage.{key}.points", rod.points, rule)
        ends = [
            {"link": one.name, "origin": self._origin(one, name)}
            for one, name in zip((a, b), rod.points, strict=True)
        ]
        self.closures.append(
            {"name": rod.name, "kind": "rod", "a": ends[0], "b": ends[1], "length": length}
        )

    def _axis(self, point: str) -> Array:
        axis = np.array(self._linkage.hinges[point])
        size = float(np.linalg.norm(axis))
        if not size > 0.0:
            key = f"linkage.hinges.{point}"
            raise self._error(key, axis.tolist(), "an axis must not be zero")
        return np.asarray(axis / size)

    def _owners(self, point: str) -> list[_Body]:
        """Return the links with a point, in their order, and the world before them."""
        return [body for body in self._bodies.values() if point in body.points]

    def _origin(self, body: _Body, point: str) -> Document:
        return {"xyz": body.inside(self._points[point] - body.origin).tolist()}

    def _inertial(self, key: str, bar: Bar, body: _Body) -> Document:
        """Return mass, centre and inertia of rods from each point to the next one."""
        if (bar.mass is None) == (bar.density is None):
            raise self._error(f"{key}.mass", bar.mass, f"bar {bar.name} needs mass or density")
        ends = [(self._points[one], self._points[other]) for one, other in pairwise(bar.points)]
        lengths = np.array([np.linalg.norm(other - one) for one, other in ends])
        density = bar.density if bar.mass is None else bar.mass / float(lengths.sum())
        masses = lengths * (density or 0.0)
        mass = bar.mass if bar.mass is not None else float(masses.sum())
        middles = np.array([0.5 * (one + other) for one, other in ends])
        com = masses @ middles / masses.sum()
        if bar.com is not None:
            com = self._vector(f"{key}.com", bar.com)
        if bar.inertia is not None:
            moments = bar.inertia * np.eye(3)
        else:
            radii = np.full(len(ends), bar.radius) if bar.radius is not None else SLENDER * lengths
            if self._planar and bar.radius is None:
                radii = np.zeros(len(ends))
            moments = np.zeros((3, 3))
            for m, middle, (one, other), radius in zip(masses, middles, ends, radii, strict=True):
                rod, arm = other - one, middle - com
                across = m * (rod @ rod) / 12.0 + m * radius**2 / 4.0
                along = rod / np.linalg.norm(rod)
                moments += across * np.eye(3)
                moments += (m * radius**2 / 2.0 - across) * np.outer(along, along)
                moments += m * ((arm @ arm) * np.eye(3) - np.outer(arm, arm))
            if self._planar:
                moments = moments[2, 2] * np.eye(3)
        return {
            "mass": mass,
            "com": body.inside(com - body.origin).tolist(),
            "inertia": {name: float(moments[at]) for name, at in MOMENTS.items()},
        }

    def _unknown(self, name: object) -> str:
        return f"no such point: must be one of {listed(self._points)}{nearest(name, self._points)}"

    def _error(self, key: str, value: object, rule: str) -> SceneError:
        return scene_error(self._source, key, value, rule)


def _onto(axis: Array) -> list[float]:
    """Return roll, pitch, yaw that turn z onto an axis (3,)."""
    x, y, z = axis.tolist()
    return [0.0, float(np.arctan2(np.hypot(x, y), z)), float(np.arctan2(y, x))]


def _list(value: object) -> list[Any]:
    if value is None:
        return []
    return list(value) if isinstance(value, list | tuple) else [value]
