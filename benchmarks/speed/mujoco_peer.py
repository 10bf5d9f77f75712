# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo as a peer: its own loop over steps, closures as stiff as they stay stable."""

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
    initial_state,
    joint_efforts,
    refuse_what_no_peer_has,
)
from hapticmech_ros.mechanism.model import TreeModel, build_tree, se3
from hapticmech_ros.numerics import Array
from hapticmech_ros.robot.mujoco_robot import MujocoTree
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Closure, LinkFrame, Spring

# Time constant of a closure in steps, with or without its exact inverse inertia in place of
# MuJoCo's estimate.
CONSTANT, EXACT = "time constant", "exact inertia"
# A shorter one is unstable under this rule.
IMPLICIT: tuple[Setting, ...] = ({CONSTANT: 2.0, EXACT: 1.0}, {CONSTANT: 2.0, EXACT: 0.0})
DISCRETE: tuple[Setting, ...] = (
    {CONSTANT: 1.0, EXACT: 1.0},
    {CONSTANT: 1.0, EXACT: 0.0},
    {CONSTANT: 2.0, EXACT: 1.0},
)
RUNGE_KUTTA: tuple[Setting, ...] = (
    *({CONSTANT: constant, EXACT: 0.0} for constant in (0.5, 1.0, 2.0, 4.0)),
    *({CONSTANT: constant, EXACT: 1.0} for constant in (0.7, 1.0)),
)
# The stiffest that it takes: MuJoCo clamps at this. Width, midpoint and power have no effect then.
SOLIMP = (0.9999, 0.9999, 1.0, 0.5, 1.0)
TOLERANCE = 1e-12
NAME = "mujoco"
POINT = "point/"


class _Mujoco:
    """MuJoCo by ``mj_step``, many steps in a call."""

    def __init__(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> None:
        import mujoco

        self._mujoco: Any = mujoco
        converted = MujocoScene(scene)
        spec, off = converted.spec, mujoco.mjtDisableBit
        spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{method.name.upper()}")
        spec.option.timestep, spec.option.tolerance = step, TOLERANCE
        for bit in (off.mjDSBL_REFSAFE, off.mjDSBL_ISLAND, off.mjDSBL_AUTORESET):
            spec.option.disableflags |= int(bit)
        if setting.get(EXACT):
            spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
        for equality in spec.equalities:
            equality.solref = (setting[CONSTANT] * step, 1.0)
            equality.solimp = SOLIMP
        # Without this a motion that is lost is told in a log file in the current folder.
        mujoco.set_mju_user_warning(lambda text: None)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._qpos, self._qvel = converted.state(start)
        self._efforts = joint_efforts(converted.tree)
        self.restart()

    def restart(self) -> None:
        """Go back to the initial state."""
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:], self._data.qvel[:] = self._qpos, self._qvel
        self._data.qfrc_applied[:] = self._efforts

    def advance(self, steps: int) -> None:
        """Take so many steps."""
        self._mujoco.mj_step(self._model, self._data, steps)
        if not np.isfinite(self._data.qpos).all() or any(w.number for w in self._data.warning):
            raise FloatingPointError("MuJoCo's motion is lost")

    def read(self, outputs: Sequence[Output]) -> Reading:
        """Return what outputs are now, m or rad."""
        self._mujoco.mj_kinematics(self._model, self._data)
        return [
            output.parts(
                self._data.joint(output.name).qpos
                if output.kind == "joint"
                else self._data.site(POINT + output.name).xpos
            )
            for output in outputs
        ]


# The solver is Newton's, which is exact for equalities in one or two iterations; islands are off,
# because finding them costs more here than it saves. MuJoCo's Euler, left out, is ``implicitfast``
# but for how it takes dampers.
MUJOCO = Peer(
    NAME,
    (
        Method("implicitfast", 1, IMPLICIT),
        Method("discrete", 1, DISCRETE),
        Method("rk4", 4, RUNGE_KUTTA),
    ),
    _Mujoco,
)


def at_start(converted: MujocoScene, scene: Scene) -> tuple[Any, Any]:
    """Return model and data of a scene at its start, for ``mj_step`` by ``implicitfast``.

    Args:
        converted: what is compiled, in steps of the scene's period.
        scene: whose start it is.
    """
    import mujoco

    converted.spec.option.timestep = scene.simulation.period
    converted.spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model = converted.spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = converted.state(initial_state(scene))
    return model, data


