"""SDFormat: one model, loops included: a link that two joints carry closes one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.model import WORLD, Body, Hinge, Model, Note, Point, Solid
from hapticmech_ros.formats.sdf_shapes import solid_of
from hapticmech_ros.formats.xml_nodes import Node, Source
from hapticmech_ros.scene.part import LARGEST

JOINT_TYPES = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "ball": "spherical",
    "fixed": "fixed",
}
WHY = {
    "visual": "pictures are drawn from the joints",
    "plugin": "of another simulator",
    "sensor": "nothing is sensed but poses and wrenches",
    "limit effort": "nothing drives a joint but the hand and what the scene says",
    "limit velocity": "nothing drives a joint but the hand and what the scene says",
}
UNKNOWN = "not of a mechanism, or not known"
HERE = "__model__"
# How many frames may be attached to each other.
DEEP = 100
# Versions of the format in which axes are those of the model.
OF_MODEL = ("1.0", "1.2", "1.3", "1.4")
JOINT_KNOWN = {"parent", "child", "pose", "axis"}
LINK_KNOWN = {"pose", "inertial", "collision"}


def read_sdf(source: Source) -> Model:
    """Read an SDF file with one model, alone or in a world.

    Raises:
        SceneError: it breaks a rule; names line, element, value and rule.
    """
    world = source.root.first("world")
    models = [*source.root.all("model"), *(world.all("model") if world is not None else [])]
    if len(models) != 1:
        raise source.error(source.root, len(models), "needs one <model>")
    gravity = world.first("gravity") if world is not None else None
    vector = None
    if gravity is not None:
        x, y, z = source.numbers(gravity, gravity.text, 3)
        vector = (x, y, z)
    return _Reader(source, models[0]).read(vector)


@dataclass
class _Reader:
    source: Source
    model: Node
    notes: Counter[str] = field(default_factory=Counter)
    placed: dict[str, tuple[str, pin.SE3]] = field(default_factory=dict)
    poses: dict[str, pin.SE3] = field(default_factory=dict)
    solids: list[Solid] = field(default_factory=list)
    joints: dict[str, Node] = field(default_factory=dict)
    frames: dict[str, Node] = field(default_factory=dict)

    def read(self, gravity: tuple[float, float, float] | None) -> Model:
        source, model = self.source, self.model
        for node in model.children:
            if node.tag in ("model", "include"):
                name = node.attributes.get("name")
                raise source.error(node, name, "models in models are not read")
            if node.tag in ("link", "joint", "frame"):
                self._place(node)
            elif node.tag == "static":
                if node.text.strip() in ("true", "1"):
                    raise source.error(node, node.text, "a static model does not move")
            elif node.tag not in ("pose", "self_collide"):
                self.notes[node.tag] += 1
        relative, own = self._written(model)
        if relative not in ("", WORLD) or "placement_frame" in model.attributes:
            rule = "a model is placed by its own frame in the world"
            raise source.error(model, relative or model.attributes["placement_frame"], rule)
        self.poses = {HERE: own, WORLD: pin.SE3.Identity()}
        bodies = {}
        for link in model.all("link"):
            body = self._body(link)
            bodies[body.name] = body
        hinges = [self._hinge(joint, bodies) for joint in model.all("joint")]
        points = [self._point(name, frame, bodies) for name, frame in self.frames.items()]
        notes = [Note(what, count, WHY.get(what, UNKNOWN)) for what, count in self.notes.items()]
        name = model.attributes.get("name") or source.path.stem
        bases = {body: self._pose(body, model) for body in bodies}
        return Model(
            name,
            bodies,
            hinges,
            points=points,
            solids=self.solids,
            gravity=gravity,
            bases=bases,
            notes=notes,
        )

    def _place(self, node: Node) -> None:
        """Note where a link, joint or frame is said to be: in what other, and how."""
        name = self.source.text(node, "name")
        if name in self.placed or name in (WORLD, HERE):
            raise self.source.error(node, name, "names of links, joints, frames must be unique")
        relative, pose = self._written(node)
        if not relative:
            attached = node.attributes.get("attached_to", "") or HERE
            relative = self._end_name(node, "child") if node.tag == "joint" else attached
        self.placed[name] = (relative, pose)
        if node.tag != "link":
            named = self.joints if node.tag == "joint" else self.frames
            named[name] = node

    def _written(self, node: Node) -> tuple[str, pin.SE3]:
        """Return what an element's pose is relative to, empty if it does not say, and the pose."""
        written = node.first("pose")
        if written is None:
            return "", pin.SE3.Identity()
        if written.attributes.get("frame", ""):
            rule = "frames of SDFormat 1.6 and before are not read: say relative_to"
            raise self.source.error(written, written.attributes["frame"], rule)
        if written.attributes.get("rotation_format", "euler_rpy") != "euler_rpy":
            rule = "rotations must be euler_rpy"
            raise self.source.error(written, written.attributes["rotation_format"], rule)
        values = self.source.numbers(written, written.text or "0 0 0 0 0 0", 6, "a pose")
        turn = np.array(values[3:])
        if written.attributes.get("degrees", "false") in ("true", "1"):
            turn = np.deg2rad(turn)
        pose = pin.SE3(pin.rpy.rpyToMatrix(*turn), np.array(values[:3]))
        return written.attributes.get("relative_to", ""), pose

    def _pose(self, name: str, node: Node) -> pin.SE3:
        """Return where something is in the world."""
        chain: dict[str, None] = {}  # in order
        while name not in self.poses:
            if name not in self.placed:
                raise self.source.error(node, name, "no such link, joint or frame")
            if name in chain:
                rule = "poses are relative to each other in a circle"
                raise self.source.error(node, list(chain)[:5], rule)
            chain[name] = None
            name = self.placed[name][0]
        for one in reversed(chain):
            relative, pose = self.placed[one]
            self.poses[one] = self.poses[relative] * pose
        return self.poses[next(iter(chain), name)]

    def _body(self, link: Node) -> Body:
        name = self.source.text(link, "name")
        self.notes.update(part.tag for part in link.children if part.tag not in LINK_KNOWN)
        for part in link.all("collision"):
            place = partial(self._within, part, name)
            self.solids.append(solid_of(self.source, part, name, place))
        inertial = link.first("inertial")
        if inertial is None:
            return Body(name, 1.0, np.zeros(3), np.eye(3))  # SDFormat's own default
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
        relative, place = self._written(inertial)
        if relative not in ("", name):
            raise self.source.error(inertial, relative, "an inertia is relative to its link")
        return Body(name, mass, place.translation.copy(), place.rotation @ own @ place.rotation.T)

    def _within(self, node: Node, link: str) -> pin.SE3:
        """Return where an element of a link is in it."""
        relative, place = self._written(node)
        if not relative:
            return place
        return self._pose(link, node).actInv(self._pose(relative, node) * place)

    def _number(
        self, node: Node | None, tag: str, default: float, largest: float = LARGEST
    ) -> float:
        """Return the number in an element."""
        found = node.first(tag) if node is not None else None
        if found is None:
            return default
        return self.source.numbers(found, found.text, 1, tag, largest)[0]

    def _end_name(self, joint: Node, end: str) -> str:
        found = joint.first(end)
        name = found.text.strip() if found is not None else ""
        if not name:
            raise self.source.error(joint, joint.attributes.get("name"), f"needs a <{end}>")
        return name

    def _hinge(self, joint: Node, bodies: Mapping[str, Body]) -> Hinge:
        name, kind = self.source.text(joint, "name"), self.source.text(joint, "type")
        if kind not in JOINT_TYPES:
            rule = f"type must be one of {sorted(JOINT_TYPES)}"
            raise self.source.error(joint, kind, rule)
        self.notes.update(part.tag for part in joint.children if part.tag not in JOINT_KNOWN)
        parent, child = (self._end_name(joint, end) for end in ("parent", "child"))
        for body in (parent, child):
            if body not in bodies and body != WORLD:
                raise self.source.error(joint, body, "no such link")
        place = self._pose(name, joint)
        before, behind = self._pose(parent, joint), self._pose(child, joint)
        moves = kind in ("revolute", "continuous", "prismatic")
        axis = joint.first("axis")
        if moves and axis is None:
            raise self.source.error(joint, name, "needs an <axis>")
        dynamics = axis.first("dynamics") if axis is not None else None
        return Hinge(
            name,
            JOINT_TYPES[kind],
            parent,
            child,
            before.actInv(place),
            place.actInv(behind),
            self._axis(axis, place) if moves and axis is not None else np.array((0.0, 0.0, 1.0)),
            damping=self._number(dynamics, "damping", 0.0),
            friction=self._number(dynamics, "friction", 0.0) if moves else 0.0,
            stiffness=self._number(dynamics, "spring_stiffness", 0.0) if moves else 0.0,
            rest=self._number(dynamics, "spring_reference", 0.0) if moves else 0.0,
            limits=self._limits(axis) if kind in ("revolute", "prismatic") else None,
        )

    def _axis(self, axis: Node, place: pin.SE3) -> np.ndarray:
        written = axis.first("xyz")
        if written is None:
            return np.array((0.0, 0.0, 1.0))
        vector = np.array(self.source.numbers(written, written.text, 3, "an axis"))
        size = float(np.linalg.norm(vector))
        if not size > 0.0:
            raise self.source.error(written, vector.tolist(), "an axis must not be zero")
        frame = written.attributes.get("expressed_in", "") or self._axes_of(axis)
        if frame:
            vector = place.rotation.T @ self._pose(frame, written).rotation @ vector
        return np.asarray(vector / size)

    def _axes_of(self, axis: Node) -> str:
        """Return the frame of an axis that names none; empty if it is its joint's."""
        own = axis.first("use_parent_model_frame")
        before = self.source.root.attributes.get("version", "").strip() in OF_MODEL
        of_model = before if own is None else own.text.strip() in ("true", "1")
        return HERE if of_model else ""

    def _limits(self, axis: Node | None) -> tuple[float, float] | None:
        limit = axis.first("limit") if axis is not None else None
        if limit is None:
            return None
        self.notes.update(f"limit {t}" for t in ("effort", "velocity") if limit.first(t))
        lower = self._number(limit, "lower", -np.inf, np.inf)
        upper = self._number(limit, "upper", np.inf, np.inf)
        if lower > upper:
            raise self.source.error(limit, (lower, upper), "lower must not be above upper")
        return lower, upper

    def _point(self, name: str, frame: Node, bodies: Mapping[str, Body]) -> Point:
        """Return a frame of the file, fixed in the link that it is attached to."""
        body, seen = frame.attributes.get("attached_to", ""), {name}
        while body and body not in bodies and body not in seen and len(seen) < DEEP:
            seen.add(body)
            if body in self.joints:
                body = self._end_name(self.joints[body], "child")
            elif body in self.frames:
                body = self.frames[body].attributes.get("attached_to", "")
            elif body in (HERE, WORLD):
                body = ""
            else:
                raise self.source.error(frame, body, "no such link, joint or frame")
        if body and body not in bodies:
            rule = f"frames are attached to each other in a circle, or more than {DEEP} deep"
            raise self.source.error(frame, body, rule)
        place = self._pose(body or WORLD, frame).actInv(self._pose(name, frame))
        return Point(name, body or WORLD, place)
