"""What the forces at points of contact do to the links that touch, and in the joints."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import kernel, local
from hapticmech_ros.contact.shape_kernels import put_point
from hapticmech_ros.contact.solver_kernels import JOINT_A
from hapticmech_ros.mechanism.kernels.small_matrices import cross


@kernel(
    "void(f8[:, ::1], f8[:, ::1], i8[::1], i8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1],"
    " i8[::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1])"
)
def contact_effects(
    points: Array,
    forces: Array,
    owners: Array,
    pairs: Array,
    axes: Array,
    moves: Array,
    acts: Array,
    carriers: Array,
    origins: Array,
    joint_poses: Array,
    joint_force: Array,
    wrenches: Array,
) -> None:
    """Fill ``joint_force`` and ``wrenches``.

    Args:
        points: (n, 7) position first, m, world.
        forces: (n, 3) on a, N, world axes.
        owners: (n,) pair of each point.
        pairs: (pairs, 4) shapes a and b, and the joints that carry them.
        axes: (nv, 6) joint axes, as twists about the world's origin.
        moves: (joints, nv) 1 where a rate moves a joint, 0 elsewhere.
        acts: (links, pairs) 1 where a pair's force acts on a link, -1 where its reaction does.
        carriers: (links,) joint that carries each link.
        origins: (links, 3) of the links' frames in those joints, m.
        joint_poses: (joints, 12) in the world.
        joint_force: (nv,) to fill: Σ J_cᵀ λ, N m or N.
        wrenches: (links, 6) to fill: at the links' frames, N and N m, world axes.
    """
    moment, arm, place = local(3), local(3), local(3)
    joint_force[:] = 0.0
    wrenches[:] = 0.0
    for c in range(points.shape[0]):
        force, pair = forces[c], pairs[owners[c]]
        cross(points[c], force, moment)
        for j in range(joint_force.size):
            side = moves[pair[JOINT_A], j] - moves[pair[JOINT_A + 1], j]
            if side != 0.0:
                for i in range(3):
                    joint_force[j] += side * (axes[j, i] * force[i] + axes[j, 3 + i] * moment[i])
    for link in range(carriers.size):
        x, y, z = origins[link, 0], origins[link, 1], origins[link, 2]
        put_point(joint_poses[carriers[link]], x, y, z, place)
        for c in range(points.shape[0]):
            sign = acts[link, owners[c]]
            if sign != 0.0:
                for i in range(3):
                    arm[i] = points[c, i] - place[i]
                cross(arm, forces[c], moment)
                for i in range(3):
                    wrenches[link, i] += sign * forces[c, i]
                    wrenches[link, 3 + i] += sign * moment[i]
