# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mechanism's constants for one set of active closures, in two arrays for kernels.

Each array of a kernel's call takes time: a few long ones replace many. The whole numbers begin with
sizes, and with each part's offset; the others end with a workspace, since allocating a dozen
numbers takes longer than computing them.

The terms at a configuration are one array: see :class:`Data`.

Records name the entries of each array that the mechanism's kernels read and fill.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from hapticmech_ros.compilation import SIZES, Part, RecordPart, Size, Structure
from hapticmech_ros.compilation.records import Number, Record, Whole
from hapticmech_ros.mechanism.kernels.many_rows import SOME_ROWS
from hapticmech_ros.numerics import Array

# Stages of a step, at most.
MOST_STAGES = 6


class StepSettings(Record):
    """How a step is done.

    Attributes:
        step: its length h, s.
        semi_implicit: 1 where positions move with the rates at the step's end.
        projection_tolerance: largest |φ| at which the projection stops, m.
        rounding_tolerance: largest |φ| up to which it may stop once φ halves no more, m.
        jump_residual: largest |φ| beyond which a step may have been a jump, m.
        baumgarte_rate: a of Baumgarte's stabilisation, 1/s; 0 for the projection.
        residual_limit: largest |φ| beyond which a loop has come apart, m.
        local_rates: 1 where θ̇ differs from v at later stages.
        singularity_checks: whether singular positions end a run, see ``run_kernels``.
        energy_tolerance: share of the energy exchanged by which a step's account may be off; 0 for
            no check.
        contact_wrenches: number of contacts' wrenches on links, which come first.
        drift_tolerance: share of the energy exchanged that all steps together may make from
            nothing.
    """

    step = Number()
    semi_implicit = Number()
    projection_tolerance = Number()
    rounding_tolerance = Number()
    jump_residual = Number()
    baumgarte_rate = Number()
    residual_limit = Number()
    local_rates = Number()
    singularity_checks = Number()
    energy_tolerance = Number()
    contact_wrenches = Number()
    drift_tolerance = Number()


class StepAccount(Record):
    """Counts and energies of a run's steps.

    Attributes:
        work_in: work done, that of contacts included, J.
        energy_lost: in damping, friction and stops, J.
        last_residual: largest |φ| of the projection's iteration before, m or rad.
        step_length: of the step in the mass metric, if it may have been a jump; else infinite.
        projection_length: of the projection in the mass metric.
        steps_done: their number.
        energy_defect: by how much the energy accounts of all steps are off, J.
        contact_work: the part of the work that contacts did, J.
        earlier_defect: energy defect when the run began, J; see ``motion.EarlierAccount``.
        earlier_work: work done by then, J.
        earlier_loss: energy lost by then, J.
        largest_kinetic: largest kinetic energy at the end of a step so far, earlier ones included,
            J.
        lossy_steps: number of steps after which too much had been lost without a cause.
    """

    work_in = Number()
    energy_lost = Number()
    last_residual = Number()
    step_length = Number()
    projection_length = Number()
    steps_done = Number()
    energy_defect = Number()
    contact_work = Number()
    earlier_defect = Number()
    earlier_work = Number()
    earlier_loss = Number()
    largest_kinetic = Number()
    lossy_steps = Number()


class RunPlan(Record):
    """Parameters of a run.

    Attributes:
        steps: their number.
        stages: of the integrator's rule.
        implicit: 1 for an implicit rule.
        terms_known: 1 where terms at the start are known.
        sample_every: steps from one sample to the next, 0 for none.
        begins_with: with contacts, the run's first action, see ``contact.step_kernels``.
        external_wrenches: with contacts, number of rows of ``external`` after those of the contacts
            that are wrenches from outside.
    """

    dtype = int
    steps = Whole()
    stages = Whole()
    implicit = Whole()
    terms_known = Whole()
    sample_every = Whole()
    begins_with = Whole()
    external_wrenches = Whole()


class TermsTail(Record):
    """The end of a packed array of terms: the most used ones.

    Attributes:
        largest_residual: largest |φ|, m or rad.
        rank: number of independent closure rows.
        least_sigma: smallest σ that is more than rounding over the largest; 1 without closures.
        resolved_rank: number of rows that differ by more than rounding.
        potential_energy: J, infinite until a step's account has computed it.
    """

    largest_residual = Number()
    rank = Number()
    least_sigma = Number()
    resolved_rank = Number()
    potential_energy = Number()


