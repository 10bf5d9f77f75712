# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scene in Drake: a tree of bodies, and loops as constraints or as bushings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from benchmarks.accuracy.cases import Output
from benchmarks.speed.contender import (
    Setting,
    State,
    UnsuitableError,
    joint_place,
    refuse_what_no_peer_has,
)
from hapticmech_ros.mechanism.model import TreeModel, build_tree, se3
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Closure, Joint, LinkFrame, Spring

NAME = "drake"
# The rate at which closures by bushings swing, all together at the start, and how they are damped.
RATE, RATIO = "bushings' rate times step", "damping ratio"
# A revolute closure is two points of its axis on each other: five independent rows out of six.
AXIS_POINTS = (0.0, 0.2)
SIMPLE = ("revolute", "prismatic")
JOINTS = (*SIMPLE, "spherical", "free")
WORLD = 0
# A point of a link: number of the link's body, and where in the body.
Placed = tuple[int, pin.SE3]
Loops = Literal["constraints", "bushings", "none"]


def refuse(scene: Scene, loops: Loops) -> None:
    """Check that Drake can do a scene.

    Args:
        scene: what to convert.
        loops: what holds closures: constraints, in discrete steps only; bushings; or nothing.

    Raises:
        UnsuitableError: friction, stops, planar joints, rotors, springs without length; closures or
            gears that are not held so; no closure to be held by bushings.
    """

    def refused(reason: str) -> UnsuitableError:
        return UnsuitableError(NAME, scene.name, reason)

    refuse_what_no_peer_has(scene, NAME, gears=loops == "constraints")
    for joint in (link.joint for link in scene.links if link.joint.type != "fixed"):
        if joint.type not in JOINTS:
            raise refused(f"a {joint.type} joint")
        if joint.armature:
            raise refused(f"rotor of {joint.name}")
    for spring in scene.springs:
        if not spring.rest_length:
            raise refused(f"spring {spring.name}: it must have a length")
    closures = [closure for closure in scene.closures if closure.active]
    if loops == "none" and closures:
        raise refused("constraints are for discrete steps only")
    if loops == "bushings":
        if not closures:
            raise refused("no loop for bushings: rk5 without")
        for closure in closures:
            if closure.kind in ("weld", "rod"):
                raise refused(f"{closure.kind} {closure.name}: bushings hold points on each other")