def stepping(model: Any, data: Any, steps: int) -> Callable[[], None]:
    """Return what calls ``mj_step`` so often from Python."""
    import mujoco

    def call() -> None:
        for _ in range(steps):
            mujoco.mj_step(model, data)

    return call


class MujocoScene:
    """A scene in MuJoCo.

    Contacts, limits, friction and actuators are off: the scenes have none.

    Args:
        scene: what to convert.

    Attributes:
        spec: the model's description; options and the equalities' ``solref`` may still change.
        tree: our tree, whose joints have the same order.

    Raises:
        UnsuitableError: friction, stops, rods or planar joints.
    """

    def __init__(self, scene: Scene) -> None:
        import mujoco

        refuse_what_no_peer_has(scene, NAME)
        self._mujoco: Any = mujoco
        self._scene = scene
        self.tree: TreeModel = build_tree(scene)
        self.spec = mujoco.MjSpec()
        self.spec.option.gravity = np.array(scene.gravity)
        off = mujoco.mjtDisableBit
        unused = (
            off.mjDSBL_CONTACT,
            off.mjDSBL_LIMIT,
            off.mjDSBL_FRICTIONLOSS,
            off.mjDSBL_ACTUATION,
            off.mjDSBL_SENSOR,
        )
        self.spec.option.disableflags = sum(int(bit) for bit in unused)
        if "planar" in self.tree.joint_types:
            raise UnsuitableError(NAME, scene.name, "a planar joint")
        self._added = MujocoTree(self.tree, self.spec)
        for point in scene.operational_points:
            self._added.add_site(POINT + point.name, point.link, se3(point.origin))
        for closure in scene.closures:
            if closure.active:
                self._add_closure(closure)
        for spring in scene.springs:
            self._add_spring(spring)

    def state(self, start: State) -> tuple[Array, Array]:
        """Return qpos and qvel: MuJoCo writes quaternions w first, and moves bodies by their
        velocity in world axes, where ours is in their own.
        """  # noqa: D205
        q, v = start.q.copy(), start.v.copy()
        for index, kind in enumerate(self.tree.joint_types):
            at, rate = self.tree.position_slice(index), self.tree.velocity_slice(index)
            if kind in ("spherical", "free"):
                turn = start.q[at][-4:]
                q[at.stop - 4 : at.stop] = turn[[3, 0, 1, 2]]
                if kind == "free":
                    axes = pin.Quaternion(*turn[[3, 0, 1, 2]]).toRotationMatrix()
                    v[rate.start : rate.start + 3] = axes @ start.v[rate][:3]
        return q, v

    def _add_closure(self, closure: Closure) -> None:
        kinds, weld = self._mujoco.mjtEq, closure.kind == "weld"
        if closure.kind == "rod":
            raise UnsuitableError(NAME, self._scene.name, f"rod {closure.name}")
        offsets = AXIS_POINTS if closure.kind == "revolute" else (0.0,)
        for number, along_z in enumerate(offsets):
            ends = [
                self._add_frame(f"{closure.name}/{number}{end}", frame, along_z)
                for end, frame in (("a", closure.a), ("b", closure.b))
            ]
            equality = self.spec.add_equality(
                name=f"{closure.name}/{number}",
                type=kinds.mjEQ_WELD if weld else kinds.mjEQ_CONNECT,
                name1=ends[0],
                name2=ends[1],
                objtype=self._mujoco.mjtObj.mjOBJ_SITE,
            )
            if weld:
                equality.data[10] = 1.0

    def _add_frame(self, name: str, frame: LinkFrame, along_z: float) -> str:
        offset = pin.SE3(np.eye(3), np.array([0.0, 0.0, along_z]))
        return self._added.add_site(name, frame.link, se3(frame.origin) * offset)

    def _add_spring(self, spring: Spring) -> None:
        tendon = self.spec.add_tendon(name=spring.name)
        for end, frame in (("a", spring.a), ("b", spring.b)):
            tendon.wrap_site(self._add_frame(f"{spring.name}/{end}", frame, 0.0))
        tendon.stiffness[0], tendon.damping[0] = spring.stiffness, spring.damping
        tendon.springlength = [spring.rest_length] * 2
