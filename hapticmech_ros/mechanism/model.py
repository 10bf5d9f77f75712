# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tree of a scene as a Pinocchio model (loops cut open), and the frames the scene names in it.

Joints are in depth-first order, for any order of the scene's links: Pinocchio's algorithms take it
for granted that a subtree's joints follow each other, and give a wrong D where they do not. Links
on fixed and locked joints are merged into the joint that carries them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Joint, Link, Origin
from hapticmech_ros.scene.rules import UNIT_PART, VELOCITY_SIZE, inertia_matrix


@dataclass(frozen=True)
class TreeModel:
    """Pinocchio model of the open tree, and where the scene's names are in it.

    Attributes:
        pinocchio: the model; gravity as in the scene.
        joint_names: moving joints in model order.
        joint_types: their types in the scene.
        link_joint: link name -> (Pinocchio joint index, placement of the link in the joint).
        damping: (nv,) viscous damping, N m s/rad or N s/m.
        joints: moving joints, as the scene has them.
        links: the links that they carry.
        carried: (j, 4) per joint of the model the part that ``gravcomp`` carries: mass, kg, and
            mass times centre of mass in the joint's frame, kg m.
    """

    pinocchio: pin.Model
    joint_names: tuple[str, ...]
    joint_types: tuple[str, ...]
    link_joint: dict[str, tuple[int, pin.SE3]]
    damping: Array
    joints: tuple[Joint, ...]
    links: tuple[str, ...]
    carried: Array

    def carried_force(self, data: pin.Data) -> Array:
        """Return the reduction of gravity's joint forces (nv,), N m or N, by ``gravcomp``.

        Args:
            data: of the model, with joint Jacobians.
        """
        force, gravity = np.zeros(int(self.pinocchio.nv)), self.pinocchio.gravity.linear
        for joint in np.flatnonzero(self.carried.any(axis=1)).tolist():
            mass, lever = self.carried[joint, 0], data.oMi[joint].rotation @ self.carried[joint, 1:]
            axes = pin.getJointJacobian(self.pinocchio, data, joint, pin.LOCAL_WORLD_ALIGNED)
            force += axes.T @ np.concatenate((mass * gravity, np.cross(lever, gravity)))
        return force

    def carried_energy(self, data: pin.Data) -> float:
        """Return the reduction of the weights' potential energy by ``gravcomp``, J.

        Args:
            data: of the model, with joints placed.
        """
        total = 0.0
        for joint in np.flatnonzero(self.carried.any(axis=1)).tolist():
            place, (mass, *lever) = data.oMi[joint], self.carried[joint]
            at = mass * place.translation + place.rotation @ np.array(lever)
            total -= float(self.pinocchio.gravity.linear @ at)
        return total

    def position_slice(self, joint: int) -> slice:
        """Return where joint number ``joint`` (0 = first moving one) is in q."""
        start = self.pinocchio.joints[joint + 1].idx_q
        return slice(start, start + self.pinocchio.joints[joint + 1].nq)

    def velocity_slice(self, joint: int) -> slice:
        """Return where joint number ``joint`` (0 = first moving one) is in v."""
        start = self.pinocchio.joints[joint + 1].idx_v
        return slice(start, start + self.pinocchio.joints[joint + 1].nv)

    def add_frame(self, name: str, link: str, origin: Origin) -> int:
        """Add an operational frame fixed in ``link`` (or ``world``) and return its index."""
        frame = pin.Frame(name, *self.place(link, origin), pin.FrameType.OP_FRAME)
        return int(self.pinocchio.addFrame(frame))

    def place(self, link: str, origin: Origin) -> tuple[int, pin.SE3]:
        """Return the joint that carries a frame fixed in ``link``, and the frame in it."""
        joint, placement = self.link_joint[link]
        return joint, placement * se3(origin)

    def extent(self) -> float:
        """Return the largest distance (m) between a joint and anything placed in its link.

        In the world it is the largest between any two: how far away all of it stands counts not.
        """
        model = self.pinocchio
        placed = [(frame.parentJoint, frame.placement.translation) for frame in model.frames[1:]]
        placed += [
            (parent, placement.translation)
            for parent, placement in zip(model.parents[1:], model.jointPlacements[1:], strict=True)
        ]
        placed += [(joint, inertia.lever) for joint, inertia in enumerate(model.inertias) if joint]
        length = max((float(np.linalg.norm(at)) for joint, at in placed if joint), default=0.0)
        fixed = np.array([at for joint, at in placed if joint == 0]).reshape(-1, 3)
        for at in fixed:
            length = max(length, float(np.linalg.norm(fixed - at, axis=1).max()))
        return length if length > 0.0 else 1.0


