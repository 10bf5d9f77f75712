"""Kernel of what moves: operational points and the closures' Ẇv.

Everything follows from joint Jacobians in the world's axes at the world's origin: the twist of a
body is its parent's and its joint's, and so is the derivative of it.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.mechanism.closure_kernels import bias_of
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.small_matrices import cross


@inner
def _add_cross(a: Array, b: Array, out: Array) -> None:
    """Add a × b to ``out``, which must be neither of them."""
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@inner
def _follow(
    joint: Array, joint_jacobian: Array, v: Array, parent: Array, relative: Array, moved: Array
) -> None:
    """Fill a joint's motion at the world's origin: twist, then its derivative at v̇ = 0.

    ``relative`` (2, 3) is scratch: the joint's own twist.
    """
    relative[:] = 0.0
    for c in range(joint[1], joint[1] + joint[2]):
        for i in range(3):
            relative[0, i] += joint_jacobian[c, i] * v[c]
            relative[1, i] += joint_jacobian[c, 3 + i] * v[c]
    for i in range(3):
        moved[0, i] = parent[0, i] + relative[0, i]
        moved[1, i] = parent[1, i] + relative[1, i]
        moved[2, i] = parent[2, i]
        moved[3, i] = parent[3, i]
    # Joint axes are fixed in the body that the joint moves, so their rate is twist × axis.
    _add_cross(moved[1], relative[0], moved[2])
    _add_cross(moved[0], relative[1], moved[2])
    _add_cross(moved[1], relative[1], moved[3])


@inner
def _at_point(origin: Array, point: Array, motion: Array) -> None:
    """Fill the motion of a point of a body (see ``bias_of``) from that at the world's origin."""
    for k in range(4):
        for i in range(3):
            motion[k, i] = origin[k, i]
    _add_cross(origin[1], point, motion[0])
    _add_cross(origin[3], point, motion[2])
    _add_cross(origin[1], motion[0], motion[2])


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[:,::1], float64[:,::1], float64[:,::1],"
    " int64[::1], int64[:,::1], int64[:,::1], int64[::1],"
    " float64[::1], float64[:,:,::1], float64[:,:,::1])"
)
def move_frames(
    bias_force: Array,
    damping: Array,
    v: Array,
    joint_jacobian: Array,
    poses: Array,
    support: Array,
    carriers: Array,
    joints: Array,
    closures: Array,
    points: Array,
    forces: Array,
    jacobians: Array,
    motions: Array,
) -> None:
    """Fill ``forces`` with h, -damping v and Ẇv, the others for the operational points.

    Args:
        bias_force: (nv,) h.
        damping: (nv,) viscous damping.
        v: (nv,) rates.
        joint_jacobian: (nv, 6) world axes, at the world's origin.
        poses: (frames, 12).
        support: (frames, nv) 1 where a rate moves a frame, else 0.
        carriers: (frames,) joint that carries each frame.
        joints: per joint its parent, its first rate and its number of rates; 0 is the world.
        closures: per active closure its kind, its frames a and b, and its first row.
        points: frame of each operational point.
        forces: (2 nv + m,) to fill.
        jacobians: (points, 6, nv) to fill with J_h.
        motions: (points, 2, 6) to fill with J_h v and J̇_h v.
    """
    nv = v.size
    for c in range(nv):
        forces[c] = bias_force[c]
        forces[nv + c] = -damping[c] * v[c]
    motion_a, motion_b = np.empty((4, 3)), np.empty((4, 3))
    state = np.empty((joints.shape[0], 4, 3))
    state[0] = 0.0
    for joint in range(1, joints.shape[0]):
        parent = state[joints[joint, 0]]
        _follow(joints[joint], joint_jacobian, v, parent, motion_a[:2], state[joint])
    for index in range(closures.shape[0]):
        kind, a, b, first = closures[index]
        _at_point(state[carriers[a]], poses[a, 9:12], motion_a)
        _at_point(state[carriers[b]], poses[b, 9:12], motion_b)
        bias_of(kind, poses[a], poses[b], motion_a, motion_b, forces[2 * nv + first :])
    moved = np.empty(3)
    for index in range(points.size):
        frame = points[index]
        jacobian = jacobians[index]
        for c in range(nv):
            column = joint_jacobian[c]
            cross(column[3:6], poses[frame, 9:12], moved)
            for i in range(3):
                jacobian[i, c] = support[frame, c] * (column[i] + moved[i])
                jacobian[3 + i, c] = support[frame, c] * column[3 + i]
        _at_point(state[carriers[frame]], poses[frame, 9:12], motions[index].reshape(4, 3))
