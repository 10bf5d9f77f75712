"""The tree of a scene as a Pinocchio model (loops cut open), and the frames the scene names in it.

Joints are in depth-first order, whatever the order of the scene's links: Pinocchio's algorithms
take it for granted that a subtree's joints follow each other, and give a wrong D where they do not.
Fixed links are merged into the joint that carries them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import SceneError, SceneProblem
from hapticmech_ros.scene.document import Joint, Link, Origin, Scene
from hapticmech_ros.scene.rules import UNIT_PART, VELOCITY_SIZE, inertia_matrix

Array = np.ndarray


@dataclass(frozen=True)
class TreeModel:
    """Pinocchio model of the open tree, and where the scene's names are in it.

    Attributes:
        pinocchio: the model; gravity as in the scene.
        joint_names: moving joints in model order.
        joint_types: their types, as the scene says.
        link_joint: link name -> (Pinocchio joint index, placement of the link in the joint).
        damping: (nv,) viscous damping, N m s/rad or N s/m.
    """

    pinocchio: pin.Model
    joint_names: tuple[str, ...]
    joint_types: tuple[str, ...]
    link_joint: dict[str, tuple[int, pin.SE3]]
    damping: Array

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
        joint, placement = self.link_joint[link]
        frame = pin.Frame(name, joint, placement * se3(origin), pin.FrameType.OP_FRAME)
        return int(self.pinocchio.addFrame(frame))


def build_tree(scene: Scene) -> TreeModel:
    """Build the Pinocchio model of ``scene`` without its closures."""
    model = pin.Model()
    model.name = scene.name
    model.gravity.linear = np.array(scene.gravity)
    link_joint: dict[str, tuple[int, pin.SE3]] = {"world": (0, pin.SE3.Identity())}
    names: list[str] = []
    types: list[str] = []
    damping: list[float] = []
    for link in _depth_first(scene):
        parent_joint, parent_placement = link_joint[link.parent]
        placement = parent_placement * se3(link.joint.origin)
        if link.joint.type == "fixed":
            link_joint[link.name] = (parent_joint, placement)
            joint, body_placement = parent_joint, placement
        else:
            joint = model.addJoint(
                parent_joint, _joint_model(link.joint), placement, link.joint.name
            )
            body_placement = pin.SE3.Identity()
            link_joint[link.name] = (joint, body_placement)
            names.append(link.joint.name)
            types.append(link.joint.type)
            damping.extend([link.joint.damping] * VELOCITY_SIZE[link.joint.type])
        body = pin.Inertia(
            link.inertial.mass,
            np.array(link.inertial.com),
            inertia_matrix(link.inertial.inertia),
        )
        model.appendBodyToJoint(joint, body, body_placement)
    return TreeModel(model, tuple(names), tuple(types), link_joint, np.array(damping))


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
    """Return (q, v) exactly as the scene's author wrote them, joints left out at zero.

    Raises:
        SceneError: no joint moves.
    """
    model = tree.pinocchio
    if model.nv == 0:
        rule = "at least one joint must move"
        raise SceneError(scene.name, [SceneProblem("links", len(scene.links), rule)])
    q = pin.neutral(model)
    v = np.zeros(model.nv)
    for index, name in enumerate(tree.joint_names):
        if name in scene.initial_state.q:
            position = np.atleast_1d(np.array(scene.initial_state.q[name], dtype=float))
            unit = UNIT_PART.get(tree.joint_types[index])
            if unit is not None:
                position[unit] /= np.linalg.norm(position[unit])
            q[tree.position_slice(index)] = position
        if name in scene.initial_state.v:
            v[tree.velocity_slice(index)] = scene.initial_state.v[name]
    return q, v


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
