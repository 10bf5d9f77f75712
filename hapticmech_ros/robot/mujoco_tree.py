# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A scene's tree in a model of MuJoCo: bodies, joints and inertias, one to one.

MuJoCo is no requirement of the package: it is imported when this is called, and is in the extras
``mjcf`` and ``robots``.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InstallationError, InvalidInputError
from hapticmech_ros.mechanism.model import TreeModel
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
        if joint.type not in known:
            raise InvalidInputError("joint", joint.type, f"must be one of {list(known)} for MuJoCo")
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
