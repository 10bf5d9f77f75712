# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Forces at the points of contact, implicit in the rates that they lead to.

With λ at every point held over a step h, relative rates of points become v⁺ = v_free + h G λ,
G = J D⁻¹ P Jᵀ with the closures taken out, and the law there is

    λ_n = max(0, k y⁺ - (c - k h) v_n⁺),   y⁺ = y - h v_n⁺,   c = max(d + χ k y, k h)
    |λ_t| ≤ μ λ_n,  and λ_t is against v_t⁺ where that is not 0

v_n is positive where surfaces part. Newton's rule solves for all points at once. Where that does
not end, sweeps over the points, there and back, solve for one after the other before the next try:
sweeps alone take hundreds where many points hold a body, and Newton's rule may start too far off.
T14 to T19 of docs/derivations.md. Points that impact have another law: see ``impact_kernels``.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.compilation import inner, kernel, local, local_whole, put, shaped
from hapticmech_ros.contact.impact_kernels import (
    FRICTION,
    GIVE,
    OWN,
    PUSH,
    SCALE_VALUES,
    fill_across,
    fill_impact_scales,
    find_impacts,
    mismatch,
    newton,
    parts_of,
    put_velocity,
)
from hapticmech_ros.contact.layout import (
    COULOMB,
    DAMPING,
    DISSIPATION,
    ITS_BRANCH,
    JOINT_A,
    JOINT_B,
    SHAPE_A,
    STIFFNESS,
    ContactReport,
    Contacts,
)
from hapticmech_ros.contact.touch_kernels import tangents
from hapticmech_ros.mechanism.kernels.metric_kernels import free_part, to_metric
from hapticmech_ros.mechanism.kernels.model import Data, Model
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import add_scaled, dot, dot_rows, largest, put3


@inner
def contact_frame(point: Array, frame: Array) -> None:
    """Put a point's normal and two tangents into the rows of ``frame``."""
    put3(frame[0], point[3:])
    tangents(frame[0], frame[1], frame[2])


