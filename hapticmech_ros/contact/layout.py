# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Contacts of a mechanism as kernels take them: model and data, in two arrays.

Made once with the mechanism. The model comes from the scene: shapes, pairs, laws. A step reads and
changes the data: poses of shapes, near pairs, points and forces.
"""

from __future__ import annotations

from hapticmech_ros.compilation import Part, RecordPart, Structure
from hapticmech_ros.compilation.records import Number, Record, Whole

SPHERE, CAPSULE, CYLINDER, POLYTOPE, HALF_SPACE = 0, 1, 2, 3, 4
# Columns of a shape's whole numbers.
KIND, JOINT, FIRST_VERTEX, LAST_VERTEX, FIRST_FACE, LAST_FACE = 0, 1, 2, 3, 4, 5
# Columns of its floats: its pose in the joint, then these; the middle and half-lengths of a box
# about it, in its own axes.
RADIUS, HALF_LENGTH, MIDDLE, HALF_SIZE, SHAPE_VALUES = 12, 13, 14, 17, 20
# Points of a pair, and numbers of each: position, normal from b to a, depth.
MOST_POINTS, POINT_VALUES = 4, 7
# Result of the search for the nearest points: normal from a to b, distance, both points.
FOUND_VALUES = 10
# Of a bounding box: half-lengths, middle, and how far its shape can move, m.
BOX_VALUES = 7
# A wrench on a link, see ``motion_kernels.add_link_forces``.
PUSH_VALUES = 10
# Columns of a pair: shapes a and b, the joints that carry them, and whether its nearest points have
# to be searched for: neither shape is a half-space.
SHAPE_A, SHAPE_B, JOINT_A, JOINT_B, NEEDS_SEARCH = 0, 1, 2, 3, 4
# Columns of a pair's law: k, N/m; d, N s/m; μ; χ, s/m.
STIFFNESS, DAMPING, COULOMB, DISSIPATION = 0, 1, 2, 3
# Known parts of the step without contacts: none; rates and configuration at its end; and its branch
# of the motion as well.
NOTHING, ITS_END, ITS_BRANCH = 0.0, 1.0, 2.0
# Room for so many points at first; a scene where more touch gets more.
FIRST_WORKSPACE = 16


class ContactCounts(Record):
    """Whole numbers of a period with contacts.

    Attributes:
        points: number of points in the last substep.
        points_before: in the one before.
        points_found: those that the workspace lacked room for.
        parts: how many parts a substep has to be divided into.
        unsolved: substeps so far in the period whose forces violate the law.
    """

    dtype = int
    points = Whole()
    points_before = Whole()
    points_found = Whole()
    parts = Whole()
    unsolved = Whole()


class ContactSettings(Record):
    """How contacts are stepped.

    Attributes:
        ahead: how far ahead in a step depths are taken: 1/2 of it, or 0 where positions move by
            h v⁺.
        period: s.
        far_share: pairs further apart than this share of their size are ignored in a period.
        is_part: 1 for a step that is part of a divided one.
        known: known parts of the step without contacts; see ``NOTHING``.
    """

    ahead = Number()
    period = Number()
    far_share = Number()
    is_part = Number()
    known = Number()


class ContactReport(Record):
    """How a substep with contacts ended.

    Attributes:
        sweeps: that the solver did.
        residual: error of rates by the law, m/s.
        energy: stored in contacts at its end, J.
        energy_before: at its start, J.
        failed: 1 if forces violate the law.
    """

    sweeps = Number()
    residual = Number()
    energy = Number()
    energy_before = Number()
    failed = Number()


class Contacts(Structure):
    """Model and data of contacts; s shapes, p pairs, l links with shapes, j joints with the world.

    Attributes:
        shapes: (s, 6) kind, joint that carries it, and where its vertices and faces are.
        pairs: (p, 5) shapes a and b, the joints that carry them, and 1 for a search, else 0.
        faces: (f, 2) first corner and number of corners, of all polytopes.
        corners: (c,) vertices, in order around each face.
        carriers: (l,) joint that carries each link.
        counts: of points.
        owners: (4 p,) pair of each point.
        owners_before: (4 p,) in the substep before.
        shape_values: (s, 20) pose in the joint, radius, half-length, middle and half-lengths of a
            bounding box; see ``touch_kernels``.
        vertices: (v, 3) of all polytopes, m, in the shape's frame.
        normals: (f, 3) of faces, outward, in the shape's frame.
        laws: (p, 4) k, N/m; d, N s/m; μ; χ, s/m.
        moves: (j, nv) 1 where a rate moves a joint, 0 elsewhere.
        acts: (l, p) 1 where a pair's force acts on a link, -1 where its reaction does.
        link_origins: (l, 3) of the links' frames in their joints, m.
        settings: how they are stepped.
        axes: (nv, 6) joint axes at the substep's start, as twists about the world's origin.
        poses: (s, 12) of shapes there, in the world: axes, then origin, m.
        boxes: (s, 7) half-lengths and middle of a bounding box along the world's axes, and how far
            the shape can move, m.
        margins: (p,) m, gap up to which points of a pair count; -1 if it is far.
        found: (p, 10) unit normal from a to b, distance, and both nearest points, m, world.
        points: (4 p, 7) position, m, midway between both surfaces; unit normal from b to a; depth.
        forces: (4 p, 3) on a, N, world axes.
        points_before: (4 p, 7) of the substep before.
        forces_before: (4 p, 3) likewise.
        origins: (4 p, 3) of the frames of shapes a, m, world.
        free: (nv,) rates at the substep's end without contacts.
        change: (nv,) change of q in the substep without contacts.
        q: (nq,) configuration at its end.
        stiff: (nv,) difference to the rates by accelerations at the substep's start.
        branch: (nv, nv) in the mass metric, projector onto a branch of the motion.
        joint_force: (nv,) mean of Σ J_cᵀ λ over the period so far, zero in the rest of it, N m or
            N.
        step_force: (nv,) Σ J_cᵀ λ of the substep.
        report: of the substep.
        begun: (nq + nv,) state at the period's start.
        external: (l + links, 10) contacts' wrenches on links, then others'.
        frames: (4 p, 9) normal and tangents of points.
        workspace: for the solver's matrices.
        kept_counts, kept_owners, kept_points, kept_forces, kept_origins, kept_joint_force,
            kept_report: of a period's start, see ``step_kernels``.
    """

    __slots__ = ()

    shapes, pairs, faces = Part(2, whole=True), Part(2, whole=True), Part(2, whole=True)
    corners, carriers = Part(1, whole=True), Part(1, whole=True)
    counts, owners = RecordPart(ContactCounts, whole=True), Part(1, whole=True)
    owners_before, shape_values, vertices = Part(1, whole=True), Part(2), Part(2)
    normals, laws, moves, acts = Part(2), Part(2), Part(2), Part(2)
    link_origins, settings, axes, poses = Part(2), RecordPart(ContactSettings), Part(2), Part(2)
    boxes, margins, found, points = Part(2), Part(1), Part(2), Part(2)
    forces, points_before, forces_before, free = Part(2), Part(2), Part(2), Part(1)
    change, q, joint_force, report = Part(1), Part(1), Part(1), RecordPart(ContactReport)
    begun, external, frames, workspace = Part(1), Part(2), Part(2), Part(1)
    origins, kept_counts = Part(2), RecordPart(ContactCounts, whole=True)
    kept_owners, kept_points, kept_forces = Part(1, whole=True), Part(2), Part(2)
    kept_origins, kept_joint_force, kept_report = Part(2), Part(1), RecordPart(ContactReport)
    step_force, stiff, branch = Part(1), Part(1), Part(2)


def workspace_size(points: int, nv: int) -> int:
    """Return the length of the workspace that the solver needs for so many points."""
    return 3 * points * (nv + 6 * points)
