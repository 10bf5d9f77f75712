# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""MJCF: bodies in bodies, the joints in each, and the equalities that close their loops.

MuJoCo reads it (see ``mjcf_compiled``): here its bodies, joints and geoms become a model.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pinocchio as pin

from hapticmech_ros.files.mjcf_compiler import TINY
from hapticmech_ros.formats.mjcf_compiled import SEEN, Compiled, pose
from hapticmech_ros.formats.mjcf_equalities import Equalities
from hapticmech_ros.formats.model import (
    DRAWN,
    DRIVEN,
    SENSED,
    UNKNOWN,
    WHY_ELSEWHERE,
    WORLD,
    Body,
    Document,
    Joint,
    Keyframe,
    Model,
    Note,
    Point,
    Rgba,
    Solid,
    State,
)
from hapticmech_ros.formats.shapes import find_mesh, not_zero, refused_kind
from hapticmech_ros.formats.xml_nodes import Node, Source

JOINT_TYPES = {"hinge": "revolute", "slide": "prismatic", "ball": "spherical", "free": "free"}
# MuJoCo's shape -> a scene's.
SHAPES = {
    **{kind: kind for kind in ("sphere", "capsule", "cylinder", "box", "mesh")},
    "plane": "half_space",
}
COLLIDES = "geom that collides"
# MuJoCo's viewer draws geoms of groups below this, unless asked otherwise; its colour of no colour.
GROUPS_DRAWN, NO_COLOUR = 3, (0.5, 0.5, 0.5, 1.0)
RIGID = "bodies are rigid"
INACTIVE = "inactive equality of a joint or tendon"
LEFT_OUT = "reference from a replica to outside"
OF_TENDON, ELSEWHERE = "armature of a tendon", "armature of an actuator on no hinge or slide"
CURVED = "nonlinear damping or stiffness"
WHY = {
    "geom": "drawn only; its inertia is used if the file requests that",
    "actuator": f"{DRIVEN}; armature is read",
    "sensor": SENSED,
    "tendon": "write springs between two frames in a scene file",
    "contact": "list contacts of shapes in a scene file",
    "deformable": RIGID,
    "camera": DRAWN,
    "light": DRAWN,
    "armature of a free joint": "a floating body has no rotor",
    "solref or solimp of an equality": "loops are closed exactly",
    "mocap": "the body stays where it is",
    "align": "frames stay where the file has them",
    "fluid": "nothing flows around bodies",
    "flag": "all forces are on, except gravity if the file disables it",
    "range of a ball": "only joints of one coordinate have stops",
    "stiffness of a ball or free joint": "only joints of one coordinate have springs",
    "frictionloss of a ball or free joint": "only joints of one coordinate have friction",
    CURVED: "only the linear part is read",
    INACTIVE: "write locked joints and couplings in a scene file",
    LEFT_OUT: "left out, as by MuJoCo's compiler",
    OF_TENDON: WHY_ELSEWHERE,
    ELSEWHERE: WHY_ELSEWHERE,
}
# Sections without a note: they are read, or do not affect the mechanism.
SILENT = (
    *("compiler", "option", "size", "visual", "statistic", "asset", "default", "worldbody"),
    *("keyframe", "equality"),
)


def read_mjcf(source: Source) -> Model:
    """Return the model in an MJCF file.

    Joints have the file's coordinates, ``ref`` included: a scene starts where the file draws it.

    Raises:
        SceneError: MuJoCo refuses it, or it breaks a rule; names line, element, value and rule.
    """
    return _Reader(Compiled(source)).read()