@inner
def contact_row(
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
def add_later(
    point: Array,
    centre: Array,
    moves: Array,
    axes: Array,
    rates: Array,
    later: Array,
    free: Array,
    step: float,
    sign: float,
    parting: Array,
) -> None:
    """Add how fast a body moves at a point of contact at the step's end, without contacts.

    The point is taken along with the shape's centre, and does not turn with the body: where a ball
    touches a floor does not. T17.
    """
    now, then = local(6), local(6)
    now[:] = 0.0
    then[:] = 0.0
    for j in range(rates.size):
        if moves[j] != 0.0:
            add_scaled(now, rates[j], axes[j])
            add_scaled(then, free[j], later[j])
    x = point[0] + step * (now[0] + now[4] * centre[2] - now[5] * centre[1])
    y = point[1] + step * (now[1] + now[5] * centre[0] - now[3] * centre[2])
    z = point[2] + step * (now[2] + now[3] * centre[1] - now[4] * centre[0])
    parting[0] += sign * (then[0] + then[4] * z - then[5] * y)
    parting[1] += sign * (then[1] + then[5] * x - then[3] * z)
    parting[2] += sign * (then[2] + then[3] * y - then[4] * x)


# This share of the friction for a point's own rates is left out: where it has no effect on them it
# is zero.
LEAST_GIVE = 1e-9
MOST_SWEEPS = 40
# Sweeps end once rates obey the law to this share of the largest one, or m/s.
SHARE, FLOOR = 1e-8, 1e-13
# Rates that are off by more than this share of the largest one, and impacts' displacements by this
# share of the longest, violate the law: the energy is then off by a similar share, rk4's tolerance
# for a step.
UNSOLVED_SHARE = 1e-6
# For impacting points rates are solved to this share, and displacements in at most so many rounds:
# their error is an error of energy.
EXACT, MOST_TURNS = 1e-10, 12


@inner
def _change(coupling: Array, i: int, change: float, velocity: Array) -> None:
    """Change all rates by the effect of one more impulse."""
    if change != 0.0:
        add_scaled(velocity, change, coupling[i])


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
        scales: (points, 5) of each point; see :mod:`~hapticmech_ros.contact.impact_kernels`.
        apart: (3 points,) relative velocities at the step's end without contacts, m/s; of each
            point the normal one first, in the point's own frame, as all others.
        coupling: (3 points, 3 points) J D⁻¹ Jᵀ, 1/kg.
        impulse: (3 points,) first guess, N s; replaced by the solution.
        velocity: (3 points,) relative velocities with these impulses, m/s; replaced likewise.
        tolerance: of the impulses' effect, m/s.
        report: (5,) a ``layout.ContactReport``, of which ``sweeps`` and ``residual`` are filled.
        slopes: (3 points, 3 points) to work in.
    """
    n, size = scales.shape[0], impulse.size
    off, held = local(size), local(size)
    kept, kept_velocity = local(size), local(size)
    held[:] = 0.0
    put(kept, impulse)
    put(kept_velocity, velocity)
    # Of all solutions, the one with least friction: it does not depend on the step before.
    if not newton(scales, apart, coupling, held, impulse, velocity, 0.3 * tolerance, slopes):
        put(impulse, kept)
        put(velocity, kept_velocity)
    worst, _ = mismatch(scales, impulse, 0.0, impulse, velocity, off)
    sweeps = 0
    while sweeps < MOST_SWEEPS and worst > tolerance:
        put(held, impulse)
        put(kept, impulse)
        put(kept_velocity, velocity)
        newton(scales, apart, coupling, held, impulse, velocity, 0.3 * tolerance, slopes)
        found, _ = mismatch(scales, impulse, 0.0, impulse, velocity, off)
        if found <= tolerance:
            worst = found
            break
        if not found < worst:
            put(impulse, kept)
            put(velocity, kept_velocity)
        for turn in range(2 * n):
            # Forwards and backwards: a stack's weight propagates in both directions.
            c = turn if turn < n else 2 * n - 1 - turn
            _solve_point(c, scales, coupling, impulse, velocity)
        sweeps += 2
        worst, _ = mismatch(scales, impulse, 0.0, impulse, velocity, off)
    ended = ContactReport(report)
    ended.sweeps, ended.residual = sweeps, worst


@inner
def _fill_scales(
    c: int, law: Array, depth: float, step: float, coupling: Array, scales: Array
) -> None:
    """Fill a point's row of ``scales``; see :mod:`~hapticmech_ros.contact.impact_kernels`."""
    k, stiffness = 3 * c, law[STIFFNESS]
    damping = law[DAMPING] + law[DISSIPATION] * stiffness * max(depth, 0.0)
    resistance = max(damping, stiffness * step)
    scales[c, OWN], scales[c, GIVE] = coupling[k, k], 1.0 / (step * resistance)
    scales[c, PUSH], scales[c, FRICTION] = stiffness * depth / resistance, law[COULOMB]
    fill_across(c, coupling, scales)


@inner
def _solve(
    contacts: Contacts,
    apart: Array,
    now: Array,
    depths: Array,
    coupling: Array,
    slopes: Array,
    impacts: Array,
    reached: bool,
    step: float,
    impulse: Array,
    velocity: Array,
) -> None:
    """Solve for all impulses; linearise impacts about the points' displacements.

    Args:
        contacts: with ``owners`` and ``laws``; ``report`` is filled.
        apart: (3 n,) rates of the points at the step's end without contacts, m/s.
        now: (3 n,) at its start, m/s.
        depths: (n,) at its start, m, see :func:`_depth`.
        coupling: (3 n, 3 n) what impulses do to rates, 1/kg.
        slopes: (3 n, 3 n) to work in.
        impacts: (n,) 1 for a point that impacts.
        reached: whether one of these is reached in the step.
        step: h, s.
        impulse: (3 n,) first guess, N s; replaced by the solution.
        velocity: (3 n,) to fill, m/s.
    """
    n, fastest = depths.size, largest(apart)
    laws, owners, report = contacts.laws, contacts.owners, contacts.report
    scales, ways = shaped(local(n * SCALE_VALUES), (n, SCALE_VALUES)), local(n)
    put(velocity, apart)
    tolerance = (EXACT if reached else SHARE) * fastest + FLOOR
    moving = False
    for turn in range(MOST_TURNS if reached else 1):
        away, longest = 0.0, 0.0
        for c in range(n):
            law = laws[owners[c]]
            if impacts[c] == 0:
                _fill_scales(c, law, depths[c], step, coupling, scales)
                continue
            way = -0.5 * step * (now[3 * c] + velocity[3 * c])
            away, longest = max(away, abs(way - ways[c])), max(longest, abs(way))
            ways[c] = way
            fill_impact_scales(c, law, depths[c], way, now[3 * c], step, coupling, scales)
        moving = away > UNSOLVED_SHARE * longest
        if turn > 0 and away <= EXACT * longest:
            break
        put_velocity(apart, coupling, impulse, velocity)
        solve_points(scales, apart, coupling, impulse, velocity, tolerance, report.values, slopes)
    if (reached and moving) or report.residual > UNSOLVED_SHARE * fastest + FLOOR:
        report.failed = 1.0


@inner
def _depth(contacts: Contacts, c: int, rate: float, step: float, impacts: bool) -> float:
    """Return a point's depth, m, for its law: at the start of its motion in the step.

    At rest that is h / 2 ahead of the motion, where positions move by the mean of both rates.
    """
    ahead = contacts.settings.ahead - (0.5 if impacts else 0.0)
    return float(contacts.points[c, 6] - ahead * step * rate)


@inner
def _left_free(model: Model, data: Data, contacts: Contacts, row: Array) -> None:
    """Replace a row (nv,) in the mass metric by its part that closures leave free.

    Next to a crossing of branches closures do not determine that: then it is the part along the
    branch.
    """
    if contacts.settings.known != ITS_BRANCH:
        free_part(model, data, row)
        return
    whole = local(row.size)
    put(whole, row)
    for i in range(row.size):
        row[i] = dot(contacts.branch[i], whole)


@inner
def contact_forces(
    model: Model,
    data: Data,
    contacts: Contacts,
    later: Array,
    rates: Array,
    step: float,
    n: int,
) -> int:
    """Replace ``forces`` of the first n points, first guesses, by the solution; fill ``report``.

    Returns 1, or into how many parts the step has to be divided before: forces are not found then.

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
    trial, tried, stiff = local(3 * n), local(3 * n), local(3 * n)
    points, owners, forces = contacts.points, contacts.owners, contacts.forces
    for c in range(n):
        contact_frame(points[c], frames[c])
        _fill_rows(contacts, later, rates, step, c, frames[c], rows, apart)
        for d in range(3):
            row, k = rows[3 * c + d], 3 * c + d
            now[k], stiff[k] = dot(row, rates), dot(row, contacts.stiff)
            impulse[k] = step * dot(frames[c, d], forces[c])
            to_metric(model, data, row)
            _left_free(model, data, contacts, row)
    for i in range(3 * n):
        for j in range(i + 1):
            coupling[i, j] = dot_rows(rows, i, j)
            coupling[j, i] = coupling[i, j]
    laws, report, impacts, depths = contacts.laws, contacts.report, local_whole(n), local(n)
    for c in range(n):
        before = max(points[c, 6], 0.0)
        report.energy_before += 0.5 * laws[owners[c], STIFFNESS] * before * before
        depths[c] = _depth(contacts, c, now[3 * c], step, True)
    put(trial, impulse)
    add_scaled(stiff, 1.0, apart)
    fastest = find_impacts(contacts, stiff, now, depths, coupling, trial, tried, step, impacts)
    parts = parts_of(fastest)
    if parts > 1 and contacts.settings.is_part == 0.0:
        return parts
    for c in range(n):
        if impacts[c] == 0:
            depths[c] = _depth(contacts, c, now[3 * c], step, False)
    _solve(
        contacts, apart, now, depths, coupling, slopes, impacts, fastest > 0.0, step, impulse,
        velocity,
    )  # fmt: skip
    for c in range(n):
        k, stiffness = 3 * c, laws[owners[c], STIFFNESS]
        way = -0.5 * step * (now[k] + velocity[k]) if impacts[c] != 0 else -step * velocity[k]
        left = max(depths[c] + way, 0.0)
        report.energy += 0.5 * stiffness * left * left
        forces[c][:] = 0.0
        for d in range(3):
            for i in range(3):
                forces[c, i] += frames[c, d, i] * impulse[3 * c + d] / step
    return 1


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
    parting[:] = 0.0
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
