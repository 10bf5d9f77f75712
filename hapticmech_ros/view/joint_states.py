# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Positions and rates of the joints that the URDF text has, as robot_state_publisher wants them.

A URDF joint has one number. A spherical joint is three hinges there, about x, y and z in turn. What
URDF calls planar or floating has no single number and is left out: its frame comes by tf alone.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism import Mechanism

HINGES = ("x", "y", "z")
# Closer to a right angle than this (cosine) the first and third hinge are one: the third is put 0.
_ALIGNED = 1e-9


class JointStates:
    """Names, positions and rates of one mechanism's URDF joints.

    Attributes:
        names: of the joints.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._parts: list[tuple[str, slice, slice]] = []
        names: list[str] = []
        tree = mechanism.tree
        for index, (joint, kind) in enumerate(zip(tree.joint_names, tree.joint_types, strict=True)):
            if kind in ("revolute", "prismatic"):
                names.append(joint)
            elif kind == "spherical":
                names += [hinge_name(joint, axis) for axis in HINGES]
            else:
                continue
            self._parts.append((kind, tree.position_slice(index), tree.velocity_slice(index)))
        self.names = tuple(names)

    def at(self, q: Array) -> Array:
        """Return the positions, rad or m, at q (nq,); passive joints included.

        Args:
            q: (nq,) configuration.
        """
        found: list[float] = []
        for kind, part, _ in self._parts:
            if kind == "spherical":
                found += hinge_angles(pin.Quaternion(q[part]).matrix())
            else:
                found.append(float(q[part.start]))
        return np.array(found)

    def rates(self, q: Array, v: Array) -> Array:
        """Return the rates of the positions, rad/s or m/s, at q (nq,) and v (nv,).

        Args:
            q: (nq,) configuration.
            v: (nv,) rates, rad/s or m/s.
        """
        found: list[float] = []
        for kind, part, moving in self._parts:
            if kind == "spherical":
                found += hinge_rates(pin.Quaternion(q[part]).matrix(), v[moving])
            else:
                found.append(float(v[moving.start]))
        return np.array(found)


def hinge_name(joint: str, axis: str) -> str:
    """Return the name of one of the three hinges that stand for a spherical joint."""
    return f"{joint}_{axis}"


def hinge_angles(rotation: Array) -> tuple[float, float, float]:
    """Return a, b, c (rad) with ``rotation`` (3, 3) = R_x(a) R_y(b) R_z(c), -π/2 <= b <= π/2.

    Args:
        rotation: (3, 3) of a spherical joint; axes of the carried link to those before the joint.
    """
    level = float(np.hypot(rotation[0, 0], rotation[0, 1]))
    b = float(np.arctan2(rotation[0, 2], level))
    if level < _ALIGNED:
        return float(np.arctan2(rotation[2, 1], rotation[1, 1])), b, 0.0
    a = float(np.arctan2(-rotation[1, 2], rotation[2, 2]))
    return a, b, float(np.arctan2(-rotation[0, 1], rotation[0, 0]))


def hinge_rates(rotation: Array, angular: Array) -> tuple[float, float, float]:
    """Return da/dt, db/dt, dc/dt (rad/s) of :func:`hinge_angles`.

    Where first and third hinge are in line, as far as the hinges can follow.

    Args:
        rotation: (3, 3) of a spherical joint; axes of the carried link to those before the joint.
        angular: (3,) angular velocity of the carried link relative to the one before, its axes.
    """
    _, b, c = hinge_angles(rotation)
    across = np.array((np.cos(c), -np.sin(c), 0.0)) @ angular
    along = np.array((np.sin(c), np.cos(c), 0.0)) @ angular
    level = float(np.hypot(rotation[0, 0], rotation[0, 1]))
    if level < _ALIGNED:
        return float(angular[2] / np.sin(b)), float(along), 0.0
    first = float(across) / np.cos(b)
    return first, float(along), float(angular[2]) - first * np.sin(b)
