# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A planar scene as an Exudyn system of rigid bodies in the plane: three coordinates each."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.accuracy.cases import Output
from benchmarks.speed.contender import State, UnsuitableError, refuse_what_no_peer_has
from benchmarks.speed.exudyn_model import NAME
from hapticmech_ros.mechanism.model import TreeModel, build_tree, se3
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Joint, LinkFrame

PINS = ("planar_pin", "spherical", "revolute")


class ExudynPlane:
    """A planar scene of hinges about z in Exudyn, every hinge and closure a constraint.

    Redundant coordinates suit it better than a kinematic tree: its Jacobian is cheap.

    Args:
        scene: what to convert.
        start: initial state.

    Attributes:
        system: assembled.

    Raises:
        UnsuitableError: not planar, friction, stops, springs or dampers in hinges.
    """

    closed = True

    def __init__(self, scene: Scene, start: State) -> None:
        import exudyn
        from exudyn import itemInterface

        refuse_what_no_peer_has(scene, NAME)
        if not _takes(scene):
            raise UnsuitableError(NAME, scene.name, "not planar, or laws in hinges")
        self._exudyn: Any = exudyn
        self._items: Any = itemInterface
        self._scene = scene
        self._container: Any = exudyn.SystemContainer()
        self.system: Any = self._container.AddSystem()
        self._tree: TreeModel = build_tree(scene)
        model = self._tree.pinocchio
        data = model.createData()
        pin.forwardKinematics(model, data, start.q, start.v)
        self._bodies: list[Any] = [self.system.AddObject(self._items.ObjectGround())]
        self._nodes: list[Any] = [None]
        for number, joint in enumerate(self._tree.joints, start=1):
            self._add_body(number, joint, data)
        for number, joint in enumerate(self._tree.joints, start=1):
            within = model.jointPlacements[number].translation
            parent = model.parents[number]
            self._pin(self._marker(parent, within), self._marker(number, np.zeros(3)))
            if joint.effort:
                self._add_effort(parent, -joint.effort)
                self._add_effort(number, joint.effort)
        for closure in scene.closures:
            if closure.active:
                if closure.kind not in PINS:
                    raise UnsuitableError(NAME, scene.name, f"{closure.kind} {closure.name}")
                self._pin(self._frame_marker(closure.a), self._frame_marker(closure.b))
        for spring in scene.springs:
            self.system.AddObject(
                self._items.ObjectConnectorSpringDamper(
                    markerNumbers=[self._frame_marker(end) for end in (spring.a, spring.b)],
                    referenceLength=spring.rest_length,
                    stiffness=spring.stiffness,
                    damping=spring.damping,
                )
            )
        self.system.Assemble()
        self._start = start

    def read(self, output: Output) -> tuple[float, ...]:
        """Return what an output is in the initial configuration, where runs end, m or rad."""
        initial, kinds = self._exudyn.ConfigurationType.Initial, self._exudyn.OutputVariableType
        if output.kind == "joint":
            number = self._tree.joint_names.index(output.name) + 1
            parent = self._tree.pinocchio.parents[number]
            turned = self._turned(number) - (self._turned(parent) if parent else 0.0)
            at = self._tree.position_slice(number - 1).start
            return (float(self._start.q[at] + turned),)
        point = self._scene.operational_point(output.name)
        number, local = self._place(point.link, np.array(point.origin.xyz))
        position = self.system.GetObjectOutputBody(
            self._bodies[number], kinds.Position, local, initial
        )
        return tuple(float(position[k]) for k in output.components)

    def _turned(self, number: int) -> float:
        """Return how far a body has turned since the start, rad."""
        coordinates = self.system.GetNodeOutput(
            self._nodes[number],
            self._exudyn.OutputVariableType.Coordinates,
            self._exudyn.ConfigurationType.Initial,
        )
        return float(coordinates[2])

    def _add_body(self, number: int, joint: Joint, data: pin.Data) -> None:
        inertia, pose = self._tree.pinocchio.inertias[number], data.oMi[number]
        centre = pose.act(inertia.lever)
        speed = pin.getVelocity(
            self._tree.pinocchio, data, number, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        linear = speed.linear + np.cross(speed.angular, centre - pose.translation)
        angle = float(np.arctan2(pose.rotation[1, 0], pose.rotation[0, 0]))
        node = self.system.AddNode(
            self._items.NodeRigidBody2D(
                referenceCoordinates=[centre[0], centre[1], angle],
                initialVelocities=[linear[0], linear[1], speed.angular[2]],
            )
        )
        body = self.system.AddObject(
            self._items.ObjectRigidBody2D(
                mass=inertia.mass, inertia=inertia.inertia[2, 2], nodeNumber=node
            )
        )
        self._nodes.append(node)
        self._bodies.append(body)
        marker = self.system.AddMarker(self._items.MarkerBodyMass(bodyNumber=body))
        load = self._items.LoadMassProportional(
            markerNumber=marker, loadVector=list(self._scene.gravity)
        )
        self.system.AddLoad(load)

    def _add_effort(self, number: int, effort: float) -> None:
        if number == 0:
            return
        marker = self._items.MarkerBodyRigid(
            bodyNumber=self._bodies[number], localPosition=[0.0, 0.0, 0.0]
        )
        load = self._items.LoadTorqueVector(
            markerNumber=self.system.AddMarker(marker), loadVector=[0.0, 0.0, effort]
        )
        self.system.AddLoad(load)

    def _pin(self, first: Any, second: Any) -> None:
        joint = self._items.ObjectJointRevolute2D(markerNumbers=[first, second])
        self.system.AddObject(joint)

    def _frame_marker(self, frame: LinkFrame) -> Any:
        joint, within = self._tree.link_joint[frame.link]
        return self._marker(joint, (within * se3(frame.origin)).translation)

    def _marker(self, number: int, point: Array) -> Any:
        centre = self._tree.pinocchio.inertias[number].lever if number else np.zeros(3)
        marker = self._items.MarkerBodyPosition(
            bodyNumber=self._bodies[number], localPosition=list(point - centre)
        )
        return self.system.AddMarker(marker)

    def _place(self, link: str, point: Array) -> tuple[int, list[float]]:
        joint, within = self._tree.link_joint[link]
        lever = self._tree.pinocchio.inertias[joint].lever
        return joint, [float(x) for x in within.act(point) - lever]


def _takes(scene: Scene) -> bool:
    return scene.task_space == "planar" and all(
        link.joint.type == "revolute"
        and tuple(link.joint.axis) == (0.0, 0.0, 1.0)
        and link.joint.damping == link.joint.stiffness == 0.0
        for link in scene.links
    )