class SharedConstants(Structure):
    """A mechanism's constants: they begin the table of offsets that model, terms and work share.

    With a set of active closures; f frames, j joints with the world. Only frames are there that
    closures, operational points and springs need.

    Attributes:
        nq: length of q.
        nv: number of rates.
        m: number of closure rows.
        path: DENSE or SPARSE.
        width: of a sparse factorisation's band; 0 of a dense one.
        border: number of rates that are in no band, the last ones in ``order``; see
            ``band_kernels``.
        independent: rank that a sparse factorisation has to have, -1 for any.
        carriers: (f,) joint that carries each frame.
        joints: (j, 5) per joint its parent, its first rate, its number of rates, its kind (see
            ``tree_kernels``) and where it is in q; 0 is the world.
        closures: (closures, 4) kind, frames a and b, and first row.
        points: (points,) frame of each operational point.
        elements: (e, 2) per joint with spring, friction or stops its index in v and in q.
        springs: (s, 2) frames a and b of each spring between points.
        order: (nv,) a sparse factorisation's order of rates; (0,) of a dense one.
        sequence: (m, 5) its order of closure rows: row, first and last place in ``order`` that it
            reaches before the border, joints a and b; (0, 5) of a dense one.
        damping: (nv,) viscous damping, N m s/rad or N s/m.
        lengths: (m,) length of each row in m, 1 for rows in rad: the scale of its residual.
        placements: (f, 12) each frame in its joint: its axes, then its origin, m. Of a rod's frame
            a the first axis is as long as the rod.
        effort: (nv,) constant forces of the joints, N m or N.
        element_values: (e, 9) stiffness, rest, friction and its speed, lower and upper stop, their
            stiffness, damping and depth.
        spring_values: (s, 4) stiffness, damping, rest length, and length without direction.
        joint_values: (j, 57) see ``tree_kernels.joint_row``.
        gravity: (3,) m/s².
        data_size: length of a packed array of terms, see :class:`Data`.
    """

    __slots__ = ()

    nq, nv, m, path = Size(), Size(), Size(), Size()
    width, border, independent, data_size = Size(), Size(), Size(), Size()
    carriers, joints, closures = Part(1, whole=True), Part(2, whole=True), Part(2, whole=True)
    points, elements, springs = Part(1, whole=True), Part(2, whole=True), Part(2, whole=True)
    order, sequence = Part(1, whole=True), Part(2, whole=True)
    damping, lengths, placements, effort = Part(1), Part(1), Part(2), Part(1)
    element_values, spring_values, joint_values, gravity = Part(2), Part(2), Part(2), Part(1)


class Data(Structure, after=SharedConstants):
    """A configuration's terms; k = min(m, nv), and of k directions the first ``rank`` are filled.

    Dense and sparse factorisations share the array's first half; parts of the other one are empty.

    Attributes:
        residual: (m,) φ.
        pairs: (m, 12) W row by row: the wrenches on the joints of frames a and b whose power is the
            row's rate, force first, moment about the world's origin.
        joint_jacobian: (nv, 6) columns of all joints, world axes, at the world's origin.
        poses: (frames, 12) each frame's axes in the world, then its origin.
        places: (joints, 12) the joints' own poses.
        bodies: (joints, 12) each joint's own inertia in world axes about the world's origin: mass,
            mass times centre, and xx, xy, xz, yy, yz, zz.
        factor: (nv, nv) lower Cholesky factor L of D; dense.
        jacobian: (m, nv) W; dense.
        basis: (k, nv) Uᵀ; dense.
        sigma: (k,) σ; dense.
        rows: (k, m) (V / row length)ᵀ; dense.
        pivots: (nv, 8) articulated inertia times each axis over the root of its pivot, that root,
            and its inverse; sparse.
        band: (m, width) rows of R over reflectors, by ``sequence``; sparse.
        row_places: (m, 5) per closure row where its band begins, its pivot or -1, the inverse of
            R's diagonal, the band's last row, and the first row before it that reaches into it;
            sparse.
        shares: (m + border, border) free directions at the rows' pivots, by ``sequence``, and at
            the border's rates: orthonormal columns; sparse.
        tail: of all that, the array's end.
    """

    __slots__ = ()

    residual, pairs, joint_jacobian = Part(1), Part(2), Part(2)
    poses, places, bodies = Part(2), Part(2), Part(2)
    factor, jacobian, basis, sigma, rows = Part(2), Part(2), Part(2), Part(1), Part(2)
    pivots, band, row_places, shares = Part(2), Part(2), Part(2), Part(2)
    tail = RecordPart(TermsTail)