class _Reader:
    def __init__(self, compiled: Compiled) -> None:
        self._compiled, self._source, self._said = compiled, compiled.source, compiled.said
        self._notes: Counter[str] = Counter()
        self._kinds = {name: kind for name, _, kind in compiled.elements["joint"] if name}
        self._rotors = self._of_rotors()
        self._named = set(compiled.said["names"])
        self._moving = set(compiled.said["moving"])
        self._bodies: dict[str, Body] = {}
        # By number; joints that fix a body to its parent have none.
        self._names = [WORLD]
        self._joints: list[Joint] = []
        self._hinges: list[Joint] = []
        self._start: dict[str, State] = {}
        self._where: dict[tuple[str, str], str] = {}

    def read(self) -> Model:
        for number, name in enumerate(self._compiled.names("body")):
            if number:
                self._body(number, name)
        equalities = Equalities(self._compiled, self._names, self._joints)
        self._notes[INACTIVE] += equalities.inactive
        sites = enumerate(self._compiled.names("site"))
        root, path = self._source.root, self._source.path
        solids, visuals = self._geoms()
        return Model(
            root.attributes.get("model") or path.stem,
            self._bodies,
            [equalities.locked(hinge) for hinge in self._hinges],
            equalities.loop_joints,
            equalities.couplings,
            [Point(name, *self._place("site", number)) for number, name in sites if name],
            solids,
            tuple(self._said["gravity"]),
            notes=self._all_notes(),
            visuals=visuals,
            start=self._start,
            floating="a <freejoint/> makes a body float",
            keyframes=self._keyframes(),
            where=self._where,
            locks=equalities.reasons,
        )

    def _new(self, name: str) -> str:
        """Return a name that the file has not."""
        while name in self._named:
            name += "_"
        self._named.add(name)
        return name

    def _body(self, number: int, given: str) -> None:
        """Read a body that is not the world, and its joints."""
        compiled = self._compiled
        name = given or self._new(f"body{len(self._bodies) + 1}")
        self._where["link", name] = self._source.where(compiled.node("body", number))
        parent = self._names[int(compiled["body_parentid"][number])]
        place = compiled.place("body", number)
        self._names.append(name)
        self._bodies[name] = self._weighed(number, name)
        joints = np.flatnonzero(compiled["jnt_bodyid"] == number).tolist()
        if not joints:
            self._hinges.append(Joint(self._new(f"{name}_base"), "fixed", parent, name, place))
        for step, joint in enumerate(joints):
            last = step == len(joints) - 1
            child = name if last else self._new(f"{name}_{step}")
            if not last:
                self._bodies[child] = Body(child)
            alone = f"{name}_joint{step if len(joints) > 1 else ''}"
            self._hinges.append(self._joint(joint, alone, parent, child, place))
            self._joints.append(self._hinges[-1])
            parent, place = child, pin.SE3.Identity()

    def _weighed(self, number: int, name: str) -> Body:
        """Return a body with its inertia; one that is part of the world has none."""
        compiled = self._compiled
        carried = float(compiled["body_gravcomp"][number])
        if number not in self._moving:
            return Body(name, gravcomp=carried)
        mass, moments = compiled["body_mass"][number], compiled["body_inertia"][number]
        if number in self._said["bare"]:
            mass, moments = (np.where(x > 2.0 * TINY, x, 0.0) for x in (mass, moments))
        inside = pose(compiled["body_ipos"][number], compiled["body_iquat"][number])
        inertia = (inside.rotation * moments) @ inside.rotation.T
        # MuJoCo gives a body without mass an arbitrary centre.
        com = inside.translation.copy() if mass > 0.0 else np.zeros(3)
        return Body(name, float(mass), com, inertia, carried)

    def _joint(self, number: int, alone: str, parent: str, child: str, place: pin.SE3) -> Joint:
        """Return a joint from where its body is in the parent."""
        compiled, identity = self._compiled, pin.SE3.Identity()
        given, _, kind = compiled.elements["joint"][number]
        name = given or self._new(alone)
        self._where["joint", name] = self._source.where(compiled.node("joint", number))
        first, at = (int(compiled[f"jnt_{key}adr"][number]) for key in ("dof", "qpos"))
        damping, friction, armature = (
            float(compiled[f"dof_{key}"][first]) for key in ("damping", "frictionloss", "armature")
        )
        stiffness = float(compiled["jnt_stiffness"][number])
        bent = (*compiled["dof_dampingpoly"][first], *compiled["jnt_stiffnesspoly"][number])
        self._notes[CURVED] += any(bent)
        if kind in ("ball", "free"):
            self._notes["stiffness of a ball or free joint"] += stiffness != 0.0
            self._notes["frictionloss of a ball or free joint"] += friction != 0.0
        if kind == "free":
            self._notes["armature of a free joint"] += armature != 0.0
            self._start[name] = [float(x) for x in pin.SE3ToXYZQUAT(place)]
            return Joint(name, "free", parent, child, identity, damping=damping)
        anchor, back = pin.SE3.Identity(), pin.SE3.Identity()
        anchor.translation = compiled["jnt_pos"][number]
        if kind == "ball":
            self._notes["range of a ball"] += bool(any(compiled["jnt_range"][number]))
            joint = Joint(name, "spherical", parent, child, place * anchor, anchor.inverse())
            return replace(joint, damping=damping, armature=armature)
        axis, ref = compiled["jnt_axis"][number], float(compiled["qpos0"][at])
        if ref:
            self._start[name] = ref
        if kind == "hinge":
            back.rotation = pin.AngleAxis(-ref, axis).matrix()
        else:
            back.translation = -ref * axis
        lower, upper = (float(x) for x in compiled["jnt_range"][number])
        upper = lower if number in self._said["locked"] else upper
        return Joint(
            name,
            JOINT_TYPES[kind],
            parent,
            child,
            place * anchor * back,
            anchor.inverse(),
            axis,
            damping,
            friction,
            stiffness,
            float(compiled["qpos_spring"][at]),
            armature + self._rotors.get(name, 0.0),
            (lower, upper) if compiled["jnt_limited"][number] else None,
        )

    def _of_rotors(self) -> dict[str, float]:
        """Return by joint the armature by actuators' rotors: gear ratio squared times theirs."""
        found: dict[str, float] = {}
        self._notes[OF_TENDON] += int(np.count_nonzero(self._compiled["tendon_armature"]))
        for joint, gear, armature in self._said["rotors"]:
            if self._kinds.get(joint) in ("hinge", "slide"):
                found[joint] = found.get(joint, 0.0) + gear * gear * armature
            else:
                self._notes[ELSEWHERE] += 1
        return found

    def _place(self, kind: str, number: int) -> tuple[str, pin.SE3]:
        """Return the body of a site or geom, and where it is in it."""
        body = self._names[int(self._compiled[f"{kind}_bodyid"][number])]
        return body, self._compiled.place(kind, number)

    def _geoms(self) -> tuple[list[Solid], list[Solid]]:
        """Return the geoms that collide, and those that MuJoCo's viewer draws."""
        solids: list[Solid] = []
        drawn: list[Solid] = []
        for number, (kind, mesh, collides) in enumerate(self._said["geoms"]):
            shape = SHAPES.get(kind, kind)
            if mesh and kind != "mesh":
                shape = f"{kind} about a mesh"
            name, (body, place) = self._compiled.names("geom")[number], self._place("geom", number)
            read = partial(self._shape, number, shape, place)
            solid = Solid(name, body, shape, COLLIDES, read, self._colour(number))
            solids += [solid] if collides else []
            drawn += [solid] if self._compiled["geom_group"][number] < GROUPS_DRAWN else []
            self._notes["geom"] += not collides
        return solids, drawn

    def _colour(self, number: int) -> Rgba | None:
        """Return the colour of a geom, else of its material; None without both."""
        own, material = (self._compiled[f"geom_{key}"][number] for key in ("rgba", "matid"))
        if tuple(own) == NO_COLOUR:
            if material < 0:
                return None
            own = self._compiled["mat_rgba"][int(material)]
        red, green, blue, opacity = np.clip(own, 0.0, 1.0).tolist()
        return red, green, blue, opacity

    def _shape(self, number: int, shape: str, place: pin.SE3) -> tuple[pin.SE3, Document]:
        node = self._compiled.node("geom", number)
        if shape not in SHAPES.values():
            raise refused_kind(self._source, node, shape)
        radius, half, _ = (float(x) for x in self._compiled["geom_size"][number])
        sizes: Document = {}
        if shape == "mesh":
            mesh = int(self._compiled["geom_dataid"][number])
            if mesh >= 0:  # MuJoCo has it where its mass is
                parts = (self._compiled[f"mesh_{part}"][mesh] for part in ("pos", "quat"))
                place = place * pose(*parts).inverse()
            within, sizes = self._mesh(node, self._said["geoms"][number][1])
            place = place * within
        elif shape == "box":
            sizes = {"size": (2.0 * self._compiled["geom_size"][number]).tolist()}
        elif shape != "half_space":
            sizes = {"radius": radius}
            if shape != "sphere":
                sizes["length"] = 2.0 * half
        return place, {"kind": shape, **sizes}

    def _mesh(self, geom: Node, name: str) -> tuple[pin.SE3, Document]:
        """Return a mesh's frame in its geom's, and the mesh: v becomes S R' (v - p)."""
        source, mesh = self._source, self._said["meshes"].get(name)
        if mesh is None:
            raise source.error(geom, name, "no such mesh in <asset>")
        asset = self._compiled.at(mesh["line"])
        if not mesh["file"]:
            raise source.error(asset, None, "a mesh for contacts needs a file")
        scale = np.array(not_zero(source, asset, mesh["scale"]))
        turn = pose(np.zeros(3), mesh["refquat"] / np.linalg.norm(mesh["refquat"])).rotation
        turned = not np.allclose(turn, np.eye(3), rtol=0.0, atol=1e-12)
        if turned and np.ptp(scale) > 0.0:
            rule = "with refquat a mesh for contacts needs one scale for all its axes"
            raise source.error(asset, scale.tolist(), rule)
        within = pin.SE3(turn.T, -scale * (turn.T @ np.array(mesh["refpos"])))
        file = find_mesh(source, asset, mesh["file"], source.path.parent)
        return within, {"file": str(file), "scale": scale.tolist()}

    def _all_notes(self) -> list[Note]:
        notes, said, root = self._notes, self._said, self._source.root
        for what in ("mocap", "align", "fluid", "flag"):
            notes[what] += said[what]
        notes[LEFT_OUT] += self._compiled.left_out()
        for node in root.children:
            if node.tag == "equality":
                soft = [
                    one for one in node.children if {"solref", "solimp"} & one.attributes.keys()
                ]
                notes["solref or solimp of an equality"] += len(soft)
            elif node.tag == "worldbody":
                notes.update(one.tag for one in node.walk() if one.tag in SEEN)
            elif node.tag not in SILENT:
                notes[node.tag] += max(len(node.children), 1)
        return [Note(what, count, WHY.get(what, UNKNOWN)) for what, count in notes.items() if count]

    def _keyframes(self) -> dict[str, Keyframe]:
        """Return keyframes by name; those without one are called by their place, from 0."""
        compiled, found = self._compiled, dict[str, Keyframe]()
        for number, (has_q, has_v) in enumerate(self._said["keys"]):
            q, v = dict(self._start), dict[str, State]()
            for joint, hinge in enumerate(self._joints):
                at, first = (int(compiled[f"jnt_{key}adr"][joint]) for key in ("qpos", "dof"))
                if has_q:
                    q[hinge.name] = _position(hinge.type, compiled["key_qpos"][number, at:])
                if has_v:
                    rates = compiled["key_qvel"][number, first:]
                    v[hinge.name] = _rate(hinge.type, rates, q.get(hinge.name))
            found[compiled.names("key")[number] or str(number)] = Keyframe(q, v)
        return found


def _position(kind: str, numbers: np.ndarray) -> State:
    """Return a joint's position: quaternions end with w instead of beginning with it."""
    if kind in ("revolute", "prismatic"):
        return float(numbers[0])
    *place, w, x, y, z = map(float, numbers[: 7 if kind == "free" else 4])
    return [*place, x, y, z, w]


def _rate(kind: str, numbers: np.ndarray, position: State | None) -> State:
    """Return a joint's rates: a free one's velocity is in its own axes, not the world's."""
    if kind in ("revolute", "prismatic"):
        return float(numbers[0])
    if kind == "spherical" or not isinstance(position, Sequence):
        return [float(x) for x in numbers[:3]]
    rotation = pin.Quaternion(np.array(position[3:])).matrix()
    return [float(x) for x in (*(rotation.T @ numbers[:3]), *numbers[3:6])]
