# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot in MuJoCo that takes joint torques, with a ball at its tool and a wall to press on.

It tests a controller, which computes with our dynamics, against MuJoCo's dynamics and contacts.
Friction at the wall is μ times MuJoCo's contact force, against the slip, of each step: MuJoCo's own
friction lifts a slipping body off a stiff wall by μ times its speed, since its contacts are a
convex problem, and the tool would bounce with any controller.

A scene's tree becomes a model of MuJoCo: bodies, joints and inertias, one to one.

MuJoCo is no requirement of the package: it is imported when this is called, and is in the extras
``mjcf`` and ``robots``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any

import numpy as np
import pinocchio as pin

from hapticmech_ros.errors import (
    HapticMechError,
    InstallationError,
    InvalidInputError,
    check_one_of,
)
from hapticmech_ros.mechanism.model import TreeModel, build_tree, se3
from hapticmech_ros.numerics import Array
from hapticmech_ros.robot.linear_environment import LinearEnvironment
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Joint

SIMPLE = ("revolute", "prismatic")
# MuJoCo takes no body without rotational inertia; so little (kg m^2) changes no digit of a motion.
LEAST_INERTIA = 1e-13


def mujoco_module(python: str = "python") -> Any:
    """Return MuJoCo's module.

    Args:
        python: that it is to be installed with, for the message.

    Raises:
        InstallationError: it is not installed.
    """
    if find_spec("mujoco") is None:
        raise InstallationError(["mujoco is not installed"], ["mujoco>=4"], python)
    import mujoco

    return mujoco