class Work(Structure, after=Data):
    """A step's data; its sizes are those of the mechanism's model.

    Attributes:
        settings: of the step.
        scheme: (6, 2) per stage its weight, and the fraction of the step at which the next one is.
        account: of the steps.
        q0: (nq,) configuration at the start.
        v0: (nv,) rates at the start.
        state: (nq + nv,) q and v.
        q: (nq,) configuration now.
        v: (nv,) rates now.
        theta: (nv,) change of the configuration, from q0 to the next stage or the end; or from q.
        turn: (nv,) θ̇ at this stage.
        turned: (nv,) weighted sum of θ̇.
        gained: (nv,) weighted sum of v̇.
        held: (nv,) joint forces from outside.
        wrenches: (points, 6) at the operational points.
    """

    __slots__ = ()

    settings = RecordPart(StepSettings)
    scheme = Part(2)
    account = RecordPart(StepAccount)
    q0, v0, q, v = Part(1), Part(1), Part(1), Part(1)
    theta, turn, turned, gained = Part(1), Part(1), Part(1), Part(1)
    held, wrenches, state = Part(1), Part(2), Part(1)


def tail_of(packed: Array) -> TermsTail:
    """Return the end of a packed array of any mechanism, a view.

    Args:
        packed: (size,) packed terms.
    """
    return TermsTail(packed[-TermsTail.layout.size :])


# Path of a factorisation: see :class:`Data`.
DENSE, SPARSE = 0, 1
JOINT_COLUMNS, FRAME_COLUMNS = 57, 12
# A sparse factorisation's numbers per rate, and per closure row beside its band.
_PIVOT, _ROW = 8, 5


_WHOLE = [name for name, part in SharedConstants.parts.items() if part.whole]
_REAL = [name for name, part in SharedConstants.parts.items() if not part.whole]
# Rows of ``Model.small``.
_SMALL = 4


def pack(sizes: Mapping[str, int], parts: Mapping[str, Array]) -> tuple[Array, Array]:
    """Return a mechanism's constants as (integers,) and (numbers,); see :class:`Model`.

    Args:
        sizes: all of :class:`SharedConstants` but ``data_size``, by name; ``implicit``, 1 for an
            implicit rule; and ``stages``, of a rule that keeps all of them, else 0.
        parts: (n,) or (n, m) those of it, and ``units`` and ``rounding``, by name.
    """
    whole = [np.asarray(parts[name], dtype=np.int64) for name in _WHOLE]
    real = [np.asarray(parts[name], dtype=float) for name in _REAL]
    frames, joints, points = (len(parts[name]) for name in ("carriers", "joints", "points"))
    of_whole, _ = _stacked(map(_shape, whole), SIZES + 3 * Model.numbered)
    of_real, length = _stacked(map(_shape, real))
    of_data, size = _stacked(_data_shapes(sizes, frames, joints))
    rooms, workspace = _stacked(_workspace_shapes(sizes, joints), length)
    end, m, known = length + workspace, sizes["m"], {**sizes, "data_size": size}
    places = [*of_whole, *of_real, *of_data, *_work_places(sizes, points), *rooms]
    head = [*(known[name] for name in SharedConstants.sizes), *places, end, m, 1, end + m, 1, 1]
    numbers = np.concatenate([np.array(head), *(part.ravel() for part in whole)])
    constant = [*(part.ravel() for part in real), np.zeros(workspace)]
    return numbers, np.concatenate([*constant, parts["units"], parts["rounding"]])


def _shape(part: Array) -> tuple[int, int]:
    """Return rows and columns of a part; a vector has one column."""
    return len(part), part.shape[1] if part.ndim == 2 else 1


def _data_shapes(sizes: Mapping[str, int], frames: int, joints: int) -> list[tuple[int, int]]:
    """Return rows and columns of a packed array's parts."""
    nv, m, border, dense = sizes["nv"], sizes["m"], sizes["border"], sizes["path"] == DENSE
    # Of the two kinds one has its sizes, the other none.
    n, rows, k = (nv, m, min(m, nv)) if dense else (0, 0, 0)
    pivots, band = (0, 0) if dense else (nv, m)
    shapes = [(m, 1), (m, 12), (nv, 6), (frames, 12), (joints, 12), (joints, 12)]
    shapes += [(n, n), (rows, n), (k, n), (k, 1), (k, rows)]
    shapes += [(pivots, _PIVOT), (band, sizes["width"]), (band, _ROW)]
    return [*shapes, (m + border if border else 0, border), (TermsTail.layout.size, 1)]


