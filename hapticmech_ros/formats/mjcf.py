# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""MJCF: bodies in bodies, the joints in each, and the equalities that close their loops."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.mjcf_classes import Context, settings
from hapticmech_ros.formats.mjcf_equalities import (
    INACTIVE,
    WHY_INACTIVE,
    Equalities,
    read_keyframes,
)
from hapticmech_ros.formats.mjcf_include import WHY as WHY_REPLICAS
from hapticmech_ros.formats.mjcf_include import open_replicas
from hapticmech_ros.formats.mjcf_inertias import WHY as WHY_ROTORS
from hapticmech_ros.formats.mjcf_inertias import body_of, shape_of, with_rotors
from hapticmech_ros.formats.mjcf_shapes import collides, solid_of
from hapticmech_ros.formats.model import (
    DRAWN,
    SENSED,
    WORLD,
    Body,
    Joint,
    Model,
    Note,
    Point,
    Solid,
    State,
)
from hapticmech_ros.formats.xml_nodes import Node, Source

JOINT_TYPES = {"hinge": "revolute", "slide": "prismatic", "ball": "spherical", "free": "free"}
RIGID = "bodies are rigid"
WHY = {
    "geom": "drawn only; its inertia is taken where the file says so",
    "actuator": "nothing drives a joint but the hand and what the scene says; armature is read",
    "sensor": SENSED,
    "tendon": "say springs between two frames in a scene file",
    "contact": "say which shapes touch in a scene file",
    "deformable": RIGID,
    "camera": DRAWN,
    "light": DRAWN,
    "armature of a free joint": "a body that floats has no rotor",
    "springdamper": "say stiffness and damping",
    "solref or solimp of an equality": "loops are closed exactly",
    "mocap": "the body stays where it is",
    "align": "frames stay where the file has them",
    "fluid": "nothing flows around bodies",
    "flag": "all that acts is on, but gravity if the file says so",
    "range of a ball": "only joints of one coordinate have stops",
    "stiffness of a ball or free joint": "only joints of one coordinate have springs",
    "frictionloss of a ball or free joint": "only joints of one coordinate have friction",
    INACTIVE: WHY_INACTIVE,
    **WHY_REPLICAS,
    **WHY_ROTORS,
}
UNKNOWN = "not of a mechanism, or not known"
READ = (
    "compiler",
    "option",
    "size",
    "visual",
    "statistic",
    "asset",
    "default",
    "worldbody",
    "keyframe",
)
WRITE_OUT = "is not read: give the file with its bodies written out"
IN_BODIES = ("body", "frame", "joint", "freejoint", "geom", "site", "inertial", "camera", "light")
# Element, the frame it is in as one of the body's, and the class for such elements.
Part = tuple[Node, pin.SE3, str]


def read_mjcf(source: Source) -> Model:
    """Return the model in an MJCF file.

    Joints have the file's coordinates, ``ref`` included: a scene starts where the file draws it.

    Raises:
        SceneError: it breaks a rule; names line, element, value and rule.
    """
    reader = _Reader(source, Context(source))
    open_replicas(reader.context, reader.notes)
    return reader.read()


