# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pinocchio as a peer: its dynamics under the classical Runge-Kutta rule, in a lean loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.accuracy.cases import Output
from benchmarks.speed.contender import (
    AXIS_POINTS,
    Method,
    Peer,
    Reading,
    Setting,
    State,
    UnsuitableError,
    joint_efforts,
    refuse_what_no_peer_has,
)
from hapticmech_ros.mechanism.model import TreeModel, build_tree, se3
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Closure, LinkFrame

# The closures' pull a: so much per second, or per step. A fixed one keeps the order of the rule;
# where singular positions are passed only a strong one holds.
RATE, GAIN = "pull times s", "pull times step"
SETTINGS: tuple[Setting, ...] = (
    {RATE: 5.0},
    {RATE: 20.0},
    {GAIN: 0.02},
    {GAIN: 0.1},
    {GAIN: 0.3},
)
# Of the proximal solver: with a smaller μ redundant closures lose digits.
SOFTNESS, ACCURACY, ITERATIONS = 1e-8, 1e-11, 5
# Articulated bodies lose digits with this already; with a larger one they take more iterations.
MU = "proximal μ"
ARTICULATED_SETTINGS: tuple[Setting, ...] = tuple(
    {**setting, MU: mu} for mu in (1e-6, 1e-4) for setting in SETTINGS
)
ARTICULATED_ITERATIONS = 20
# What computes v̇ with closures: a factorisation of the Delassus matrix, or articulated bodies.
DELASSUS, ARTICULATED = "constraintDynamics", "lcaba"
# What computes v̇ without closures is aba in both.
LOOPS = "rk4 lcaba"
NAME = "pinocchio"
WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class _Pinocchio:
    """Pinocchio by ``constraintDynamics``, ``lcaba`` or ``aba``, in C++; the rule is Python."""

    def __init__(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> None:
        algorithm = ARTICULATED if method.name == LOOPS else DELASSUS
        if algorithm == ARTICULATED and not any(closure.active for closure in scene.closures):
            raise UnsuitableError(NAME, scene.name, f"no loop for {ARTICULATED}: as rk4")
        pull = setting.get(RATE, 0.0) + setting.get(GAIN, 0.0) / step
        iterations = ITERATIONS if algorithm == DELASSUS else ARTICULATED_ITERATIONS
        self._dynamics = PinocchioDynamics(
            scene, pull, setting.get(MU, SOFTNESS), ACCURACY, iterations, algorithm
        )
        self._start, self._step = start, step
        model = self._dynamics.model
        # Only then are coordinates numbers that add up.
        self._advance = self._in_numbers if model.nq == model.nv else self._on_manifold
        if "planar" in self._dynamics.tree.joint_types:
            raise UnsuitableError(NAME, scene.name, "a planar joint")
        self.restart()

    def restart(self) -> None:
        """Go back to the initial state."""
        self._q, self._v = self._start.q.copy(), self._start.v.copy()

    def advance(self, steps: int) -> None:
        """Take so many steps."""
        with np.errstate(over="ignore", invalid="ignore"):
            self._advance(steps)
        if not np.isfinite(self._q).all():
            raise FloatingPointError("Pinocchio's motion is lost")

    def read(self, outputs: Sequence[Output]) -> Reading:
        """Return what outputs are now, m or rad."""
        return self._dynamics.read(self._q, outputs)

    def _in_numbers(self, steps: int) -> None:
        """Step q and v as numbers; copies only where a result would be overwritten."""
        rate, step, half, sixth = (
            self._dynamics.acceleration,
            self._step,
            0.5 * self._step,
            self._step / 6.0,
        )
        q, v = self._q, self._v
        for _ in range(steps):
            first = rate(q, v).copy()
            v2 = v + half * first
            second = rate(q + half * v, v2).copy()
            v3 = v + half * second
            third = rate(q + half * v2, v3).copy()
            v4 = v + step * third
            fourth = rate(q + step * v3, v4)
            q = q + sixth * (v + 2.0 * (v2 + v3) + v4)
            v = v + sixth * (first + 2.0 * (second + third) + fourth)
        self._q, self._v = q, v

    def _on_manifold(self, steps: int) -> None:
        """Step on the configuration manifold: stages in coordinates θ around the step's start."""
        rate, tree, step = self._dynamics.acceleration, self._dynamics.tree, self._step
        half, sixth = 0.5 * step, step / 6.0
        move, model = pin.integrate, self._dynamics.model
        q, v = self._q, self._v
        for _ in range(steps):
            first = rate(q, v).copy()
            theta, v2 = half * v, v + half * first
            second = rate(move(model, q, theta), v2).copy()
            turn2, v3 = local_rates(tree, theta, v2), v + half * second
            theta = half * turn2
            third = rate(move(model, q, theta), v3).copy()
            turn3, v4 = local_rates(tree, theta, v3), v + step * third
            theta = step * turn3
            fourth = rate(move(model, q, theta), v4)
            q = move(model, q, sixth * (v + 2.0 * (turn2 + turn3) + local_rates(tree, theta, v4)))
            v = v + sixth * (first + 2.0 * (second + third) + fourth)
        self._q, self._v = q, v


PINOCCHIO = Peer(
    NAME, (Method("rk4", 4, SETTINGS), Method(LOOPS, 4, ARTICULATED_SETTINGS)), _Pinocchio
)


def local_rates(tree: TreeModel, theta: Array, speed: Array) -> Array:
    """Return θ̇ (nv,) at θ for rates ``speed``: turns in space need the exponential's slope."""
    rates = speed.copy()
    for index, kind in enumerate(tree.joint_types):
        if kind == "free":
            at = tree.velocity_slice(index)
            rates[at] = pin.Jlog6(pin.exp6(theta[at])) @ speed[at]
        elif kind == "spherical":
            at = tree.velocity_slice(index)
            rates[at] = pin.Jlog3(pin.exp3(theta[at])) @ speed[at]
    return rates


class PinocchioDynamics:
    """v̇ at (q, v): ``constraintDynamics`` or ``lcaba``; ``aba`` for a scene without closures.

    Args:
        scene: what to convert; springs, dampers and efforts become joint forces.
        pull: a of v̇-level closures φ̈ + 2a φ̇ + a² φ = 0, 1/s.
        softness: of the proximal solver, its μ.
        accuracy: of the proximal solver.
        iterations: of the proximal solver, at most.
        algorithm: :data:`DELASSUS` or :data:`ARTICULATED`.

    Attributes:
        tree: our tree, whose model Pinocchio computes with.

    Raises:
        UnsuitableError: friction, stops or rods.
    """

    def __init__(
        self,
        scene: Scene,
        pull: float,
        softness: float,
        accuracy: float,
        iterations: int,
        algorithm: str = DELASSUS,
    ) -> None:
        refuse_what_no_peer_has(scene, NAME)
        self.tree: TreeModel = build_tree(scene)
        self.model: pin.Model = self.tree.pinocchio
        self._points = {
            point.name: self.tree.add_frame(f"point/{point.name}", point.link, point.origin)
            for point in scene.operational_points
        }
        self._springs = [
            (
                self.tree.add_frame(f"{spring.name}/a", spring.a.link, spring.a.origin),
                self.tree.add_frame(f"{spring.name}/b", spring.b.link, spring.b.origin),
                spring,
            )
            for spring in scene.springs
        ]
        self._constraints = pin.StdVec_RigidConstraintModel()
        self._constraint_data = pin.StdVec_RigidConstraintData()
        for closure in scene.closures:
            if closure.active:
                self._add(scene.name, closure, pull)
        self._data = self.model.createData()
        settings = pin.ProximalSettings(accuracy, softness, iterations)
        self._solve: Callable[..., Array] = pin.aba
        # What it takes besides q, v and the force.
        self._loops: tuple[Any, ...] = ()
        if len(self._constraints):
            self._loops = self._constraints, self._constraint_data, settings
            loops = self.model, self._data, self._constraints
            if algorithm == ARTICULATED:
                self._solve = pin.lcaba
                pin.computeJointMinimalOrdering(*loops)
            else:
                self._solve = pin.constraintDynamics
                pin.initConstraintDynamics(*loops, self._constraint_data)
        self._effort = joint_efforts(self.tree)
        self._stiffness, self._rest = self._joint_springs()
        damping = self.tree.damping
        self._damping = damping if damping.any() else None
        self._passive = self._damping is not None or self._springs or self._stiffness is not None

    def acceleration(self, q: Array, v: Array) -> Array:
        """Return (nv,) v̇, valid until the next call."""
        force = self._force(q, v) if self._passive else self._effort
        return self._solve(self.model, self._data, q, v, force, *self._loops)

    def read(self, q: Array, outputs: Sequence[Output]) -> Reading:
        """Return what outputs are at q, m or rad."""
        pin.framesForwardKinematics(self.model, self._data, q)
        tree = self.tree
        return [
            output.parts(
                q[tree.position_slice(tree.joint_names.index(output.name))]
                if output.kind == "joint"
                else self._data.oMf[self._points[output.name]].translation
            )
            for output in outputs
        ]

    def _force(self, q: Array, v: Array) -> Array:
        force = self._effort.copy()
        if self._damping is not None:
            force -= self._damping * v
        if self._stiffness is not None:
            at, rate, stiffness = self._stiffness
            force[rate] -= stiffness * (q[at] - self._rest)
        if self._springs:
            self._add_springs(q, v, force)
        return force

    def _add_springs(self, q: Array, v: Array, force: Array) -> None:
        model, data = self.model, self._data
        for frame_a, frame_b, spring in self._springs:
            # Each call places the frame as well.
            rows = pin.computeFrameJacobian(model, data, q, frame_a, WORLD_AXES)[:3]
            rows = rows - pin.computeFrameJacobian(model, data, q, frame_b, WORLD_AXES)[:3]
            place_b = pin.updateFramePlacement(model, data, frame_b).translation
            gap = pin.updateFramePlacement(model, data, frame_a).translation - place_b
            length = float(np.sqrt(gap @ gap))
            along = (gap / length) @ rows
            pull = spring.stiffness * (length - spring.rest_length)
            force -= (pull + spring.damping * float(along @ v)) * along

    def _joint_springs(self) -> tuple[tuple[Array, Array, Array] | None, Array]:
        """Return of joints with springs places, rates' places and stiffness; and rest positions."""
        tree = self.tree
        sprung = [
            (
                tree.position_slice(k).start,
                tree.velocity_slice(k).start,
                joint.stiffness,
                joint.rest,
            )
            for k, joint in enumerate(tree.joints)
            if joint.stiffness
        ]
        places, rates, stiffness, rest = np.array(sprung).reshape(-1, 4).T
        return (places.astype(int), rates.astype(int), stiffness) if sprung else None, rest

    def _add(self, scene: str, closure: Closure, pull: float) -> None:
        if closure.kind == "rod":
            raise UnsuitableError(NAME, scene, f"rod {closure.name}")
        weld = closure.kind == "weld"
        kind = pin.ContactType.CONTACT_6D if weld else pin.ContactType.CONTACT_3D
        for along_z in AXIS_POINTS if closure.kind == "revolute" else (0.0,):
            constraint = pin.RigidConstraintModel(
                kind,
                self.model,
                *self._placed(closure.a, along_z),
                *self._placed(closure.b, along_z),
                pin.ReferenceFrame.LOCAL,
            )
            constraint.setBaumgarteCorrectorParameters(
                pin.BaumgarteCorrectorParameters(pull * pull, 2.0 * pull)
            )
            self._constraints.append(constraint)
            self._constraint_data.append(constraint.createData())

    def _placed(self, frame: LinkFrame, along_z: float) -> tuple[int, pin.SE3]:
        joint, link = self.tree.link_joint[frame.link]
        offset = pin.SE3(np.eye(3), np.array([0.0, 0.0, along_z]))
        return joint, link * se3(frame.origin) * offset
