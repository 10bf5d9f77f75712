"""Forces at the points of contact, implicit in the rates that they lead to.

With λ at every point held over a step h, relative rates of points become v⁺ = v_free + h G λ,
G = J D⁻¹ P Jᵀ with the closures taken out, and the law there is

    λ_n = max(0, k y⁺ - (c - k h) v_n⁺),   y⁺ = y - h v_n⁺,   c = max(d + χ k y, k h)
    |λ_t| ≤ μ λ_n,  and λ_t is against v_t⁺ where that is not 0

v_n is positive where surfaces part. Newton's rule solves for all points at once. Where that does
not end, sweeps over the points, there and back, solve for one after the other before the next try:
sweeps alone take hundreds where many points hold a body, and Newton's rule may start too far off.
T14 to T19 of docs/derivations.md.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, kernel, local, put, shaped
from hapticmech_ros.contact.layout import (
    AHEAD,
    COULOMB,
    DAMPING,
    DISSIPATION,
    HELD,
    HELD_BEFORE,
    JOINT_A,
    JOINT_B,
    OFF,
    SHAPE_A,
    STIFFNESS,
    SWEEPS,
    Contacts,
)
from hapticmech_ros.contact.newton_kernels import (
    ACROSS,
    FRICTION,
    GIVE,
    OWN,
    PUSH,
    SCALE_VALUES,
    mismatch,
    newton,
    put_velocity,
)
from hapticmech_ros.contact.rate_kernels import add_later, contact_frame, contact_row
from hapticmech_ros.mechanism.kernels.data import Data
from hapticmech_ros.mechanism.kernels.metric_kernels import free_part, to_metric
from hapticmech_ros.mechanism.kernels.model import Model
from hapticmech_ros.mechanism.kernels.small_matrices import dot, dot_rows

# Of the friction that a point's own rates ask for, so much is left out: where it does nothing to
# them it is nothing.
LEAST_GIVE = 1e-9
MOST_SWEEPS = 40
# Sweeps end once rates are as the law says to this share of the largest one, or m/s.
SHARE, FLOOR = 1e-8, 1e-13


@inner
def _change(coupling: Array, i: int, change: float, velocity: Array) -> None:
    """Change all rates by what one more impulse does."""
    if change != 0.0:
        for j in range(velocity.size):
            velocity[j] += coupling[i, j] * change


@inner
def _friction(p: float, q: float, r: float, x: float, y: float, most: float) -> tuple[float, float]:
    """Return the impulse of friction u: (H + s) u = -(x, y), |u| ≤ most, s ≥ 0 least.

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
    high, low = high * (1.0 + LEAST_GIVE), low + LEAST_GIVE * high
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
def _solve_point(c: int, scales: Array, coupling: Array, impulse: Array, velocity: Array) -> None:
    """Solve for the force at a point with the others as they are."""
    k, own = 3 * c, scales[c, OWN]
    others = velocity[k] - own * impulse[k]
    wanted = (scales[c, PUSH] - others) / (own + scales[c, GIVE])
    change = max(wanted, 0.0) - impulse[k]
    impulse[k] += change
    _change(coupling, k, change, velocity)
    p, q, r = coupling[k + 1, k + 1], coupling[k + 1, k + 2], coupling[k + 2, k + 2]
    x = velocity[k + 1] - p * impulse[k + 1] - q * impulse[k + 2]
    y = velocity[k + 2] - q * impulse[k + 1] - r * impulse[k + 2]
    first, second = _friction(p, q, r, x, y, scales[c, FRICTION] * impulse[k])
    for i in range(2):
        change = (first if i == 0 else second) - impulse[k + 1 + i]
        impulse[k + 1 + i] += change
        _change(coupling, k + 1 + i, change, velocity)


@kernel(
    "void(float64[:,::1], float64[::1], float64[:,::1], float64[::1], float64[::1], float64,"
    " float64[::1], float64[:,::1])",
    linked=True,
)
def solve_points(
    scales: Array,
    apart: Array,
    coupling: Array,
    impulse: Array,
    velocity: Array,
    tolerance: float,
    report: Array,
    slopes: Array,
) -> None:
    """Solve for all impulses, in place, and report how that ended.

    Args:
        scales: (points, 5) of each point; see :mod:`~hapticmech_ros.contact.newton_kernels`.
        apart: (3 points,) relative velocities at the step's end without contacts, m/s; of each
            point the normal one first, in the point's own frame, as all that follows.
        coupling: (3 points, 3 points) J D⁻¹ Jᵀ, 1/kg.
        impulse: (3 points,) first guess, N s; replaced by the solution.
        velocity: (3 points,) relative velocities with these impulses, m/s; replaced likewise.
        tolerance: of the impulses' effect, m/s.
        report: (4,) its SWEEPS and OFF are filled.
        slopes: (3 points, 3 points) to work in.
    """
    n, size = scales.shape[0], impulse.size
    off, held = local(size), local(size)
    kept, kept_velocity = local(size), local(size)
    held[:] = 0.0
    put(kept, impulse)
    put(kept_velocity, velocity)
    # Of all that would do, the least friction: what it was before leaves no trace.
    if not newton(scales, apart, coupling, held, impulse, velocity, 0.3 * tolerance, slopes):
        _restore(kept, kept_velocity, impulse, velocity)
    worst, _ = mismatch(scales, impulse, 0.0, impulse, velocity, off)
    sweeps = 0
    while sweeps < MOST_SWEEPS and worst > tolerance:
        for i in range(size):
            held[i], kept[i], kept_velocity[i] = impulse[i], impulse[i], velocity[i]
        newton(scales, apart, coupling, held, impulse, velocity, 0.3 * tolerance, slopes)
        found, _ = mismatch(scales, impulse, 0.0, impulse, velocity, off)
        if found <= tolerance:
            worst = found
            break
        if not found < worst:
            _restore(kept, kept_velocity, impulse, velocity)
        for turn in range(2 * n):
            # There and back, so that a stack learns of its weight both ways.
            c = turn if turn < n else 2 * n - 1 - turn
            _solve_point(c, scales, coupling, impulse, velocity)
        sweeps += 2
        worst, _ = mismatch(scales, impulse, 0.0, impulse, velocity, off)
    report[SWEEPS], report[OFF] = sweeps, worst


