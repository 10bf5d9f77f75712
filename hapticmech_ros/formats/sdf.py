# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""SDFormat: one model with those in it; a link that two joints carry closes a loop.

Gears are gearboxes between two hinges on one link, and axes that mimic others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import listed
from hapticmech_ros.formats import loops
from hapticmech_ros.formats.loops import BALL, ball_constraint, left_open
from hapticmech_ros.formats.model import (
    DRAWN,
    DRIVEN,
    FOREIGN,
    GEAR,
    ROTOR,
    ROTOR_ELSEWHERE,
    SENSED,
    UNKNOWN,
    WHY_ELSEWHERE,
    WORLD,
    Body,
    Coupling,
    Document,
    Joint,
    Model,
    Note,
    Point,
    Rgba,
    Solid,
    from_z,
)
from hapticmech_ros.formats.sdf_frames import HERE, OF_MODEL, Frames, Scope, opened
from hapticmech_ros.formats.shapes import (
    SIZES,
    find_mesh,
    not_zero,
    refused_kind,
    rgba,
    sized,
    solid_of,
)
from hapticmech_ros.formats.xml_nodes import Node, Source
from hapticmech_ros.scene.part import LARGEST

# Of the sine of the angle between axes that are one, as files of six digits have them.
PARALLEL = 1e-3
INEXACT = "gearbox"
WHY_INEXACT = "not between two hinges on its reference body: write a coupling in a scene file"


JOINT_TYPES = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "ball": "spherical",
    "fixed": "fixed",
    "screw": "revolute",
    "universal": "revolute",
    "revolute2": "revolute",
}
# Those of two hinges.
UNIVERSAL = ("universal", "revolute2")
ELSEWHERE = "include of a world"
WHY = {
    "visual": DRAWN,
    ELSEWHERE: "no such file beside this one: that model is not read",
    "plugin": FOREIGN,
    "sensor": SENSED,
    ROTOR_ELSEWHERE: WHY_ELSEWHERE,
    "mimic of a second axis": "joints have one axis",
    INEXACT: WHY_INEXACT,
    **loops.WHY,
    "effort limit": DRIVEN,
    "velocity limit": DRIVEN,
}
FLAGS = {"true": True, "1": True, "false": False, "0": False}
# m per turn, right-handed; and its older form, rad/m, left-handed.
PITCH, OLD_PITCH = "screw_thread_pitch", "thread_pitch"
JOINT_KNOWN = {"parent", "child", "pose", "axis", ROTOR, GEAR}
LINK_KNOWN = {"pose", "inertial", "collision", "gravity"}


def read_sdf(source: Source, name: str = "") -> Model:
    """Return a model in an SDF file, alone or in a world.

    Args:
        source: the file.
        name: of the model; empty where there is one only.

    Raises:
        SceneError: it breaks a rule; names line, element, value and rule.
    """
    world = source.root.first("world")
    models = [*source.root.all("model"), *(world.all("model") if world is not None else [])]
    names = [model.attributes.get("name", "") for model in models]
    if name:
        models = [model for model in models if model.attributes.get("name", "") == name]
        if len(models) != 1:
            raise source.error(
                source.root, name, f"must name one of the models, {listed(sorted(names))}"
            )
    if len(models) > 1:
        models = [model for model in models if not _is_static(model)] or models
    if len(models) != 1:
        rule = "needs one <model>, or model: {file, name} in a scene that names one of "
        rule += listed(names)
        raise source.error(source.root, len(models), rule)
    gravity = world.first("gravity") if world is not None else None
    vector = None
    if gravity is not None:
        x, y, z = source.numbers(gravity, gravity.text, 3)
        vector = (x, y, z)
    reader = _Reader(source, models[0])
    if world is not None:
        reader.notes[ELSEWHERE] = len(world.all("include"))
    return reader.read(vector)


