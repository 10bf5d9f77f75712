# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics and closure residuals of scene documents in plain NumPy, one link at a time.

Nothing here comes from Pinocchio or from the package: a scene is read as dictionaries, and every
pose is a pair (R, p) of rotation and position in the world.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

Array = np.ndarray
Pose = tuple[Array, Array]
Document = dict[str, Any]

POSITION_SIZE = {
    "revolute": 1,
    "prismatic": 1,
    "fixed": 0,
    "spherical": 4,
    "free": 7,
    "planar": 4,
}


def skew(a: Array) -> Array:
    """Return [a]x with [a]x b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def turn(axis: Sequence[float], angle: float) -> Array:
    """Return Rodrigues' rotation about a unit axis."""
    k = skew(np.asarray(axis, dtype=float))
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def rotation_of_rpy(rpy: Sequence[float]) -> Array:
    """Return the rotation of URDF's fixed-axis roll, pitch, yaw."""
    roll, pitch, yaw = rpy
    return turn((0, 0, 1), yaw) @ turn((0, 1, 0), pitch) @ turn((1, 0, 0), roll)


def rpy_of_rotation(r: Array) -> list[float]:
    """Return fixed-axis roll, pitch, yaw of a rotation; roll is 0 where only yaw - roll counts."""
    if np.hypot(r[0, 0], r[1, 0]) < 1e-9:
        return [0.0, float(np.arctan2(-r[2, 0], 0.0)), float(np.arctan2(-r[0, 1], r[1, 1]))]
    angles = (
        np.arctan2(r[2, 1], r[2, 2]),
        np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0])),
        np.arctan2(r[1, 0], r[0, 0]),
    )
    return [float(angle) for angle in angles]


def rotation_of_quaternion(x: float, y: float, z: float, w: float) -> Array:
    """Return the rotation of a unit quaternion."""
    k = skew(np.array([x, y, z]))
    return np.eye(3) + 2.0 * w * k + 2.0 * (k @ k)


def place(pose: Pose, origin: Document | None) -> Pose:
    """Return the pose of a frame given by ``origin`` in the frame at ``pose``."""
    origin = origin or {}
    r, p = pose
    return (
        r @ rotation_of_rpy(origin.get("rpy", (0, 0, 0))),
        p + r @ np.asarray(origin.get("xyz", (0, 0, 0)), dtype=float),
    )


def origin_in(pose: Pose, frame: Pose) -> Document:
    """Return the ``origin`` that puts a frame fixed in the body at ``pose`` to ``frame``."""
    r, p = pose
    xyz = r.T @ (frame[1] - p)
    return {"xyz": [float(c) for c in xyz], "rpy": rpy_of_rotation(r.T @ frame[0])}


def _moved(joint: Document, pose: Pose, q: Array) -> Pose:
    r, p = pose
    if joint["type"] == "revolute":
        return r @ turn(joint.get("axis", (0, 0, 1)), q[0]), p
    if joint["type"] == "prismatic":
        return r, p + r @ (q[0] * np.asarray(joint.get("axis", (0, 0, 1)), dtype=float))
    if joint["type"] == "spherical":
        return r @ rotation_of_quaternion(*q), p
    if joint["type"] == "free":
        return r @ rotation_of_quaternion(*q[3:]), p + r @ q[:3]
    if joint["type"] == "planar":
        about_z = np.array([[q[2], -q[3], 0.0], [q[3], q[2], 0.0], [0.0, 0.0, 1.0]])
        return r @ about_z, p + r @ np.array([q[0], q[1], 0.0])
    return r, p


def link_poses(document: Document, q: Array) -> dict[str, Pose]:
    """Return the pose of every link frame, and of ``world``."""
    poses: dict[str, Pose] = {"world": (np.eye(3), np.zeros(3))}
    start = 0
    for link in document["links"]:
        joint = link["joint"]
        size = POSITION_SIZE[joint["type"]]
        base = place(poses[link.get("parent", "world")], joint.get("origin"))
        poses[link["name"]] = _moved(joint, base, q[start : start + size])
        start += size
    return poses


def frame_pose(poses: dict[str, Pose], frame: Document) -> Pose:
    """Return the pose of ``{link, origin}``."""
    return place(poses[frame["link"]], frame.get("origin"))


def point_pose(document: Document, q: Array, index: int = 0) -> Pose:
    """Return the pose of an operational point."""
    return frame_pose(link_poses(document, q), document["operational_points"][index])


def residual_of(closure: Document, a: Pose, b: Pose) -> Array:
    """Return phi of one closure: origins apart, then the axes' part of its kind."""
    gap, kind = a[1] - b[1], closure["kind"]
    if kind == "rod":
        return np.array([(gap @ gap - closure["length"] ** 2) / (2.0 * closure["length"])])
    if kind == "planar_pin":
        return gap[:2]
    if kind == "spherical":
        return gap
    if kind == "revolute":
        tilt = [b[0][:, k] @ a[0][:, 2] for k in (0, 1)]
        return np.concatenate((gap, tilt))
    apart = 0.5 * sum(np.cross(b[0][:, k], a[0][:, k]) for k in range(3))
    return np.concatenate((gap, apart))


def closure_residual(document: Document, q: Array) -> Array:
    """Return phi of all closures of the scene, stacked in its order."""
    poses = link_poses(document, q)
    parts = [
        residual_of(c, frame_pose(poses, c["a"]), frame_pose(poses, c["b"]))
        for c in document.get("closures", [])
    ]
    return np.concatenate(parts) if parts else np.zeros(0)