@inner
def _restore(kept: Array, kept_velocity: Array, impulse: Array, velocity: Array) -> None:
    for i in range(impulse.size):
        impulse[i], velocity[i] = kept[i], kept_velocity[i]


@inner
def _fill_scales(
    c: int, law: Array, depth: float, step: float, coupling: Array, scales: Array
) -> None:
    """Fill a point's row of ``scales``; see :mod:`~hapticmech_ros.contact.newton_kernels`."""
    k, stiffness = 3 * c, law[STIFFNESS]
    damping = law[DAMPING] + law[DISSIPATION] * stiffness * max(depth, 0.0)
    resistance = max(damping, stiffness * step)
    p, q, r = coupling[k + 1, k + 1], coupling[k + 1, k + 2], coupling[k + 2, k + 2]
    scales[c, OWN], scales[c, GIVE] = coupling[k, k], 1.0 / (step * resistance)
    scales[c, PUSH], scales[c, FRICTION] = stiffness * depth / resistance, law[COULOMB]
    scales[c, ACROSS] = 0.5 * (p + r) + np.sqrt(0.25 * (p - r) * (p - r) + q * q)


@inner
def contact_forces(
    model: Model,
    data: Data,
    contacts: Contacts,
    later: Array,
    rates: Array,
    step: float,
    n: int,
) -> None:
    """Replace ``forces`` of the first n points, first guesses, by the solution; fill ``report``.

    Args:
        model: the mechanism's.
        data: filled at the step's start.
        contacts: with ``points`` and ``owners``, ``axes`` and ``poses`` at the step's start, and
            ``free``.
        later: (nv, 6) joint axes at the step's end, as twists about the world's origin.
        rates: (nv,) at the step's start.
        step: h, s.
        n: number of points.
    """
    nv, size = model.nv, 3 * n
    workspace, frames = contacts.workspace, shaped(contacts.frames, (n, 3, 3))
    rows = shaped(workspace, (size, nv))
    coupling = shaped(workspace[size * nv :], (size, size))
    slopes = shaped(workspace[size * (nv + size) :], (size, size))
    now, velocity, impulse, apart = local(3 * n), local(3 * n), local(3 * n), local(3 * n)
    points, owners, forces = contacts.points, contacts.owners, contacts.forces
    for c in range(n):
        contact_frame(points[c], frames[c])
        _fill_rows(contacts, later, rates, step, c, frames[c], rows, apart)
        for d in range(3):
            row, k = rows[3 * c + d], 3 * c + d
            now[k] = dot(row, rates)
            impulse[k] = step * dot(frames[c, d], forces[c])
            to_metric(model, data, row)
            free_part(model, data, row)
    for i in range(3 * n):
        for j in range(i + 1):
            coupling[i, j] = dot_rows(rows, i, j)
            coupling[j, i] = coupling[i, j]
    scales, depths, largest = shaped(local(n * SCALE_VALUES), (n, SCALE_VALUES)), local(n), 0.0
    laws, report, ahead = contacts.laws, contacts.report, contacts.settings[AHEAD]
    for c in range(n):
        depths[c] = points[c, 6] - ahead * step * now[3 * c]
        _fill_scales(c, laws[owners[c]], depths[c], step, coupling, scales)
    for i in range(3 * n):
        largest = max(largest, abs(apart[i]))
    put_velocity(apart, coupling, impulse, velocity)
    solve_points(
        scales, apart, coupling, impulse, velocity, SHARE * largest + FLOOR, report, slopes
    )
    for c in range(n):
        left, stiffness = max(depths[c] - step * velocity[3 * c], 0.0), laws[owners[c], STIFFNESS]
        before = max(points[c, 6], 0.0)
        report[HELD] += 0.5 * stiffness * left * left
        report[HELD_BEFORE] += 0.5 * stiffness * before * before
        for i in range(3):
            forces[c, i] = 0.0
        for d in range(3):
            k = 3 * c + d
            for i in range(3):
                forces[c, i] += frames[c, d, i] * impulse[k] / step


@inner
def _fill_rows(
    contacts: Contacts,
    later: Array,
    rates: Array,
    step: float,
    c: int,
    frame: Array,
    rows: Array,
    apart: Array,
) -> None:
    """Fill a point's three rows of J, and its rates at the step's end without contacts."""
    parting, moves, axes = local(3), contacts.moves, contacts.axes
    point, pair = contacts.points[c], contacts.pairs[contacts.owners[c]]
    for i in range(3):
        parting[i] = 0.0
    for side in range(2):
        joint = pair[JOINT_A + side]
        if joint > 0:
            add_later(
                point, contacts.poses[pair[SHAPE_A + side], 9:], moves[joint], axes, rates, later,
                contacts.free, step, 1.0 - 2.0 * side, parting,
            )  # fmt: skip
    for d in range(3):
        contact_row(
            point, frame[d], moves[pair[JOINT_A]], moves[pair[JOINT_B]], axes, rows[3 * c + d]
        )
        apart[3 * c + d] = dot(frame[d], parting)