class DrakePlant:
    """A scene in Drake; nothing touches, since nothing has a shape.

    Args:
        scene: what to convert, which is not refused.
        start: where bushings are measured.
        step: s.
        bushings: rate and damping of closures in a continuous plant, empty for one without
            closures; None for a discrete plant, which has constraints.

    Attributes:
        plant: ready for a simulator.
        tree: our tree; bodies have the same order, coordinates need not have it.
    """

    def __init__(self, scene: Scene, start: State, step: float, bushings: Setting | None) -> None:
        from pydrake.math import RigidTransform
        from pydrake.multibody import plant, tree

        self._kinds: Any = tree
        self._transform: Any = RigidTransform
        self.tree: TreeModel = build_tree(scene)
        discrete = bushings is None
        self.plant: Any = plant.MultibodyPlant(step if discrete else 0.0)
        if discrete:
            self.plant.set_discrete_contact_approximation(plant.DiscreteContactApproximation.kSap)
            self.plant.SetUseSampledOutputPorts(False)
        self.plant.mutable_gravity_field().set_gravity_vector(np.array(scene.gravity))
        self._bodies: list[Any] = [self.plant.world_body()]
        self._joints: list[Any] = []
        self._ground: Any = None
        for number, joint in enumerate(self.tree.joints, start=1):
            self._joints.append(self._add_joint(number, joint))
        self._points = {
            point.name: self._placed(LinkFrame(link=point.link, origin=point.origin))
            for point in scene.operational_points
        }
        for spring in scene.springs:
            self._add_spring(spring)
        closures = [closure for closure in scene.closures if closure.active]
        if bushings is None:
            for closure in closures:
                self._add_constraint(closure)
            self._add_gears(scene)
        elif closures:
            self._add_bushings(closures, start, bushings[RATE] / step, bushings[RATIO])
        self.plant.Finalize()

    def state(self, start: State) -> Array:
        """Return Drake's positions and velocities.

        It writes quaternions w first and turns of ball joints as roll, pitch and yaw, and moves
        bodies by their velocity in the parent's axes, where ours is in their own.
        """
        q, v = np.zeros(self.plant.num_positions()), np.zeros(self.plant.num_velocities())
        for index, (kind, joint) in enumerate(
            zip(self.tree.joint_types, self._joints, strict=True)
        ):
            ours = start.q[self.tree.position_slice(index)]
            speed = start.v[self.tree.velocity_slice(index)]
            if kind not in SIMPLE:
                turn = ours[-4:][[3, 0, 1, 2]]
                axes = pin.Quaternion(*turn).toRotationMatrix()
                if kind == "free":
                    ours = np.concatenate((turn, ours[:3]))
                    speed = np.concatenate((axes @ speed[3:], axes @ speed[:3]))
                else:
                    ours, speed = pin.rpy.matrixToRpy(axes), axes @ speed
            q[joint.position_start() :][: len(ours)] = ours
            v[joint.velocity_start() :][: len(speed)] = speed
        return np.concatenate((q, v))

    def efforts(self) -> Array:
        """Return (nv,) constant efforts in Drake's order, N m or N."""
        efforts = np.zeros(self.plant.num_velocities())
        for ours, joint in zip(self.tree.joints, self._joints, strict=True):
            efforts[joint.velocity_start() :][: joint.num_velocities()] = ours.effort
        return efforts

    def read(self, context: Any, output: Output) -> tuple[float, ...]:
        """Return what an output is, m or rad."""
        if output.kind == "joint":
            joint_place(self.tree, output.name)
            joint = self.plant.GetJointByName(output.name)
            values = self.plant.GetPositions(context)[joint.position_start() :]
        else:
            number, place = self._points[output.name]
            frame, world = self._bodies[number].body_frame(), self.plant.world_frame()
            values = self.plant.CalcPointsPositions(context, frame, place.translation, world)[:, 0]
        return tuple(float(values[k]) for k in output.components)

    def _placed(self, frame: LinkFrame, along_z: float = 0.0) -> Placed:
        number, within = self.tree.link_joint[frame.link]
        offset = pin.SE3(np.eye(3), np.array([0.0, 0.0, along_z]))
        return number, within * se3(frame.origin) * offset

    def _pairs(self, closure: Closure) -> Iterator[tuple[Placed, Placed]]:
        for along_z in AXIS_POINTS if closure.kind == "revolute" else (0.0,):
            yield self._placed(closure.a, along_z), self._placed(closure.b, along_z)

    def _frame(self, placed: Placed) -> Any:
        number, place = placed
        name, body = f"frame{self.plant.num_frames()}", self._bodies[number].body_frame()
        within = self._transform(place.homogeneous)
        return self.plant.AddFrame(self._kinds.FixedOffsetFrame(name, body, within))

    def _add_joint(self, number: int, joint: Joint) -> Any:
        kinds, model = self._kinds, self.tree.pinocchio
        inertia = model.inertias[number]
        # Moments, then products xy, xz, yz.
        moments = inertia.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        spatial = kinds.SpatialInertia.MakeFromCentralInertia(
            inertia.mass, inertia.lever, kinds.RotationalInertia(*moments)
        )
        body = self.plant.AddRigidBody(self.tree.links[number - 1], spatial)
        self._bodies.append(body)
        parent = self._frame((model.parents[number], model.jointPlacements[number]))
        ends = parent, body.body_frame()
        if joint.type == "spherical":
            return self.plant.AddJoint(kinds.BallRpyJoint(joint.name, *ends, joint.damping))
        if joint.type == "free":
            # Damped alike in turns and shifts.
            free = kinds.QuaternionFloatingJoint(joint.name, *ends, joint.damping, joint.damping)
            return self.plant.AddJoint(free)
        turns = joint.type == "revolute"
        kind = kinds.RevoluteJoint if turns else kinds.PrismaticJoint
        axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
        added = self.plant.AddJoint(kind(joint.name, *ends, axis, damping=joint.damping))
        if joint.stiffness:
            spring = kinds.RevoluteSpring if turns else kinds.PrismaticSpring
            self.plant.AddForceElement(spring(added, joint.rest, joint.stiffness))
        return added

    def _add_spring(self, spring: Spring) -> None:
        (body_a, place_a), (body_b, place_b) = self._placed(spring.a), self._placed(spring.b)
        element = self._kinds.LinearSpringDamper(
            self._bodies[body_a],
            place_a.translation,
            self._bodies[body_b],
            place_b.translation,
            spring.rest_length,
            spring.stiffness,
            spring.damping,
        )
        self.plant.AddForceElement(element)

    def _add_constraint(self, closure: Closure) -> None:
        for (number_a, place_a), (number_b, place_b) in self._pairs(closure):
            bodies = self._constrained(number_a), self._constrained(number_b)
            points = place_a.translation, place_b.translation
            if closure.kind == "rod":
                self.plant.AddDistanceConstraint(
                    bodies[0], points[0], bodies[1], points[1], closure.length
                )
            elif closure.kind == "weld":
                frames = [self._transform(place.homogeneous) for place in (place_a, place_b)]
                self.plant.AddWeldConstraint(bodies[0], frames[0], bodies[1], frames[1])
            else:
                self.plant.AddBallConstraint(bodies[0], points[0], bodies[1], points[1])

    def _constrained(self, number: int) -> Any:
        """Return a body for a constraint. With the world's Drake 1.51 crashes: one welded to it."""
        if number != WORLD:
            return self._bodies[number]
        if self._ground is None:
            self._ground = self.plant.AddRigidBody("ground", self._kinds.SpatialInertia.Zero())
            self.plant.WeldFrames(self.plant.world_frame(), self._ground.body_frame())
        return self._ground

    def _add_gears(self, scene: Scene) -> None:
        for coupling in scene.couplings:
            follower, leader = (
                self.plant.GetJointByName(name) for name in (coupling.joint, coupling.leader)
            )
            self.plant.AddCouplerConstraint(follower, leader, coupling.ratio, coupling.offset)

    def _add_bushings(
        self, closures: list[Closure], start: State, rate: float, ratio: float
    ) -> None:
        """Hold points on each other by springs and dampers.

        Each is as stiff as it feels inertia at the start, and all together so that the fastest of
        their vibrations has ``rate`` (rad/s).
        """
        pairs = [pair for closure in closures for pair in self._pairs(closure)]
        for (end_a, end_b), mass in zip(pairs, self._felt(pairs, start.q), strict=True):
            bushing = self._kinds.LinearBushingRollPitchYaw(
                self._frame(end_a),
                self._frame(end_b),
                np.zeros(3),
                np.zeros(3),
                np.full(3, mass * rate**2),
                np.full(3, 2.0 * ratio * mass * rate),
            )
            self.plant.AddForceElement(bushing)

    def _felt(self, pairs: list[tuple[Placed, Placed]], q: Array) -> Array:
        """Return masses m (pairs,), kg: the largest eigenvalue of diag(m) J D⁻¹ Jᵀ is 1."""
        model: pin.Model = self.tree.pinocchio
        data = model.createData()
        pin.computeJointJacobians(model, data, q)
        upper = np.triu(pin.crba(model, model.createData(), q))
        inertia = upper + np.triu(upper, 1).T
        rows = [self._rows(data, a) - self._rows(data, b) for a, b in pairs]
        alone = np.array([_largest(row, inertia) for row in rows])
        scaled = [row / np.sqrt(own) for row, own in zip(rows, alone, strict=True)]
        return np.asarray(1.0 / (alone * _largest(np.vstack(scaled), inertia)))

    def _rows(self, data: pin.Data, placed: Placed) -> Array:
        """Return (3, nv) the Jacobian of a point, world axes, of joints' Jacobians in ``data``."""
        number, place = placed
        model = self.tree.pinocchio
        if number == WORLD:
            return np.zeros((3, model.nv))
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        joint = pin.getJointJacobian(model, data, number, axes)
        arm = data.oMi[number].rotation @ place.translation
        return np.asarray(joint[:3] - pin.skew(arm) @ joint[3:])


def _largest(rows: Array, inertia: Array) -> float:
    """Return the largest eigenvalue of J D⁻¹ Jᵀ, 1/kg."""
    return float(np.linalg.eigvalsh(rows @ np.linalg.solve(inertia, rows.T))[-1])