@dataclass
class _Reader:
    source: Source
    context: Context
    bodies: dict[str, Body] = field(default_factory=dict)
    hinges: list[Joint] = field(default_factory=list)
    nodes: dict[tuple[str, str], Node] = field(default_factory=dict)
    refs: dict[str, float] = field(default_factory=dict)
    free: dict[str, list[float]] = field(default_factory=dict)
    sites: dict[str, tuple[str, pin.SE3]] = field(default_factory=dict)
    solids: list[Solid] = field(default_factory=list)
    visuals: list[Solid] = field(default_factory=list)
    notes: Counter[str] = field(default_factory=Counter)
    # kg: of all bodies, if the compiler is told; and of those that do not move.
    _total: float = -1.0
    _standing: float = 0.0

    def read(self) -> Model:
        source, compiler = self.source, self.context.compiler
        if compiler.attributes.get("coordinate", "local").strip() != "local":
            raise source.error(
                compiler, compiler.attributes["coordinate"], "coordinate is not read"
            )
        self._total = source.value(compiler, "settotalmass", -1.0)
        world = settings(source.root, "worldbody")
        if not source.root.all("worldbody"):
            raise source.error(source.root, None, "needs a <worldbody>")
        self.poses = {WORLD: pin.SE3.Identity()}
        self._named = {node.attributes.get("name", "") for node in source.root.walk()}
        self._children(world, WORLD, "", moving=False)
        self._weigh()
        hinges = with_rotors(self.context, self.hinges, self.notes)
        start: dict[str, State] = {name: ref for name, ref in self.refs.items() if ref}
        start |= self.free
        equalities = Equalities(self.context, self.poses, self.sites, self.refs, hinges, self.notes)
        equalities.read()
        hinges = equalities.locked()
        return Model(
            source.root.attributes.get("model") or source.path.stem,
            self.bodies,
            hinges,
            equalities.loop_joints,
            equalities.couplings,
            [Point(name, *place) for name, place in self.sites.items()],
            self.solids,
            self._gravity(),
            notes=self._notes(),
            visuals=self.visuals,
            start=start,
            floating="a <freejoint/> makes a body float",
            keyframes=read_keyframes(source, hinges, start),
            where={key: source.where(node) for key, node in self.nodes.items()},
            locks=equalities.reasons,
        )

    def _weigh(self) -> None:
        """Give all bodies together, also those that stand, the mass that the compiler is told."""
        if self._total <= 0.0:
            return
        mass = self._standing + sum(body.mass for body in self.bodies.values())
        if self.context.has_compiled or not mass > 0.0:
            rule = "settotalmass needs bodies of simple shapes or with an <inertial>"
            raise self.source.error(self.context.compiler, self._total, rule)
        share = self._total / mass
        for name, body in self.bodies.items():
            mass, inertia = share * body.mass, share * body.inertia
            self.bodies[name] = replace(body, mass=mass, inertia=inertia)

    def _gravity(self) -> tuple[float, float, float]:
        option = settings(self.source.root, "option")
        x, y, z = self.source.values(option, "gravity", (0.0, 0.0, -9.81))
        for flag in option.all("flag"):
            if flag.attributes.get("gravity", "enable").strip() == "disable":
                x = y = z = 0.0
            off = [key for key, value in flag.attributes.items() if value.strip() == "disable"]
            self.notes["flag"] += len(set(off) - {"gravity"})
        flowing = self.context.padded(option, "wind", (0.0, 0.0, 0.0))
        density, viscosity = (
            self.source.value(option, key, 0.0) for key in ("density", "viscosity")
        )
        self.notes["fluid"] += any((*flowing, density, viscosity))
        return x, y, z

    def _notes(self) -> list[Note]:
        for node in self.source.root.children:
            if node.tag == "equality":
                soft = [n for n in node.children if {"solref", "solimp"} & n.attributes.keys()]
                self.notes["solref or solimp of an equality"] += len(soft)
            elif node.tag not in READ:
                self.notes[node.tag] += max(len(node.children), 1)
        found = self.notes.items()
        return [Note(what, count, WHY.get(what, UNKNOWN)) for what, count in found if count]

    def _parts(self, node: Node, place: pin.SE3, childclass: str) -> Iterator[Part]:
        """Yield what is in a body, frames opened."""
        for child in node.children:
            if child.tag not in IN_BODIES:
                raise self.source.error(child, child.tag, WRITE_OUT)
            if child.tag == "frame":
                called = child.attributes.get("childclass", childclass)
                yield from self._parts(child, place * self.context.place(child), called)
            else:
                yield child, place, childclass

    def _children(self, node: Node, name: str, childclass: str, moving: bool) -> None:
        """Read what is in the world or a body."""
        geoms, inertial = [], None
        for part, place, called in self._parts(node, pin.SE3.Identity(), childclass):
            if part.tag == "body":
                self._body(part, name, place, called, moving)
                continue
            if part.tag in ("camera", "light"):
                self.notes[part.tag] += 1
            elif part.tag == "geom":
                geom = self.context.full(part, called)
                geoms.append((geom, place))
                if collides(self.context, geom):
                    self.solids.append(solid_of(self.context, geom, place, name))
                else:
                    self.notes["geom"] += 1
                    self.visuals.append(solid_of(self.context, geom, place, name))
            elif part.tag == "inertial":
                if inertial is not None:
                    raise self.source.error(part, name, "one <inertial> is enough")
                inertial = part
            elif part.tag == "site":
                full = self.context.full(part, called)
                self._site(full, name, place * shape_of(self.context, full)[1])
            elif name == WORLD and part.tag in ("joint", "freejoint"):
                raise self.source.error(part, part.tag, "the world does not move")
        if moving:
            found = body_of(self.context, name, inertial, geoms)
            self.bodies[name] = replace(found, gravcomp=self.bodies[name].gravcomp)
        elif self._total > 0.0 and name != WORLD:
            self._standing += body_of(self.context, name, inertial, geoms).mass

    def _site(self, node: Node, body: str, place: pin.SE3) -> None:
        name = node.attributes.get("name", "").strip()
        if name in self.sites:
            rule = "names of sites must be unique"
            raise self.source.twice(node, name, self.nodes["site", name], rule)
        if name:
            self.nodes["site", name] = node
            self.sites[name] = (body, place)

    def _body(self, node: Node, parent: str, frame: pin.SE3, childclass: str, moving: bool) -> None:
        given = node.attributes.get("name", "").strip()
        name = given or self._new(f"body{len(self.bodies) + 1}")
        if name in self.poses:
            rule = "names of bodies must be unique, and not 'world'"
            raise self.source.twice(node, name, self.nodes.get(("link", name)), rule)
        self.nodes["link", name] = node
        childclass = node.attributes.get("childclass", childclass)
        place = frame * self.context.place(node)
        self.poses[name] = self.poses[parent] * place
        self.bodies[name] = Body(name, gravcomp=self.source.value(node, "gravcomp", 0.0))
        self.notes["mocap"] += self.context.flag(node, "mocap")
        joints = [
            (self.context.full(part, called) if part.tag == "joint" else part, within)
            for part, within, called in self._parts(node, pin.SE3.Identity(), childclass)
            if part.tag in ("joint", "freejoint")
        ]
        if not joints:
            self.hinges.append(Joint(self._new(f"{name}_base"), "fixed", parent, name, place))
        for step, (joint, within) in enumerate(joints):
            last = step == len(joints) - 1
            child = name if last else self._new(f"{name}_{step}")
            if not last:
                self.bodies[child] = Body(child)
            alone = self._new(f"{name}_joint{step if len(joints) > 1 else ''}")
            hinge = self._hinge(joint, alone, parent, child, place, within)
            if hinge.type == "free" and (len(joints) > 1 or parent != WORLD):
                rule = "a free joint is the only one of a body in the world"
                raise self.source.error(joint, hinge.name, rule)
            self.hinges.append(hinge)
            parent, place = child, pin.SE3.Identity()
        self._children(node, name, childclass, moving or bool(joints))

    def _new(self, name: str) -> str:
        """Return a name that the file has not."""
        while name in self._named:
            name += "_"
        self._named.add(name)
        return name

    def _hinge(
        self, node: Node, name: str, parent: str, child: str, place: pin.SE3, within: pin.SE3
    ) -> Joint:
        source, context = self.source, self.context
        name = node.attributes.get("name", "").strip() or name
        kind = context.word(node, "type", "hinge") if node.tag == "joint" else "free"
        if kind not in JOINT_TYPES:
            raise source.error(node, kind, f"type must be one of {sorted(JOINT_TYPES)}")
        if ("joint", name) in self.nodes:
            raise source.twice(
                node, name, self.nodes["joint", name], "names of joints must be unique"
            )
        self.nodes["joint", name] = node
        self.notes["springdamper"] += any(source.values(node, "springdamper", (0.0, 0.0)))
        self.notes["align"] += kind == "free" and node.attributes.get("align") == "true"
        damping, armature = (source.value(node, key, 0.0) for key in ("damping", "armature"))
        if kind == "free":
            self._without(node, kind)
            self.notes["armature of a free joint"] += armature != 0.0
            self.free[name] = [float(x) for x in pin.SE3ToXYZQUAT(place)]
            return Joint(name, "free", parent, child, pin.SE3.Identity(), damping=damping)
        anchor = pin.SE3.Identity()
        anchor.translation = within.act(np.array(source.values(node, "pos", (0.0,) * 3)))
        if kind == "ball":
            self._without(node, kind)
            at = place * anchor
            back = anchor.inverse()
            joint = Joint(name, "spherical", parent, child, at, back, damping=damping)
            return replace(joint, armature=armature)
        axis = within.rotation @ np.array(source.values(node, "axis", (0.0, 0.0, 1.0)))
        size = float(np.linalg.norm(axis))
        if not size > 0.0:
            raise source.error(node, node.attributes["axis"], "an axis must not be zero")
        axis /= size
        scale = context.angle if kind == "hinge" else float
        ref = scale(source.value(node, "ref", 0.0))
        self.refs[name] = ref
        back = pin.SE3.Identity()
        if kind == "hinge":
            back.rotation = pin.AngleAxis(-ref, axis).matrix()
        else:
            back.translation = -ref * axis
        return Joint(
            name,
            JOINT_TYPES[kind],
            parent,
            child,
            place * anchor * back,
            anchor.inverse(),
            axis,
            damping,
            source.value(node, "frictionloss", 0.0),
            source.value(node, "stiffness", 0.0),
            scale(source.value(node, "springref", 0.0)),
            armature,
            self._limits(node, scale),
        )

    def _without(self, node: Node, kind: str) -> None:
        """Note what acts in a joint of several coordinates, and does not here."""
        for key in ("stiffness", "frictionloss"):
            self.notes[f"{key} of a ball or free joint"] += self.source.value(node, key, 0.0) != 0.0
        self.notes["range of a ball"] += kind == "ball" and "range" in node.attributes

    def _limits(self, node: Node, scale: Callable[[float], float]) -> tuple[float, float] | None:
        lower, upper = self.source.values(node, "range", (0.0, 0.0), math.inf)
        limited = self.context.word(node, "limited", "auto")
        if limited not in ("auto", "true", "false"):
            raise self.source.error(node, limited, "limited must be auto, true or false")
        if limited == "auto" and "range" in node.attributes:
            if not self.context.flag(self.context.compiler, "autolimits", "true"):
                rule = "without autolimits a range needs limited"
                raise self.source.error(node, node.attributes["range"], rule)
            limited = "true" if (lower, upper) != (0.0, 0.0) else "false"
        if limited != "true":
            return None
        if lower > upper:
            raise self.source.error(node, (lower, upper), "lower must not be above upper")
        return scale(lower), scale(upper)
