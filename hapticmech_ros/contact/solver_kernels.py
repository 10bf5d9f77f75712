"""Forces at the points of contact, implicit in the rates that they lead to.

With λ at every point held over a step h, relative rates of the points become v⁺ = v_free + h G λ,
G = J D⁻¹ P Jᵀ with the closures taken out, and the law there is

    λ_n = max(0, k y⁺ - (c - k h) v_n⁺),   y⁺ = y - h v_n⁺,   c = max(d, k h)
    |λ_t| ≤ μ λ_n,  and  v_t⁺ = -(R + s) λ_t  with s = 0 where it is less: it sticks, and s ≥ 0

v_n is positive where surfaces part. Sweeps over the points solve for one after the other exactly.
T14 to T17 of docs/derivations.md.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel
from hapticmech_ros.contact.touch_kernels import tangents
from hapticmech_ros.mechanism.compiled.small_matrices import dot, dot_rows, remove, solve_lower
from hapticmech_ros.mechanism.model import Array

# A point that sticks slips by this share of the speed that its own force gives it in a step: it
# makes forces unique, and moves a block on a slope by less than an atom's size in a minute.
STICKING_SLIP = 1e-9
MOST_SWEEPS = 50
# Sweeps end once they change no rate by this share of the largest one, or m/s.
SHARE, FLOOR = 1e-8, 1e-13
# Of a report: sweeps done, what the last one changed, m/s, energy held, work on the mechanism as
# it moves and as the integrator counts it, J.
SWEEPS, CHANGE, HELD, WORK, COUNTED, REPORT_VALUES = 0, 1, 2, 3, 4, 5


@inner
def _frame(point: Array, frame: Array) -> None:
    """Put a point's normal and two tangents into the rows of ``frame``."""
    for i in range(3):
        frame[0, i] = point[3 + i]
    tangents(frame[0], frame[1], frame[2])


@inner
def _row(
    point: Array, direction: Array, moves_a: Array, moves_b: Array, axes: Array, row: Array
) -> None:
    """Fill ``row`` (nv,): the rate of a against b at a point, along a direction, is row · v."""
    x = point[1] * direction[2] - point[2] * direction[1]
    y = point[2] * direction[0] - point[0] * direction[2]
    z = point[0] * direction[1] - point[1] * direction[0]
    for j in range(row.size):
        side = moves_a[j] - moves_b[j]
        row[j] = 0.0
        if side != 0.0:
            row[j] = side * (
                direction[0] * axes[j, 0]
                + direction[1] * axes[j, 1]
                + direction[2] * axes[j, 2]
                + x * axes[j, 3]
                + y * axes[j, 4]
                + z * axes[j, 5]
            )


@inner
def _change(coupling: Array, i: int, change: float, velocity: Array) -> None:
    """Change all rates by what one more impulse does."""
    if change != 0.0:
        for j in range(velocity.size):
            velocity[j] += coupling[i, j] * change


@inner
def _friction(p: float, q: float, r: float, x: float, y: float, most: float) -> tuple[float, float]:
    """Return the impulse of friction: u with (H + R + s) u = -(x, y), |u| ≤ most, s least.

    H = ((p, q), (q, r)); s is found where |u| = most, by Newton on 1 / |u|, from below.
    """
    mean, half = 0.5 * (p + r), 0.5 * (p - r)
    swing = np.sqrt(half * half + q * q)
    high, low = mean + swing, max(mean - swing, 0.0)
    if most <= 0.0 or high <= 0.0:
        return 0.0, 0.0
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
    return cosine * a - sine * b, sine * a + cosine * b


@inner
def _solve_point(
    c: int,
    depth: float,
    law: Array,
    step: float,
    coupling: Array,
    impulse: Array,
    velocity: Array,
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
    first, second = _friction(p, q, r, x, y, law[2] * impulse[k])
    for i in range(2):
        change = (first if i == 0 else second) - impulse[k + 1 + i]
        impulse[k + 1 + i] += change
        _change(coupling, k + 1 + i, change, velocity)
        worst = max(worst, abs(change) * max(p, r))
    return worst


@kernel(
    "void(f8[:, ::1], i8[:, ::1], f8[:, ::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1],"
    " f8[:, ::1], f8[:, ::1], f8, f8, f8[:, ::1], f8[::1])"
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
        step: h, s.
        ahead: 1/2, or 0 where positions move by h v⁺.
        forces: (n, 3) on a, world axes, N: first guesses, replaced by the solution.
        report: (5,) to fill.
    """
    n, nv = points.shape[0], rates.size
    rows, frames = np.empty((3 * n, nv)), np.empty((n, 3, 3))
    now, velocity, impulse = np.empty(3 * n), np.empty(3 * n), np.empty(3 * n)
    for c in range(n):
        _frame(points[c], frames[c])
        for d in range(3):
            row = rows[3 * c + d]
            _row(points[c], frames[c, d], moves[joints[c, 0]], moves[joints[c, 1]], axes, row)
            now[3 * c + d] = dot(row, rates)
            velocity[3 * c + d] = dot(row, free)
            impulse[3 * c + d] = step * dot(frames[c, d], forces[c])
            solve_lower(factor, row)
            remove(basis, basis.shape[0], row)
    coupling = np.empty((3 * n, 3 * n))
    for i in range(3 * n):
        for j in range(i + 1):
            coupling[i, j] = dot_rows(rows, i, j)
            coupling[j, i] = coupling[i, j]
    depths = np.empty(n)
    for c in range(n):
        depths[c] = points[c, 6] - ahead * step * now[3 * c]
    largest = 0.0
    for i in range(3 * n):
        largest = max(largest, abs(velocity[i]))
    for i in range(3 * n):
        _change(coupling, i, impulse[i], velocity)
    sweep, worst = 0, np.inf
    while sweep < MOST_SWEEPS and worst > SHARE * largest + FLOOR:
        worst = 0.0
        for turn in range(n):
            # There and back, so that a stack learns of its weight both ways.
            c = turn if sweep % 2 == 0 else n - 1 - turn
            worst = max(
                worst, _solve_point(c, depths[c], laws[c], step, coupling, impulse, velocity)
            )
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