def read_joints(
    source: Source,
    joints: Iterable[Node],
    placed: dict[str, tuple[str, pin.SE3]],
    bodies: dict[str, Body],
    notes: Counter[str],
) -> tuple[list[Joint], list[Coupling]]:
    """Return joints of SDFormat in a file of another kind, and couplings of these.

    Args:
        source: the file.
        joints: their elements.
        placed: of its links, by name: another frame, and the pose in it.
        bodies: its links; those without mass that joints need are added.
        notes: kinds of elements that are not read, to add to.

    Raises:
        SceneError: it breaks a rule; names line, element, value and rule.
    """
    reader = _Reader(source, source.root, notes)
    reader.frames = Frames(source, placed)
    reader.frames.poses = {HERE: pin.SE3.Identity(), WORLD: pin.SE3.Identity()}
    for joint in joints:
        reader.frames.place(joint, Scope("", ""))
    hinges = [hinge for joint in joints for hinge in reader.hinges(joint, bodies)]
    return hinges, reader.couplings


def _is_static(model: Node) -> bool:
    static = model.first("static")
    return static is not None and static.text.strip() in ("true", "1")


def _is_gearbox(joint: Node) -> bool:
    return joint.attributes.get("type", "").strip() == "gearbox"


@dataclass
class _Reader:
    source: Source
    model: Node
    notes: Counter[str] = field(default_factory=Counter)
    solids: list[Solid] = field(default_factory=list)
    visuals: list[Solid] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)
    others: list[Node] = field(default_factory=list)

    def read(self, gravity: tuple[float, float, float] | None) -> Model:
        source, model = self.source, self.model
        self.frames = Frames(source)
        relative, own = self.frames.written(model)
        if relative not in ("", WORLD) or "placement_frame" in model.attributes:
            rule = "a model is placed by its own frame in the world"
            raise source.error(model, relative or model.attributes["placement_frame"], rule)
        self.frames.poses = {HERE: own, WORLD: pin.SE3.Identity()}
        links, joints = self._parts()
        bodies = {}
        for link in links:
            body = self._body(link)
            bodies[body.name] = body
        hinges: list[Joint] = []
        for joint in joints:
            if not _is_gearbox(joint):
                hinges += self.hinges(joint, bodies)
        for joint in filter(_is_gearbox, joints):
            self._gear(joint, hinges, bodies)
        hinges, couplings = loops.settled(hinges, self.couplings, self.notes)
        points = [self._point(name, frame, bodies) for name, frame in self.frames.frames.items()]
        balls = [node for node in self.others if node.tag == BALL]
        rest = [node for node in self.others if node.tag != BALL]
        lost, rest = left_open(rest, {*bodies, *self.frames.frames})
        self.notes.update(node.tag for node in rest)
        found = self.notes.items()
        return Model(
            model.attributes.get("name") or source.path.stem,
            bodies,
            hinges,
            [ball_constraint(source, node, bodies) for node in balls],
            couplings,
            points,
            solids=self.solids,
            visuals=self.visuals,
            gravity=gravity,
            bases={
                body: self.frames.pose(body, model) for body in bodies if body in self.frames.placed
            },
            where={
                (node.tag, name): source.where(node) for name, node in self.frames.nodes.items()
            },
            notes=[
                *lost,
                *(Note(what, count, WHY.get(what, UNKNOWN)) for what, count in found if count),
            ],
        )

    def _parts(self) -> tuple[list[Node], list[Node]]:
        """Return the links and joints of the model and of those in it, all placed."""
        found: dict[str, list[Node]] = {"link": [], "joint": []}
        for node, scope in opened(self.source, self.model):
            if node.tag in ("link", "joint", "frame", "model"):
                self.frames.place(node, scope)
                found.get(node.tag, []).append(node)
            elif node.tag == "static":
                if node.text.strip() in ("true", "1"):
                    raise self.source.error(node, node.text, "a static model does not move")
            elif node.tag not in ("pose", "self_collide"):
                self.others.append(node)
        return found["link"], found["joint"]

    def _body(self, link: Node) -> Body:
        name = self.source.text(link, "name")
        self.notes.update(part.tag for part in link.children if part.tag not in LINK_KNOWN)
        for tag, kept in (("collision", self.solids), ("visual", self.visuals)):
            for part in link.all(tag):
                place = partial(self.frames.within, part, name)
                solid = solid_of(self.source, part, name, place, _shape_of, SHAPE_KINDS)
                kept.append(replace(solid, colour=_colour(part.first("material"))))
        inertial = link.first("inertial")
        if inertial is None:
            # SDFormat's own default.
            return Body(name, 1.0, np.zeros(3), np.eye(3), self._carried(link))
        if inertial.attributes.get("auto", "false") in ("true", "1"):
            raise self.source.error(inertial, name, "inertia of shapes is not read: write it")
        mass = self._number(inertial, "mass", 1.0)
        inertia = inertial.first("inertia")
        given = {
            key: self._number(inertia, key, float(key in ("ixx", "iyy", "izz")))
            for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        }
        own = np.array(
            [
                [given["ixx"], given["ixy"], given["ixz"]],
                [given["ixy"], given["iyy"], given["iyz"]],
                [given["ixz"], given["iyz"], given["izz"]],
            ]
        )
        relative, place = self.frames.written(inertial)
        if relative not in ("", name):
            raise self.source.error(inertial, relative, "an inertia is relative to its link")
        turned = place.rotation @ own @ place.rotation.T
        return Body(name, mass, place.translation.copy(), turned, self._carried(link))

    def _carried(self, link: Node) -> float:
        """Return which fraction of a link's weight is carried: all, if gravity is off."""
        gravity = link.first("gravity")
        if gravity is None:
            return 0.0
        said = gravity.text.strip()
        if said not in FLAGS:
            raise self.source.error(gravity, said, f"must be one of {listed(sorted(FLAGS))}")
        return float(not FLAGS[said])

    def _number(
        self, node: Node | None, tag: str, default: float, largest: float = LARGEST
    ) -> float:
        """Return the number in an element."""
        return self.source.inside(node, tag, (default,), largest)[0]

    def hinges(self, joint: Node, bodies: dict[str, Body]) -> list[Joint]:
        """Return an element's joint, or several with bodies without mass between."""
        hinge, kind = self._hinge(joint, bodies), self.source.text(joint, "type")
        if kind in UNIVERSAL:
            return self._universal(joint, hinge, bodies)
        return self._screw(joint, hinge, bodies) if kind == "screw" else [hinge]

    def _hinge(self, joint: Node, bodies: Mapping[str, Body]) -> Joint:
        name, kind = self.source.text(joint, "name"), self.source.text(joint, "type")
        if kind not in JOINT_TYPES:
            rule = f"type must be one of {listed(sorted(JOINT_TYPES))}"
            raise self.source.error(joint, kind, rule)
        more = {"screw": {PITCH, OLD_PITCH}, **{key: {"axis2"} for key in UNIVERSAL}}
        known = JOINT_KNOWN | more.get(kind, set())
        self.notes.update(part.tag for part in joint.children if part.tag not in known)
        parent, child = (
            self.frames.body_of(self.frames.end_name(joint, end), joint, bodies)
            for end in ("parent", "child")
        )
        place = self.frames.pose(name, joint)
        before, behind = (self.frames.pose(body, joint) for body in (parent, child))
        moves = kind not in ("ball", "fixed")
        # The reflected inertia of a rotor from Drake's tags, kg m² or kg.
        armature = self._number(joint, GEAR, 1.0) ** 2 * self._number(joint, ROTOR, 0.0)
        self.notes[ROTOR_ELSEWHERE] += armature != 0.0 and not moves
        ends = before.actInv(place), place.actInv(behind)
        found = Joint(name, JOINT_TYPES[kind], parent, child, *ends)
        axis = joint.first("axis")
        if not moves:
            dynamics = axis.first("dynamics") if axis is not None else None
            return replace(found, damping=self._number(dynamics, "damping", 0.0))
        if axis is None:
            raise self.source.error(joint, name, "needs an <axis>")
        self._mimic(joint, axis)
        return replace(self._about(axis, found, place, joint), armature=armature)

    def _about(self, axis: Node, hinge: Joint, place: pin.SE3, joint: Node) -> Joint:
        """Return a joint with an axis, and its forces and stops."""
        dynamics = axis.first("dynamics")
        endless = self.source.text(joint, "type") == "continuous"
        return replace(
            hinge,
            axis=self._axis(axis, place, joint),
            damping=self._number(dynamics, "damping", 0.0),
            friction=self._number(dynamics, "friction", 0.0),
            stiffness=self._number(dynamics, "spring_stiffness", 0.0),
            rest=self._number(dynamics, "spring_reference", 0.0),
            limits=None if endless else self._limits(axis),
        )

    def _universal(self, joint: Node, hinge: Joint, bodies: dict[str, Body]) -> list[Joint]:
        """Return the hinges of a universal joint, the second one about ``axis2``."""
        axis = joint.first("axis2")
        if axis is None:
            raise self.source.error(joint, hinge.name, "needs an <axis2>")
        self.notes["mimic of a second axis"] += axis.first("mimic") is not None
        cross, second = f"{hinge.name}_cross", f"{hinge.name}_axis2"
        self._take(joint, hinge.name, (cross, second))
        bodies[cross] = Body(cross)
        at, place = pin.SE3.Identity(), self.frames.pose(hinge.name, joint)
        other = Joint(second, "revolute", cross, hinge.child, at, hinge.of_child)
        return [
            replace(hinge, child=cross, of_child=pin.SE3.Identity()),
            self._about(axis, other, place, joint),
        ]

    def _take(self, joint: Node, name: str, others: Iterable[str]) -> None:
        """Refuse names of the file that a joint takes for its parts."""
        for other in others:
            if other in self.frames.placed:
                kind = self.source.text(joint, "type")
                rule = f"a {kind} takes this name for itself: rename {other}"
                raise self.source.error(joint, name, rule)

    def _screw(self, joint: Node, hinge: Joint, bodies: dict[str, Body]) -> list[Joint]:
        """Return the hinge of a screw, and the slide along its axis that is coupled to it."""
        pitch = self._number(joint, PITCH, 1.0)
        if joint.first(PITCH) is None and joint.first(OLD_PITCH) is not None:
            turning = self._number(joint, OLD_PITCH, 0.0)
            if turning == 0.0:
                raise self.source.error(joint, turning, f"{OLD_PITCH} must not be zero")
            pitch = -2.0 * np.pi / turning
        if pitch == 0.0:
            raise self.source.error(joint, pitch, f"{PITCH} must not be zero")
        nut, slide = f"{hinge.name}_nut", f"{hinge.name}_slide"
        self._take(joint, hinge.name, (nut, slide))
        bodies[nut] = Body(nut)
        ratio = float(pitch / (2.0 * np.pi))
        self.couplings.append(Coupling(f"{hinge.name}_thread", slide, hinge.name, ratio, 0.0))
        turning_part = replace(hinge, child=nut, of_child=pin.SE3.Identity())
        at = pin.SE3.Identity()
        sliding = Joint(slide, "prismatic", nut, hinge.child, at, hinge.of_child, hinge.axis)
        return [turning_part, sliding]

    def _mimic(self, joint: Node, axis: Node) -> None:
        """Read an axis's mimic, if any."""
        source, written = self.source, axis.first("mimic")
        if written is None:
            return
        if written.attributes.get("axis", "axis") != "axis":
            self.notes["mimic of a second axis"] += 1
            return
        name, leader = source.text(joint, "name"), source.text(written, "joint")
        if written.first("multiplier") is None:
            raise source.error(written, name, "a mimic needs a <multiplier>")
        tags = ("multiplier", "offset", "reference")
        ratio, offset, reference = (source.inside(written, tag, (0.0,))[0] for tag in tags)
        moved = offset - ratio * reference
        self.couplings.append(Coupling(f"{name}_mimics_{leader}", name, leader, ratio, moved))

    def _axis(self, axis: Node, place: pin.SE3, joint: Node) -> np.ndarray:
        written = axis.first("xyz")
        if written is None:
            return np.array((0.0, 0.0, 1.0))
        along = self.source.numbers(written, written.text, 3, "an axis")
        vector = self.source.unit(written, along, "an axis")
        frame = written.attributes.get("expressed_in", "") or self._axes_of(axis, joint)
        if frame:
            vector = place.rotation.T @ self.frames.pose(frame, written).rotation @ vector
        return vector

    def _axes_of(self, axis: Node, joint: Node) -> str:
        """Return the frame of an axis that names none; empty if it is its joint's."""
        own = axis.first("use_parent_model_frame")
        root = self.source.root
        before = root.tag == "sdf" and root.attributes.get("version", "").strip() in OF_MODEL
        of_model = before if own is None else own.text.strip() in ("true", "1")
        return self.frames.scopes[self.source.text(joint, "name")].here if of_model else ""

    def _limits(self, axis: Node | None) -> tuple[float, float] | None:
        limit = axis.first("limit") if axis is not None else None
        if limit is None:
            return None
        self.notes.update(f"{t} limit" for t in ("effort", "velocity") if limit.first(t))
        lower = self._number(limit, "lower", -np.inf, np.inf)
        upper = self._number(limit, "upper", np.inf, np.inf)
        if lower > upper:
            raise self.source.error(limit, (lower, upper), "lower must not be above upper")
        return lower, upper

    def _gear(self, joint: Node, hinges: list[Joint], bodies: Mapping[str, Body]) -> None:
        """Read a gearbox as a coupling of two hinges; it is noted if these are not there.

        With θ₁ from the reference body to the parent about ``axis``, and θ₂ from it to the child
        about ``axis2``, SDFormat has θ₂ = -ratio θ₁.
        """
        reference, parent, child = (
            self.frames.body_of(self.frames.end_name(joint, end), joint, bodies)
            for end in ("gearbox_reference_body", "parent", "child")
        )
        if not any(hinge.child == child for hinge in hinges):
            rule = "a gearbox carries nothing: another joint must carry its child"
            raise self.source.error(joint, child, rule)
        name, found = self.source.text(joint, "name"), []
        for end, tag in ((parent, "axis"), (child, "axis2")):
            axis = joint.first(tag)
            if axis is not None:
                place = self.frames.pose(name, joint)
                along = place.rotation @ self._axis(axis, place, joint)
                signs = [(hinge, self._sign(hinge, reference, end, along)) for hinge in hinges]
                exact = [(hinge, sign) for hinge, sign in signs if sign]
                found += exact if len(exact) == 1 else []
        if len(found) != 2:
            self.notes[INEXACT] += 1
            return
        (leader, first), (follower, second) = found
        written = joint.first("gearbox_ratio")
        ratio = 1.0
        if written is not None:
            (ratio,) = self.source.numbers(written, written.text, 1, "a ratio")
        factor = -ratio * first * second
        self.couplings.append(Coupling(name, follower.name, leader.name, factor, 0.0))

    def _sign(self, hinge: Joint, reference: str, end: str, axis: np.ndarray) -> int:
        """Return 1 or -1, as a hinge's angle counts from link to link about an axis, or else 0.

        Args:
            hinge: of the model.
            reference: link that the angle is from.
            end: link that it is to.
            axis: (3,) unit vector, world axes.
        """
        forward = (hinge.parent, hinge.child) == (reference, end)
        backward = (hinge.parent, hinge.child) == (end, reference)
        if hinge.type != "revolute" or not (forward or backward):
            return 0
        own = self.frames.pose(hinge.name, self.model).rotation @ hinge.axis
        if np.linalg.norm(np.cross(own, axis)) > PARALLEL:
            return 0
        same = bool(own @ axis > 0.0)
        return 1 if same == forward else -1

    def _point(self, name: str, frame: Node, bodies: Mapping[str, Body]) -> Point:
        """Return a frame of the file, fixed in the link that it is attached to."""
        body = self.frames.body_of(name, frame, bodies)
        place = self.frames.pose(body, frame).actInv(self.frames.pose(name, frame))
        return Point(name, body, place)


def _colour(material: Node | None) -> Rgba | None:
    diffuse = None if material is None else material.first("diffuse")
    return None if diffuse is None else rgba(diffuse.text)


# Of sizes that are left out; all others are 1 m.
SIZE_DEFAULTS = {("capsule", "radius"): 0.5}
SHAPE_KINDS = {"plane": "half_space"}


def _shape_of(
    source: Source, shape: Node, kind: str, place: Callable[[], pin.SE3]
) -> tuple[pin.SE3, Document]:
    if kind in SIZES:
        return place(), sized(
            source,
            shape,
            kind,
            lambda key, count: source.inside(
                shape, key, (SIZE_DEFAULTS.get((kind, key), 1.0),) * count
            ),
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
    return from_z(source.unit(shape, source.inside(shape, "normal", (0.0, 0.0, 1.0)), "a normal"))
