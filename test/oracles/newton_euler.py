# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""D and h of a scene by virtual power and finite differences of its forward kinematics.

    D = sum J_c^T m J_c + J_w^T I J_w + a J_r^T J_r
    h = sum J_c^T m (c'' - g) + J_w^T (I w' + w x I w)

with J_r of a joint's own motion, a the inertia of its rotor, and c'' and w' the accelerations along
q(t) = q (+) t v, where the joint rates stay v.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from oracles.differences import columns, derivative, second_derivative
from oracles.kinematics import Array, Document, link_poses

Retract = Callable[[Array, Array], Array]


def moments(link: Document) -> Array:
    """Return the 3 x 3 inertia of a link about its centre of mass, in its own axes."""
    i = link["inertial"]["inertia"]
    xy, xz, yz = i.get("ixy", 0.0), i.get("ixz", 0.0), i.get("iyz", 0.0)
    return np.array([[i["ixx"], xy, xz], [xy, i["iyy"], yz], [xz, yz, i["izz"]]])


def vee(r: Array) -> Array:
    """Return the vector of the skew part of a matrix."""
    return 0.5 * np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])


def rotation_rate(r: Callable[[float], Array]) -> Array:
    """Return the angular velocity at 0 of the rotation r(t), world axes."""
    here = r(0.0)
    return vee(derivative(r) @ here.T)


def jacobian_of(pose: Callable[[Array], tuple[Array, Array]], nv: int) -> Array:
    """Return (6, nv) at no change: linear and angular rates of a pose (R, p) of a change."""
    spins = [rotation_rate(lambda t, u=unit: pose(t * u)[0]) for unit in np.eye(nv)]
    return np.vstack((columns(lambda change: pose(change)[1], nv), np.stack(spins, axis=1)))


def rotor(document: Document, link: Document, retract: Retract, q: Array, nv: int) -> Array:
    """Return what a joint's rotor adds to D: a J^T J, J of the link's motion in its parent.

    A rotor that turns many times as fast as its joint is taken to feel nothing else.
    """
    joint = link["joint"]
    if not joint.get("armature"):
        return np.zeros((nv, nv))

    def apart(change: Array) -> tuple[Array, Array]:
        poses = link_poses(document, retract(q, change))
        (r, p), (child, at) = poses[link["parent"]], poses[link["name"]]
        return r.T @ child, r.T @ (at - p)

    moving, turning = np.split(jacobian_of(apart, nv), 2)
    jacobian = moving if joint["type"] == "prismatic" else turning
    return joint["armature"] * jacobian.T @ jacobian


def dynamics(document: Document, retract: Retract, q: Array, v: Array) -> tuple[Array, Array]:
    """Return D (nv, nv) and h (nv,)."""
    nv = v.size
    inertia, bias = np.zeros((nv, nv)), np.zeros(nv)
    gravity = np.asarray(document.get("gravity", (0, 0, 0)), dtype=float)
    for link in document["links"]:
        mass = link["inertial"]["mass"]
        com = np.asarray(link["inertial"].get("com", (0, 0, 0)), dtype=float)

        def pose(change: Array, name: str = link["name"]) -> tuple[Array, Array]:
            return link_poses(document, retract(q, change))[name]

        def centre(change: Array, pose=pose, com: Array = com) -> Array:
            r, p = pose(change)
            return p + r @ com

        here = pose(np.zeros(nv))[0]
        jacobian = columns(centre, nv)
        spins = [rotation_rate(lambda t, u=unit, pose=pose: pose(t * u)[0]) for unit in np.eye(nv)]
        spin = np.stack(spins, axis=1)
        body = here @ moments(link) @ here.T
        inertia += mass * jacobian.T @ jacobian + spin.T @ body @ spin
        accel = second_derivative(lambda t, centre=centre: centre(t * v))
        rate = spin @ v
        # R'' = ([w'] + [w][w]) R: the skew part of R'' R^T is w'.
        turning = vee(second_derivative(lambda t, pose=pose: pose(t * v)[0]) @ here.T)
        bias += mass * jacobian.T @ (accel - gravity)
        bias += spin.T @ (body @ turning + np.cross(rate, body @ rate))
        inertia += rotor(document, link, retract, q, nv)
    return inertia, bias
