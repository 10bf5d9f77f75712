"""Forces at the points of contact, implicit in the rates that they lead to.

With λ at every point held over a step h, relative rates of the points become v⁺ = v_free + h G λ,
G = J D⁻¹ P Jᵀ with the closures taken out, and the law there is

    λ_n = max(0, k y⁺ - (c - k h) v_n⁺),   y⁺ = y - h v_n⁺,   c = max(d, k h)
    |λ_t| ≤ μ λ_n,  and  v_t⁺ = -(R + s) λ_t  with s = 0 where it is less: it sticks, and s ≥ 0

v_n is positive where surfaces part. Sweeps over the points solve for one after the other exactly;
after every other one a linear solve takes all points as they are then, pushing or not, sticking or
sliding with their s, and solves for all at once: sweeps alone take hundreds where many points hold
one body. T14 to T18 of docs/derivations.md.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.contact.rate_kernels import add_later, contact_frame, contact_row
from hapticmech_ros.mechanism.compiled.small_matrices import (
    cholesky,
    dot,
    dot_rows,
    remove,
    solve_lower,
    solve_lower_transposed,
)
from hapticmech_ros.mechanism.model import Array

# A point that sticks slips by this share of the speed that its own force gives it in a step: it
# makes forces unique, and moves a block on a slope by less than an atom's size in a minute.
STICKING_SLIP = 1e-9
MOST_SWEEPS = 60
# Linear solves that made things worse, after which no more are tried in a step.
MOST_REFUSED = 8
# Sweeps end once they change no rate by this share of the largest one, or m/s.
SHARE, FLOOR = 1e-8, 1e-13
# Of a report: sweeps done, what the last one changed, m/s, energy held, work on the mechanism as
# it moves and as the integrator counts it, J.
SWEEPS, CHANGE, HELD, WORK, COUNTED, REPORT_VALUES = 0, 1, 2, 3, 4, 5


@inner
def _change(coupling: Array, i: int, change: float, velocity: Array) -> None:
    """Change all rates by what one more impulse does."""
    if change != 0.0:
        for j in range(velocity.size):
            velocity[j] += coupling[i, j] * change


@inner
def _friction(
    p: float, q: float, r: float, x: float, y: float, most: float
) -> tuple[float, float, float]:
    """Return the impulse of friction u, and s: (H + R + s) u = -(x, y), |u| ≤ most, s least.

    H = ((p, q), (q, r)); s is found where |u| = most, by Newton on 1 / |u|, from below.
    """
    mean, half = 0.5 * (p + r), 0.5 * (p - r)
    swing = np.sqrt(half * half + q * q)
    high, low = mean + swing, max(mean - swing, 0.0)
    if most <= 0.0 or high <= 0.0:
        return 0.0, 0.0, 0.0
    # H's first axis.
    cosine, sine = (half + swing, q) if half >= 0.0 else (q, swing - half)
    size = np.sqrt(cosine * cosine + sine * sine)
    cosine, sine = (cosine / size, sine / size) if size > 0.0 else (1.0, 0.0)
    one, two = -(cosine * x + sine * y), -(cosine * y - sine * x)
    slip = STICKING_SLIP * high
    high, low = high + slip, low + slip
    s = 0.0
    for _ in range(30):
        a, b = one / (high + s), two / (low + s)
        length = np.sqrt(a * a + b * b)
        if length <= most * (1.0 + 1e-12):
            break
        slope = (a * a / (high + s) + b * b / (low + s)) / length
        s += (length - most) * length / (most * slope)
    a, b = one / (high + s), two / (low + s)
    return cosine * a - sine * b, sine * a + cosine * b, s + slip


@inner
def _solve_point(
    c: int,
    depth: float,
    law: Array,
    step: float,
    coupling: Array,
    impulse: Array,
    velocity: Array,
    slips: Array,
) -> float:
    """Solve for the force at a point with the others as they are; return what it changes, m/s."""
    k = 3 * c
    own = coupling[k, k]
    others = velocity[k] - own * impulse[k]
    stiffness, resistance = law[0], max(law[1], law[0] * step)
    wanted = step * (stiffness * depth - resistance * others) / (1.0 + resistance * step * own)
    change = max(wanted, 0.0) - impulse[k]
    impulse[k] += change
    _change(coupling, k, change, velocity)
    worst = abs(change) * own
    p, q, r = coupling[k + 1, k + 1], coupling[k + 1, k + 2], coupling[k + 2, k + 2]
    x = velocity[k + 1] - p * impulse[k + 1] - q * impulse[k + 2]
    y = velocity[k + 2] - q * impulse[k + 1] - r * impulse[k + 2]
    first, second, slips[c] = _friction(p, q, r, x, y, law[2] * impulse[k])
    for i in range(2):
        change = (first if i == 0 else second) - impulse[k + 1 + i]
        impulse[k + 1 + i] += change
        _change(coupling, k + 1 + i, change, velocity)
        worst = max(worst, abs(change) * max(p, r))
    return float(worst)


@inner
def _solve_all(
    depths: Array,
    laws: Array,
    step: float,
    coupling: Array,
    apart: Array,
    slips: Array,
    impulse: Array,
    velocity: Array,
) -> None:
    """Solve for all points at once, each as it is now: pushing or not, sticking or sliding.

    (G + C) u = b is positive definite: C is 1 / (h c) along normals and R + s across.
    """
    active, size = np.empty(impulse.size, dtype=np.int64), 0
    for c in range(depths.size):
        if impulse[3 * c] > 0.0:
            for d in range(3 if slips[c] > 0.0 else 1):
                active[size] = 3 * c + d
                size += 1
    matrix, factor, wanted = np.empty((size, size)), np.empty((size, size)), np.empty(size)
    for i in range(size):
        for j in range(i + 1):
            matrix[i, j] = coupling[active[i], active[j]]
        c = active[i] // 3
        wanted[i] = -apart[active[i]]
        if active[i] == 3 * c:
            resistance = max(laws[c, 1], laws[c, 0] * step)
            matrix[i, i] += 1.0 / (step * resistance)
            wanted[i] += laws[c, 0] * depths[c] / resistance
        else:
            matrix[i, i] += slips[c]
    if size == 0 or cholesky(matrix, factor) >= 0:
        return
    solve_lower(factor, wanted)
    solve_lower_transposed(factor, wanted)
    for i in range(impulse.size):
        impulse[i], velocity[i] = 0.0, apart[i]
    for i in range(size):
        impulse[active[i]] = wanted[i]
        _change(coupling, active[i], wanted[i], velocity)


@kernel(
    "void(f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1],"
    " f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, :, ::1], f8, f8, f8[:, ::1], f8[::1])"
)
def contact_forces(
    points: Array,
    joints: Array,
    laws: Array,
    axes: Array,
    moves: Array,
    rates: Array,
    free: Array,
    factor: Array,
    basis: Array,
    later: Array,
    centres: Array,
    step: float,
    ahead: float,
    forces: Array,
    report: Array,
) -> None:
    """Solve for the forces at all points.

    Args:
        points: (n, 7) position, normal from b to a, depth.
        joints: (n, 2) joints of a and b.
        laws: (n, 3) k, d and μ.
        axes: (nv, 6) joint axes, as twists about the world's origin.
        moves: (joints, nv) 1 where a rate moves a joint, 0 elsewhere.
        rates: (nv,) at the step's start.
        free: (nv,) at its end, without contacts.
        factor: (nv, nv) L.
        basis: (r, nv) rows of Uᵀ.
        later: (nv, 6) joint axes at the step's end.
        centres: (n, 2, 3) origins of both shapes, m.
        step: h, s.
        ahead: 1/2, or 0 where positions move by h v⁺.
        forces: (n, 3) on a, world axes, N: first guesses, replaced by the solution.
        report: (5,) to fill.
    """
    n, nv = points.shape[0], rates.size
    rows, frames = np.empty((3 * n, nv)), np.empty((n, 3, 3))
    now, velocity, impulse = np.empty(3 * n), np.empty(3 * n), np.empty(3 * n)
    parting = np.empty(3)
    along = np.empty(basis.shape[0])
    for c in range(n):
        contact_frame(points[c], frames[c])
        for i in range(3):
            parting[i] = 0.0
        for side in range(2):
            add_later(
                points[c], centres[c, side], moves[joints[c, side]], axes, rates, later, free,
                step, 1.0 - 2.0 * side, parting,
            )  # fmt: skip
        for d in range(3):
            row = rows[3 * c + d]
            contact_row(
                points[c], frames[c, d], moves[joints[c, 0]], moves[joints[c, 1]], axes, row
            )
            now[3 * c + d] = dot(row, rates)
            velocity[3 * c + d] = dot(frames[c, d], parting)
            impulse[3 * c + d] = step * dot(frames[c, d], forces[c])
            solve_lower(factor, row)
            remove(basis, basis.shape[0], row, along)
    coupling = np.empty((3 * n, 3 * n))
    for i in range(3 * n):
        for j in range(i + 1):
            coupling[i, j] = dot_rows(rows, i, j)
            coupling[j, i] = coupling[i, j]
    depths = np.empty(n)
    for c in range(n):
        depths[c] = points[c, 6] - ahead * step * now[3 * c]
    apart, slips = velocity.copy(), np.zeros(n)
    largest = 0.0
    for i in range(3 * n):
        largest = max(largest, abs(velocity[i]))
    for i in range(3 * n):
        _change(coupling, i, impulse[i], velocity)
    kept, kept_velocity = impulse.copy(), velocity.copy()
    sweep, worst, before, refused = 0, np.inf, np.inf, 0
    while sweep < MOST_SWEEPS and worst > SHARE * largest + FLOOR:
        tried = sweep % 2 == 1 and refused < MOST_REFUSED
        if tried:
            before = worst
            for i in range(3 * n):
                kept[i], kept_velocity[i] = impulse[i], velocity[i]
            _solve_all(depths, laws, step, coupling, apart, slips, impulse, velocity)
        worst = 0.0
        for turn in range(n):
            # There and back, so that a stack learns of its weight both ways.
            c = turn if sweep % 2 == 0 else n - 1 - turn
            changed = _solve_point(c, depths[c], laws[c], step, coupling, impulse, velocity, slips)
            worst = max(worst, changed)
        if tried and worst > before:
            # It took points for sticking or sliding that do not: sweeps are safe.
            refused, worst = refused + 1, before
            for i in range(3 * n):
                impulse[i], velocity[i] = kept[i], kept_velocity[i]
        sweep += 1
    for i in range(REPORT_VALUES):
        report[i] = 0.0
    report[SWEEPS], report[CHANGE] = sweep, worst
    for c in range(n):
        left = max(depths[c] - step * velocity[3 * c], 0.0)
        report[HELD] += 0.5 * laws[c, 0] * left * left
        for i in range(3):
            forces[c, i] = 0.0
        for d in range(3):
            k = 3 * c + d
            for i in range(3):
                forces[c, i] += frames[c, d, i] * impulse[k] / step
            report[WORK] += impulse[k] * (ahead * now[k] + (1.0 - ahead) * velocity[k])
            report[COUNTED] += impulse[k] * ((1.0 - ahead) * now[k] + ahead * velocity[k])