def build_tree(scene: Scene) -> TreeModel:
    """Return the Pinocchio model of ``scene`` without its closures."""
    model = pin.Model()
    model.name = scene.name
    model.gravity.linear = np.array(scene.gravity)
    link_joint: dict[str, tuple[int, pin.SE3]] = {"world": (0, pin.SE3.Identity())}
    moving: list[Link] = []
    carried: dict[int, Array] = {}
    for link in _depth_first(scene):
        parent_joint, parent_placement = link_joint[link.parent]
        placement = parent_placement * se3(link.joint.origin)
        if not moves(link.joint):
            joint = parent_joint
            body_placement = parent_placement * placement_of(scene, link.joint)
        else:
            joint = model.addJoint(
                parent_joint, _joint_model(link.joint), placement, link.joint.name
            )
            body_placement = pin.SE3.Identity()
            moving.append(link)
            part = model.idx_vs[joint]
            model.armature[part : part + model.nvs[joint]] = link.joint.armature
        link_joint[link.name] = (joint, body_placement)
        body = pin.Inertia(
            link.inertial.mass,
            np.array(link.inertial.com),
            inertia_matrix(link.inertial.inertia),
        )
        model.appendBodyToJoint(joint, body, body_placement)
        mass = link.gravcomp * body.mass
        lever = mass * body_placement.act(body.lever)
        carried[joint] = carried.get(joint, np.zeros(4)) + np.concatenate(([mass], lever))
    joints = tuple(link.joint for link in moving)
    damping = [joint.damping for joint in joints for _ in range(VELOCITY_SIZE[joint.type])]
    return TreeModel(
        model,
        tuple(joint.name for joint in joints),
        tuple(joint.type for joint in joints),
        link_joint,
        np.array(damping),
        joints,
        tuple(link.name for link in moving),
        np.array([carried.get(joint, np.zeros(4)) for joint in range(model.njoints)]),
    )


def moves(joint: Joint) -> bool:
    """Return whether a joint has degrees of freedom: it is neither fixed nor locked."""
    return joint.type != "fixed" and not joint.locked


def placement_of(scene: Scene, joint: Joint) -> pin.SE3:
    """Return the link of a fixed or locked joint in its parent, at the authored position."""
    origin = se3(joint.origin)
    if joint.type == "fixed":
        return origin
    alone = pin.Model()
    alone.addJoint(0, _joint_model(joint), origin, joint.name)
    data = alone.createData()
    position = authored_position(scene, joint)
    pin.forwardKinematics(alone, data, pin.neutral(alone) if position is None else position)
    return data.oMi[1].copy()


def _depth_first(scene: Scene) -> Iterator[Link]:
    """Yield the links parents first and each subtree whole, siblings in the scene's order."""
    children: dict[str, list[Link]] = {"world": []}
    for link in scene.links:
        children.setdefault(link.parent, []).append(link)
    waiting = children["world"][::-1]
    while waiting:
        link = waiting.pop()
        yield link
        waiting += children.get(link.name, [])[::-1]


def authored_state(scene: Scene, tree: TreeModel) -> tuple[Array, Array]:
    """Return q (nq,) and v (nv,) as in the scene; joints left out are neutral and at rest."""
    model = tree.pinocchio
    q = pin.neutral(model)
    v = np.zeros(model.nv)
    for index, joint in enumerate(tree.joints):
        position = authored_position(scene, joint)
        if position is not None:
            q[tree.position_slice(index)] = position
        if joint.name in scene.initial_state.v:
            v[tree.velocity_slice(index)] = scene.initial_state.v[joint.name]
    return q, v


def authored_position(scene: Scene, joint: Joint) -> Array | None:
    """Return the joint's part (k,) of q, rad or m, unit part exact; None if left out."""
    if joint.name not in scene.initial_state.q:
        return None
    position = np.atleast_1d(np.array(scene.initial_state.q[joint.name], dtype=float))
    unit = UNIT_PART.get(joint.type)
    if unit is not None:
        position[unit] /= np.linalg.norm(position[unit])
    return position


def se3(origin: Origin) -> pin.SE3:
    """Return the homogeneous transform of a scene origin."""
    return pin.SE3(pin.rpy.rpyToMatrix(*origin.rpy), np.array(origin.xyz))


def _joint_model(joint: Joint) -> pin.JointModel:
    axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
    if joint.type == "revolute":
        return pin.JointModelRevoluteUnaligned(axis)
    if joint.type == "prismatic":
        return pin.JointModelPrismaticUnaligned(axis)
    simple = {
        "spherical": pin.JointModelSpherical,
        "free": pin.JointModelFreeFlyer,
        "planar": pin.JointModelPlanar,
    }
    return simple[joint.type]()