def _work_places(sizes: Mapping[str, int], points: int) -> list[int]:
    """Return start, rows and columns of the parts of a step's work; see ``model.Work``."""
    nq, nv = sizes["nq"], sizes["nv"]
    shapes = [(StepSettings.layout.size, 1), (MOST_STAGES, 2), (StepAccount.layout.size, 1)]
    shapes += [(nq, 1), (nv, 1), (nq, 1), (nv, 1)]
    places, _ = _stacked([*shapes, *[(nv, 1)] * 5, (points, 6)])
    # q and v, one after the other, are the state as well.
    return [*places, places[15], nq + nv, 1]


def _workspace_shapes(sizes: Mapping[str, int], joints: int) -> list[tuple[int, int]]:
    """Return rows and columns of the parts to work in; see :class:`Model`."""
    nv, m, of_dense = sizes["nv"], sizes["m"], sizes["m"] if sizes["path"] == DENSE else 0
    shapes = [(joints, 36), (joints, 12), (3, nv), (m, 1), (nv + m, 1), (nv, 1), (m, 1)]
    shapes += [(m if sizes["border"] else 0, 1)]
    many, most = (m, min(m, nv)) if of_dense >= SOME_ROWS else (0, 0)
    shapes += [(of_dense, nv), (of_dense, of_dense), (_SMALL, FRAME_COLUMNS)]
    shapes += [(nv if many else 0, many), (most, nv), (nv if many else 0, most), (most, many)]
    shapes += [(3, most * many), (2, max(many, nv) if many else 0)]
    n, stages = nv if sizes["implicit"] else 0, sizes["stages"]
    return [*shapes, *[(n, n)] * 4, *[(stages, nv)] * 2, *[(n, 1)] * 3, (min(n, 1), 1)]


def _stacked(shapes: Iterable[tuple[int, int]], start: int = 0) -> tuple[list[int], int]:
    """Return start, rows and columns of parts that follow each other, and their length."""
    places, length = [], 0
    for height, columns in shapes:
        places += [start + length, height, columns]
        length += height * columns
    return places, length


class Model(SharedConstants, after=Work):
    """A mechanism's constants, packed: each part a view, located on access.

    A workspace follows the constants. Functions do not keep values in it between calls, and do not
    write to parts that their caller still needs.

    Attributes:
        sweep: (joints, 36) numbers passed from joint to joint.
        motions: (joints, 12) the joints' motions; see ``motion_kernels.move_joints``.
        forces: (3, nv) h, forces of elements, and their dissipative part.
        bias: (m,) Ẇv.
        result: (nv + m,) v̇ and λ.
        turned: (nv,) a vector by places, of one function at a time.
        along: (m,) numbers along the closures' directions, likewise.
        across: (m,) numbers at the pivots of a sparse factorisation with a border; else (0,).
        scaled: (m, nv) rows to be made orthogonal; dense.
        turn: (m, m) workspace of that; dense.
        small: (4, 12) rows for a frame, a pair of wrenches, or less.
        columns: (nv, m) closure rows as columns, to be made triangular; dense, of some rows.
        reflectors: (k, nv) workspace of that; likewise, as the next ones.
        directions: (nv, k) columns of Q.
        inverse: (k, m) (Rᵀ)⁺.
        inverting: (3, k m) workspace of that.
        sums: (2, max(m, nv)) numbers along columns.
        stiffness_matrix, damping_matrix: (nv, nv) K and C at a step's start; of an implicit rule,
            as the next ones.
        slope: (nv, nv) S = γh C + (γh)² K.
        slope_factor: (nv, nv) lower Cholesky factor of 1 + P L⁻¹ S L⁻ᵀ P.
        turns, gains: (stages, nv) k of θ and of v; also θ̇ and v̇ of a rule with a history.
        met, moved, pushed: (nv,) to work on.
        steepest: (1,) largest entry of S; 0 where there is no spring and no damper.
        units: (m,) divisors of W's rows before it is factored; see
            :meth:`~hapticmech_ros.mechanism.mechanism.Mechanism.row_units`.
        rounding: (1,) σ of rows over their units below which all is rounding.
    """

    __slots__ = ()

    sweep, motions, forces, bias = Part(2), Part(2), Part(2), Part(1)
    result, turned, along, across = Part(1), Part(1), Part(1), Part(1)
    scaled, turn, small, columns = Part(2), Part(2), Part(2), Part(2)
    reflectors, directions, inverse, inverting = Part(2), Part(2), Part(2), Part(2)
    sums, stiffness_matrix, damping_matrix = Part(2), Part(2), Part(2)
    slope, slope_factor, turns, gains = Part(2), Part(2), Part(2), Part(2)
    met, moved, pushed, steepest = Part(1), Part(1), Part(1), Part(1)
    units, rounding = Part(1), Part(1)
