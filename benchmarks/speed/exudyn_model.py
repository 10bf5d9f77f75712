# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scene as an Exudyn system: a kinematic tree in joint coordinates, closures as its joints."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.accuracy.cases import Output
from benchmarks.speed.contender import (
    State,
    UnsuitableError,
    joint_place,
    refuse_what_no_peer_has,
)
from hapticmech_ros.mechanism.model import TreeModel, build_tree, se3
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Closure, LinkFrame

NAME = "exudyn"
# A tree with closures takes time with a high power of its size.
MOST_JOINTS = 20
CONSTRAINED = {
    "planar_pin": [1, 1, 0, 0, 0, 0],
    "spherical": [1, 1, 1, 0, 0, 0],
    "revolute": [1, 1, 1, 1, 1, 0],
    "weld": [1, 1, 1, 1, 1, 1],
}


class ExudynScene:
    """A scene in Exudyn.

    Revolute and prismatic joints make one kinematic tree, whose coordinates are those of our tree;
    free links that carry nothing are rigid bodies of their own.

    Args:
        scene: what to convert.
        start: initial state.

    Attributes:
        system: assembled.
        tree: ours.
        bodies: number of the Exudyn body of each free link, by joint of ours.
        node: of the kinematic tree's coordinates.

    Raises:
        UnsuitableError: friction, stops, rods, balls, or free links that carry others.
    """

    def __init__(self, scene: Scene, start: State) -> None:
        import exudyn
        from exudyn import itemInterface

        refuse_what_no_peer_has(scene, NAME)
        self._exudyn: Any = exudyn
        self._items: Any = itemInterface
        self._scene = scene
        self._container: Any = exudyn.SystemContainer()
        self.system: Any = self._container.AddSystem()
        self.tree: TreeModel = build_tree(scene)
        self.bodies: dict[int, Any] = {}
        # Number of each joint's link in the kinematic tree, and its axes in those of our link.
        self._numbers: dict[int, int] = {}
        self._turns: dict[int, Array] = {}
        self._ground = self.system.AddObject(self._items.ObjectGround())
        kinds = dict(enumerate(self.tree.joint_types, start=1))
        for joint, kind in kinds.items():
            if kind == "free":
                self._add_free(joint, start)
            elif kind not in ("revolute", "prismatic"):
                raise UnsuitableError(NAME, scene.name, f"a {kind} joint")
        self.places = [joint for joint in kinds if joint not in self.bodies]
        if self.closed and len(self.places) > MOST_JOINTS:
            reason = f"closures of more than {MOST_JOINTS} joints: the Jacobian is by differences"
            raise UnsuitableError(NAME, scene.name, reason)
        self._add_tree(start)
        for closure in scene.closures:
            if closure.active:
                self._add_closure(closure)
        for spring in scene.springs:
            markers = [self._marker(end) for end in (spring.a, spring.b)]
            self.system.AddObject(
                itemInterface.ObjectConnectorSpringDamper(
                    markerNumbers=markers,
                    referenceLength=spring.rest_length,
                    stiffness=spring.stiffness,
                    damping=spring.damping,
                )
            )
        self.system.Assemble()
        self._data = self.tree.pinocchio.createData()
        self._points = {point.name: point for point in scene.operational_points}

    @property
    def closed(self) -> bool:
        """Whether there are closures."""
        return any(closure.active for closure in self._scene.closures)

    def read(self, output: Output) -> tuple[float, ...]:
        """Return what an output is in the initial configuration, where runs end, m or rad."""
        initial, kinds = self._exudyn.ConfigurationType.Initial, self._exudyn.OutputVariableType
        found = self.system.GetNodeOutput(self.node, kinds.Coordinates, initial)
        q = np.array(pin.neutral(self.tree.pinocchio))
        for joint, value in zip(self.places, np.atleast_1d(found), strict=True):
            q[self.tree.position_slice(joint - 1)] = value
        if output.kind == "joint":
            at = joint_place(self.tree, output.name)
            return tuple(float(q[at + k]) for k in output.components)
        point = self._points[output.name]
        joint, within = self.tree.link_joint[point.link]
        local = within.act(np.array(point.origin.xyz))
        if joint in self.bodies:
            body = self.bodies[joint]
            position = self.system.GetObjectOutputBody(body, kinds.Position, local, initial)
        else:
            pin.forwardKinematics(self.tree.pinocchio, self._data, q)
            position = self._data.oMi[joint].act(local)
        return tuple(float(position[k]) for k in output.components)

    def _add_free(self, joint: int, start: State) -> None:
        utilities = import_module("exudyn.utilities")
        model = self.tree.pinocchio
        if any(model.parents[other] == joint for other in range(1, model.njoints)):
            raise UnsuitableError(NAME, self._scene.name, "a free link that carries others")
        at, rate = self.tree.position_slice(joint - 1), self.tree.velocity_slice(joint - 1)
        pose = model.jointPlacements[joint] * pin.XYZQUATToSE3(start.q[at])
        linear, angular = start.v[rate][:3], start.v[rate][3:]
        inertia = model.inertias[joint]
        self.bodies[joint] = self.system.CreateRigidBody(
            referencePosition=pose.translation,
            referenceRotationMatrix=pose.rotation,
            initialVelocity=pose.rotation @ linear,
            initialAngularVelocity=pose.rotation @ angular,
            inertia=utilities.RigidBodyInertia(
                inertia.mass,
                inertia.inertia + inertia.mass * _parallel(inertia.lever),
                inertia.lever,
            ),
            gravity=list(self._scene.gravity),
            show=False,
        )

    def _add_tree(self, start: State) -> None:
        model, joints = self.tree.pinocchio, self.tree.joints
        types, parents, frames, moments, centres, masses = [], [], [], [], [], []
        first, speed = [], []
        for number, joint in enumerate(self.places):
            spec = joints[joint - 1]
            turning = spec.type == "revolute"
            kinds = self._exudyn.JointType
            types.append(kinds.RevoluteZ if turning else kinds.PrismaticZ)
            self._numbers[joint], self._turns[joint] = number, _onto_z(np.array(spec.axis))
            parent, turn = model.parents[joint], self._turns[joint]
            if parent in self.bodies:
                raise UnsuitableError(NAME, self._scene.name, "a free link that carries others")
            parents.append(self._numbers.get(parent, -1))
            before = self._turns.get(parent, np.eye(3))
            placed = model.jointPlacements[joint]
            frame = np.eye(4)
            frame[:3, :3] = before.T @ placed.rotation @ turn
            frame[:3, 3] = before.T @ placed.translation
            inertia = model.inertias[joint]
            frames.append(frame)
            moments.append(turn.T @ inertia.inertia @ turn)
            centres.append(turn.T @ inertia.lever)
            masses.append(inertia.mass)
            first.append(float(start.q[self.tree.position_slice(joint - 1)][0]))
            speed.append(float(start.v[self.tree.velocity_slice(joint - 1)][0]))
        specs, count = [joints[joint - 1] for joint in self.places], len(self.places)
        self.node = self.system.AddNode(
            self._items.NodeGenericODE2(
                numberOfODE2Coordinates=count,
                referenceCoordinates=[0.0] * count,
                initialCoordinates=first,
                initialCoordinates_t=speed,
            )
        )
        laws = any(spec.stiffness or spec.damping for spec in specs)
        gains: dict[str, Any] = {}
        if laws:
            gains = {
                "jointPositionOffsetVector": [spec.rest for spec in specs],
                "jointVelocityOffsetVector": [0.0] * count,
                "jointPControlVector": [spec.stiffness for spec in specs],
                "jointDControlVector": [spec.damping for spec in specs],
            }
        self.kinematic_tree = self.system.AddObject(
            self._items.ObjectKinematicTree(
                nodeNumber=self.node,
                jointTypes=types,
                linkParents=parents,
                jointHTs=frames,
                linkInertiasCOM=self._exudyn.Matrix3DList(moments),
                linkCOMs=self._exudyn.Vector3DList(centres),
                linkMasses=masses,
                gravity=list(self._scene.gravity),
                jointForceVector=[spec.effort for spec in specs],
                **gains,
            )
        )

    def _add_closure(self, closure: Closure) -> None:
        if closure.kind == "rod":
            raise UnsuitableError(NAME, self._scene.name, f"rod {closure.name}")
        # Axes of rows are those of the first marker, which for a pin have to be the world's.
        ends = (closure.b, closure.a) if closure.b.link == "world" else (closure.a, closure.b)
        self.system.AddObject(
            self._items.ObjectJointGeneric(
                markerNumbers=[self._marker(end) for end in ends],
                constrainedAxes=CONSTRAINED[closure.kind],
            )
        )

    def _marker(self, frame: LinkFrame) -> Any:
        joint, within = self.tree.link_joint[frame.link]
        placed = within * se3(frame.origin)
        if joint not in self._numbers:
            body = self.bodies.get(joint, self._ground)
            marker = self._items.MarkerBodyRigid(bodyNumber=body, localHT=placed.homogeneous)
            return self.system.AddMarker(marker)
        turned = np.eye(4)
        turned[:3, :3] = self._turns[joint].T @ placed.rotation
        turned[:3, 3] = self._turns[joint].T @ placed.translation
        return self.system.AddMarker(
            self._items.MarkerKinematicTreeRigid(
                objectNumber=self.kinematic_tree,
                linkNumber=self._numbers[joint],
                localHT=turned,
            )
        )


def _onto_z(axis: Array) -> Array:
    """Return (3, 3) a rotation whose third column is the axis."""
    unit = axis / np.linalg.norm(axis)
    return np.array(pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), unit).matrix())


def _parallel(lever: Array) -> Array:
    """Return (3, 3) the moments of a unit mass at ``lever``."""
    return float(lever @ lever) * np.eye(3) - np.outer(lever, lever)
