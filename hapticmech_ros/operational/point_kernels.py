"""Kernel of what a controller needs of an operational point: analysis, pose and twist at once."""

from __future__ import annotations

from hapticmech_ros.compilation import kernel, local, put, shaped
from hapticmech_ros.mechanism.compiled.element_kernels import element_forces
from hapticmech_ros.mechanism.compiled.kernels import factor
from hapticmech_ros.mechanism.compiled.motion_kernels import closure_bias, move_joints, move_point
from hapticmech_ros.mechanism.compiled.packed import unpack
from hapticmech_ros.mechanism.compiled.tables import Tables
from hapticmech_ros.mechanism.compiled.tree_kernels import bias_force_of
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.operational.kernels import ANALYSIS_SIZE, analyse_motion, metric_of
from hapticmech_ros.rotation_kernels import quaternion_of

# Of the analysis alone; a negative code of the closures is one of ``factor_closures``.
NO_SPECTRUM = 1


@kernel(
    "int64(int64[::1], float64[::1], float64[::1], float64[::1], float64[::1], int64,"
    " float64[::1], int64[::1], float64[::1], float64[::1])"
)
def see_point(
    numbers: Array,
    values: Array,
    packed: Array,
    q: Array,
    v: Array,
    index: int,
    constants: Array,
    rows: Array,
    details: Array,
    seen: Array,
) -> int:
    """Evaluate Eq. 1 at a state and analyse an operational point there.

    Args:
        numbers: constants of the mechanism, whole ones.
        values: the others; see ``tables.fold``.
        packed: to fill.
        q: (nq,) configuration.
        v: (nv,) rates.
        index: number of the operational point.
        constants: of the analysis; see ``analyse_point`` for this and the next two.
        rows: (t,) rows of a six-vector that the task space has.
        details: (t + 2 t²,) to fill.
        seen: (133,) to fill: an operational model up to the point's twist.

    Returns:
        0; NO_SPECTRUM where the SVD of S does not converge; or a negative code.
    """
    tables = Tables(numbers, values)
    nv = tables.nv
    space = unpack(packed, tables)
    code = factor(tables, q, space)
    if code < 0:
        return code
    motions, bias, forces = tables.motions, tables.bias, tables.forces
    bias_force, passive, dissipative = forces[0], forces[1], forces[2]
    move_joints(tables, space, v, motions)
    bias_force_of(tables, space, motions, bias_force)
    closure_bias(tables, space, motions, bias)
    element_forces(tables, space, q, v, passive, dissipative)
    for c in range(nv):
        passive[c] += tables.effort[c]
    jacobian, motion = shaped(local(6 * nv), (6, nv)), local(12)
    move_point(tables, space, motions, index, jacobian, motion)
    pose = space.poses[tables.points[index]]
    rotation = shaped(pose[:9], (3, 3)).T
    metric = metric_of(constants, rows.size)
    converged = analyse_motion(
        tables,
        space,
        bias_force,
        passive,
        bias,
        jacobian,
        motion[6:],
        rotation,
        metric,
        rows,
        seen[:ANALYSIS_SIZE],
        details,
    )
    if not converged:
        return NO_SPECTRUM
    place = seen[ANALYSIS_SIZE:]
    put(place[:3], pose[9:])
    quaternion_of(rotation, place[3:7])
    put(place[7:13], motion[:6])
    return 0