class MujocoTree:
    """Adds a tree to a description of a model.

    Joints come in our order, and their positions and rates are ours but for quaternions (w first)
    and the linear rates of free joints (world axes).

    Args:
        tree: ours.
        spec: MuJoCo's description, with an empty world.

    Attributes:
        bodies: of the joints that carry them, the world's first, in our order.

    Raises:
        InstallationError: MuJoCo is not installed.
        InvalidInputError: a planar joint, which MuJoCo does not have.
    """

    def __init__(self, tree: TreeModel, spec: Any) -> None:
        self._kinds = mujoco_module().mjtJoint
        self._free = mujoco_module().mjtAlignFree.mjALIGNFREE_FALSE
        self._tree = tree
        self.bodies: list[Any] = [spec.worldbody]
        for number, joint in enumerate(tree.joints, start=1):
            self.bodies.append(self._body(number, joint))

    def add_site(self, name: str, link: str, placement: pin.SE3) -> str:
        """Add a site fixed in a link, and return its name.

        Args:
            name: of the site.
            link: of ours, or ``world``.
            placement: in the link's frame.
        """
        number, within = self._tree.link_joint[link]
        placed = within * placement
        self.bodies[number].add_site(name=name, pos=placed.translation, quat=wxyz(placed.rotation))
        return name

    def _body(self, number: int, joint: Joint) -> Any:
        model = self._tree.pinocchio
        place, inertia = model.jointPlacements[number], model.inertias[number]
        moments = inertia.inertia
        if np.linalg.eigvalsh(moments).min() < LEAST_INERTIA:
            moments = moments + LEAST_INERTIA * np.eye(3)
        body = self.bodies[model.parents[number]].add_body(
            name=self._tree.links[number - 1],
            pos=place.translation,
            quat=wxyz(place.rotation),
            mass=inertia.mass,
            ipos=inertia.lever,
            fullinertia=moments[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
            explicitinertial=True,
        )
        known = {
            "revolute": self._kinds.mjJNT_HINGE,
            "prismatic": self._kinds.mjJNT_SLIDE,
            "spherical": self._kinds.mjJNT_BALL,
            "free": self._kinds.mjJNT_FREE,
        }
        check_one_of("joint for MuJoCo", joint.type, known)
        added = body.add_joint(name=joint.name, type=known[joint.type])
        added.align = self._free
        if joint.type in SIMPLE:
            added.axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
            added.springref = joint.rest
        added.stiffness[0], added.damping[0] = joint.stiffness, joint.damping
        added.armature = joint.armature
        mass, *lever = self._tree.carried[number]
        if mass:
            # MuJoCo carries a share of a body where its mass is.
            if not np.allclose(lever, mass * inertia.lever, atol=1e-12 * inertia.mass):
                rule = "must be the same for links that are fixed to each other, for MuJoCo"
                raise InvalidInputError("gravcomp", joint.name, rule)
            body.gravcomp = mass / inertia.mass
        return body


def wxyz(rotation: Array) -> Array:
    """Return a rotation as MuJoCo's quaternion (4,), w first.

    Args:
        rotation: (3, 3) orthogonal, determinant 1.
    """
    return np.array(pin.Quaternion(rotation).coeffs())[[3, 0, 1, 2]]


# Thickness of a wall, m: more than a tool can go through in a step.
_THICK = 0.1
# m/s below which friction is proportional to the slip.
_CREEP = 0.002
_TOOL, _WALL, _POINT = "tool_ball", "wall", "operational_point"


@dataclass(frozen=True, slots=True)
class Wall:
    """A wall before the tool.

    Attributes:
        position: (3,) m, a point of its surface, world axes.
        normal: (3,) unit vector, out of the wall.
        size: m, of its sides.
        friction: μ.
        time_constant: s, of MuJoCo's contact (``solref``): the shorter, the stiffer.
    """

    position: Array
    normal: Array
    size: float = 1.0
    friction: float = 0.3
    time_constant: float = 0.002


@dataclass(frozen=True, slots=True)
class Unmodelled:
    """The real robot's differences from its controller's model.

    Attributes:
        payload: mass, kg.
        damping: of each joint, N m s/rad or N s/m.
        friction: dry friction of each joint, N m or N.
        beyond: m, from the operational point along its z axis, where the payload is.
    """

    payload: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    beyond: float = 0.0


@dataclass(frozen=True, slots=True)
class Around:
    """Surroundings of a robot.

    Attributes:
        wall: None: no contact.
        tool_radius: m, of the ball at the operational point that touches the wall.
        unmodelled: of the robot.
    """

    wall: Wall | None = None
    tool_radius: float = 0.01
    unmodelled: Unmodelled = field(default_factory=Unmodelled)


class MujocoRobot:
    """A serial robot in MuJoCo.

    Args:
        scene: of the robot.
        point: operational point, at which its tool is; the first one if empty.
        around: its surroundings.
        step: s, of MuJoCo.

    Attributes:
        model, data: MuJoCo's own.
        nv: number of joint rates.

    Raises:
        InstallationError: MuJoCo is not installed.
        InvalidInputError: unknown point, or joints that are not revolute or prismatic.
        HapticMechError: MuJoCo refuses the model.
    """

    def __init__(
        self, scene: Scene, point: str = "", around: Around | None = None, step: float = 2.5e-4
    ) -> None:
        self._mujoco = mujoco = mujoco_module()
        around = around or Around()
        tree, held = build_tree(scene), scene.operational_point(point)
        if set(tree.joint_types) - set(SIMPLE) or scene.closures:
            raise InvalidInputError("robot", scene.name, "must be a tree of simple joints")
        spec = mujoco.MjSpec()
        spec.option.gravity = np.array(scene.gravity)
        spec.option.timestep = step
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        added = MujocoTree(tree, spec)
        added.add_site(_POINT, held.link, se3(held.origin))
        number, within = tree.link_joint[held.link]
        place = (within * se3(held.origin)).translation
        extra = around.unmodelled
        if extra.payload:
            away = (within * se3(held.origin)).act(np.array([0.0, 0.0, extra.beyond]))
            carried = added.bodies[number].add_body(name="payload", pos=away)
            carried.mass, carried.explicitinertial = extra.payload, True
            # Without it MuJoCo takes the body's own place, once more.
            carried.ipos = np.zeros(3)
            # Of a ball of steel of that mass, next to nothing.
            carried.inertia = np.full(3, 1e-4 * extra.payload)
        for body in added.bodies[1:]:
            for joint in body.joints:
                joint.damping[0] += extra.damping
                joint.frictionloss = extra.friction
        if around.wall is not None:
            body, radius = added.bodies[number], around.tool_radius
            _add_contact(mujoco, spec, body, place, radius, around.wall)
        mujoco.set_mju_user_warning(lambda text: None)
        try:
            self.model: Any = spec.compile()
        except ValueError as error:
            raise HapticMechError(f"MuJoCo refuses {scene.name}: {error}") from None
        self.data: Any = mujoco.MjData(self.model)
        self.nv = int(self.model.nv)
        self._site = self.model.site(_POINT).id
        self._tool = self.model.geom(_TOOL).id if around.wall is not None else -1
        self._body = int(self.model.site_bodyid[self._site])
        self._mu = 0.0 if around.wall is None else around.wall.friction

    @property
    def q(self) -> Array:
        """(nv,) joint positions, rad or m."""
        return np.array(self.data.qpos)

    @property
    def v(self) -> Array:
        """(nv,) joint rates, rad/s or m/s."""
        return np.array(self.data.qvel)

    @property
    def pose(self) -> pin.SE3:
        """Pose of the operational point."""
        rotation = np.array(self.data.site_xmat[self._site]).reshape(3, 3)
        return pin.SE3(rotation, np.array(self.data.site_xpos[self._site]))

    def put(self, q: Array, v: Array) -> None:
        """Put the robot into a state, without contact forces of the past.

        Args:
            q: (nv,) joint positions, rad or m.
            v: (nv,) joint rates, rad/s or m/s.
        """
        self._mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = q, v
        self._mujoco.mj_forward(self.model, self.data)

    def advance(
        self, torque: Array, steps: int, environment: LinearEnvironment | None = None
    ) -> None:
        """Move for some steps under constant torques.

        Args:
            torque: (nv,) N m or N.
            steps: number of MuJoCo's steps.
            environment: that the operational point is fixed to; None: none.

        Raises:
            HapticMechError: the motion is lost: not finite, or reset by MuJoCo.
        """
        for _ in range(steps):
            self.data.qfrc_applied[:] = torque
            if self.data.ncon:
                self.data.qfrc_applied += self._friction_torque()
            if environment is not None:
                self.data.qfrc_applied += self._environment_torque(environment)
            self._mujoco.mj_step(self.model, self.data)
        # Positions, contacts and forces of the state reached, not of the one before.
        self._mujoco.mj_forward(self.model, self.data)
        if not np.isfinite(self.data.qpos).all() or self.data.warning.number.any():
            raise HapticMechError("MuJoCo's motion of the robot is lost")

    def contact_wrench(self) -> Array:
        """Return F_c (6,), by the wall on the robot, N and N m, world axes at the point."""
        total, origin = np.zeros(6), np.array(self.data.site_xpos[self._site])
        for place, force in self._forces():
            whole = force + self._friction(place, force)
            total[:3] += whole
            total[3:] += np.cross(place - origin, whole)
        return total

    def _forces(self) -> list[tuple[Array, Array]]:
        """Return where the wall pushes, m, and with which force without friction, N; (3,) each."""
        found, forces = np.zeros(6), []
        for index in range(self.data.ncon):
            contact = self.data.contact[index]
            if self._tool not in (contact.geom1, contact.geom2):
                continue
            self._mujoco.mj_contactForce(self.model, self.data, index, found)
            # On geom 2 by geom 1, along the contact's axes, which are rows.
            sign = -1.0 if contact.geom1 == self._tool else 1.0
            normal = sign * np.array(contact.frame[:3])
            forces.append((np.array(contact.pos), found[0] * normal))
        return forces

    def _friction(self, place: Array, force: Array) -> Array:
        """Return the friction (3,) that goes with a force (3,) at a place (3,), N."""
        pushed = float(np.linalg.norm(force))
        if pushed == 0.0 or self._mu == 0.0:
            return np.zeros(3)
        jacobian = np.zeros((3, self.nv))
        self._mujoco.mj_jac(self.model, self.data, jacobian, None, place, self._body)
        speed = jacobian @ self.data.qvel
        normal = force / pushed
        slip = speed - (normal @ speed) * normal
        return np.asarray(-self._mu * pushed * slip / max(float(np.linalg.norm(slip)), _CREEP))

    def _environment_torque(self, environment: LinearEnvironment) -> Array:
        """Return torques (nv,) of an environment, which moves on by a step."""
        mujoco, model, data = self._mujoco, self.model, self.data
        # Of the state that the last step has reached.
        mujoco.mj_fwdPosition(model, data)
        jacobian, total = np.zeros((3, self.nv)), np.zeros(self.nv)
        mujoco.mj_jacSite(model, data, jacobian, None, self._site)
        place = np.array(data.site_xpos[self._site])
        force = environment.advance(place, jacobian @ data.qvel, float(model.opt.timestep))
        mujoco.mj_applyFT(model, data, force, np.zeros(3), place, self._body, total)
        return total

    def _friction_torque(self) -> Array:
        """Return torques (nv,) of all friction at the wall."""
        total = np.zeros(self.nv)
        for place, force in self._forces():
            friction = self._friction(place, force)
            self._mujoco.mj_applyFT(
                self.model, self.data, friction, np.zeros(3), place, self._body, total
            )
        return total

    def terms(self) -> tuple[Array, Array, Array]:
        """Return MuJoCo's own D (nv, nv), h (nv,) and J (6, nv) at its state, for comparison."""
        inertia = np.zeros((self.nv, self.nv))
        self._mujoco.mj_fullM(self.model, self.data, inertia)
        jacobian = np.zeros((6, self.nv))
        self._mujoco.mj_jacSite(self.model, self.data, jacobian[:3], jacobian[3:], self._site)
        return inertia, np.array(self.data.qfrc_bias), jacobian


def _add_contact(
    mujoco: Any, spec: Any, body: Any, place: Array, tool_radius: float, wall: Wall
) -> None:
    """Add the tool's ball and the wall."""
    normal = np.asarray(wall.normal, dtype=float)
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), normal).toRotationMatrix()
    given = {"solref": np.array([wall.time_constant, 1.0]), "condim": 1}
    kinds = mujoco.mjtGeom
    radius = np.array([tool_radius, 0.0, 0.0])
    ball = {"name": _TOOL, "type": kinds.mjGEOM_SPHERE, "size": radius, "pos": place}
    body.add_geom(**ball, **given, mass=0.0)
    half = 0.5 * np.array([wall.size, wall.size, _THICK])
    centre = np.asarray(wall.position) - 0.5 * _THICK * normal
    spec.worldbody.add_geom(
        name=_WALL, type=kinds.mjGEOM_BOX, size=half, pos=centre, quat=wxyz(turn), **given
    )
