# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Impacts: the law at points of contact whose normal motion is more than that of a body at rest.

Forces that are implicit in the rates at a step's end hold points at rest; these damp by k h, which
prevents ringing at any k, and also every rebound. A point that approaches, rebounds, or oscillates
about its equilibrium, faster than its load accelerates it in two steps, or whose oscillation the
step resolves, obeys the law by the mean over the step instead. With y⁺ = y - h (v_n + v_n⁺) / 2,
the integrator's rule for positions, and y₊ = max(0, y) along the straight line between both depths,

    λ_n = max(0, k ȳ + (d θ + χ k ȳ) (y⁺ - y) / h),      ȳ the mean of y₊, θ the share with y > 0

The spring then takes exactly the energy that the motion loses, and dampers only dissipate: no
energy is made at any stiffness, mass or step (T16b of docs/derivations.md). To resolve rebounds,
steps are divided until (h ω)² of the points is below ``RESOLVED``.

Forces at all points of contact at once: Newton's rule on the law, with its corners.

The law at a point is a fixed point: its impulse u, changed by the error of the rates and projected
onto the allowed impulses, stays u:

    u_n = max(0, u_n - (w_n + C u_n - b) / (g + C)),      u_t = on a disk of μ u_n (u_t - w_t / H)

with g and H the effect of u on the point's own rates; C and b are the spring's and the damper's.
Newton's rule finds the root in a few rounds where points keep sticking or sliding. Where many
points hold one body G is singular: forces may act against each other across the body, and their
size is undetermined. So a term of 1e-8 H pulls tangential impulses towards zero, or towards those
found before. T19 of docs/derivations.md.
"""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.compilation import inner, local, local_whole, put
from hapticmech_ros.contact.layout import COULOMB, DAMPING, DISSIPATION, STIFFNESS, Contacts
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.small_matrices import dot_with_row, solve_in_place

# Of a point: effect of its push on its rate, 1/kg; C; b, m/s; μ; largest effect of friction.
OWN, GIVE, PUSH, FRICTION, ACROSS, SCALE_VALUES = 0, 1, 2, 3, 4, 5
# Share of H in the term that determines friction.
HELD_SHARE = 1e-8
MOST_ROUNDS = 12
# Newton's steps are halved down to here until the error decreases.
LEAST_STEP = 0.1


@inner
def _pushed_on(
    c: int, scales: Array, held: Array, share: float, impulse: Array, velocity: Array, out: Array
) -> float:
    """Put a point's impulse, changed by its error, into ``out``; return μ u_n."""
    k, across = 3 * c, scales[c, ACROSS]
    own, give = scales[c, OWN], scales[c, GIVE]
    wrong = velocity[k] + give * impulse[k] - scales[c, PUSH]
    out[0] = impulse[k] - wrong / (own + give)
    for i in range(k + 1, k + 3):
        out[i - k] = 0.0
        if across > 0.0:
            away = velocity[i] + share * across * (impulse[i] - held[i])
            out[i - k] = impulse[i] - away / (across * (1.0 + share))
    return float(scales[c, FRICTION] * max(impulse[k], 0.0))


@inner
def mismatch(
    scales: Array, held: Array, share: float, impulse: Array, velocity: Array, off: Array
) -> tuple[float, float]:
    """Fill ``off`` with each impulse's error; return the largest, m/s, and Σ of squares.

    Args:
        scales: (n, 5).
        held: (3 n,) impulses that friction is pulled to.
        share: of H, by which it is.
        impulse: (3 n,) N s.
        velocity: (3 n,) rates of the points with them, m/s.
        off: (3 n,) to fill, N s.
    """
    out, worst, squares = local(3), 0.0, 0.0
    for c in range(scales.shape[0]):
        k = 3 * c
        most = _pushed_on(c, scales, held, share, impulse, velocity, out)
        length = np.sqrt(out[1] * out[1] + out[2] * out[2])
        back = 1.0 if length <= most else most / length
        off[k] = impulse[k] - max(out[0], 0.0)
        off[k + 1] = impulse[k + 1] - back * out[1]
        off[k + 2] = impulse[k + 2] - back * out[2]
        for i in range(3):
            size = abs(off[k + i]) * (scales[c, OWN] if i == 0 else scales[c, ACROSS])
            worst, squares = max(worst, size), squares + size * size
    return float(worst), float(squares)


@inner
def _slopes(
    scales: Array,
    held: Array,
    coupling: Array,
    impulse: Array,
    velocity: Array,
    slopes: Array,
    acts: Array,
) -> None:
    """Fill ``slopes`` with the derivatives of the errors by impulses, row by row.

    ``acts`` (3 n,) becomes 1 where a row is not one of the identity, 0 where it is: there no force
    acts.
    """
    out, size = local(3), impulse.size
    for c in range(scales.shape[0]):
        k, give, across = 3 * c, scales[c, GIVE], scales[c, ACROSS] * (1.0 + HELD_SHARE)
        total = scales[c, OWN] + give
        most = _pushed_on(c, scales, held, HELD_SHARE, impulse, velocity, out)
        length = np.sqrt(out[1] * out[1] + out[2] * out[2])
        for i in range(k, k + 3):
            acts[i] = 0
            slopes[i][:] = 0.0
            slopes[i, i] = 1.0
        if out[0] > 0.0:
            acts[k] = 1
            for j in range(size):
                slopes[k, j] = coupling[k, j] / total
            slopes[k, k] += give / total
        if across <= 0.0 or most <= 0.0:
            continue
        acts[k + 1] = acts[k + 2] = 1
        slides = length > most
        # The projection of a change of u_t - w_t / H onto the disk: all, or its part along the rim.
        share = most / length if slides else 1.0
        first, second = (out[1] / length, out[2] / length) if slides else (0.0, 0.0)
        xx, yy = share * (1.0 - first * first), share * (1.0 - second * second)
        xy = -share * first * second
        for j in range(size):
            one, two = -coupling[k + 1, j] / across, -coupling[k + 2, j] / across
            if j == k + 1:
                one += 1.0 / (1.0 + HELD_SHARE)
            if j == k + 2:
                two += 1.0 / (1.0 + HELD_SHARE)
            slopes[k + 1, j] -= xx * one + xy * two
            slopes[k + 2, j] -= xy * one + yy * two
        slopes[k + 1, k] -= scales[c, FRICTION] * first
        slopes[k + 2, k] -= scales[c, FRICTION] * second


@inner
def _step(slopes: Array, acts: Array, off: Array, change: Array, places: Array) -> bool:
    """Fill ``change`` with Newton's step; return whether there is one. ``slopes`` is used up."""
    size = 0
    for i in range(off.size):
        change[i] = 0.0
        if acts[i] == 0:
            change[i] = -off[i]
        else:
            places[size] = i
            size += 1
    wanted = local(size)
    for r in range(size):
        i = places[r]
        wanted[r] = -off[i] - dot_with_row(slopes, i, change)
        # Places grow: no entry is overwritten before it is read.
        for s in range(size):
            slopes[r, s] = slopes[i, places[s]]
    if not solve_in_place(slopes, wanted, size):
        return False
    for r in range(size):
        change[places[r]] = wanted[r]
    return True


@inner
def put_velocity(apart: Array, coupling: Array, impulse: Array, velocity: Array) -> None:
    """Fill ``velocity`` with the rates of the points under impulses: w_free + G u."""
    for i in range(impulse.size):
        velocity[i] = apart[i] + dot_with_row(coupling, i, impulse)


@inner
def newton(
    scales: Array,
    apart: Array,
    coupling: Array,
    held: Array,
    impulse: Array,
    velocity: Array,
    tolerance: float,
    slopes: Array,
) -> bool:
    """Bring impulses nearer to the law, in place; return whether Newton's rule converged.

    See the head of this file.

    Args:
        scales: (n, 5).
        apart: (3 n,) rates of the points without impulses, m/s.
        coupling: (3 n, 3 n) G, 1/kg.
        held: (3 n,) impulses that friction is held at, N s.
        impulse: (3 n,) N s.
        velocity: (3 n,) with them, m/s.
        tolerance: m/s at which to stop.
        slopes: (3 n, 3 n) to work in.
    """
    size = impulse.size
    off, change = local(size), local(size)
    acts, places = local_whole(size), local_whole(size)
    tried, there = local(size), local(size)
    worst, squares = mismatch(scales, held, HELD_SHARE, impulse, velocity, off)
    rounds = 0
    while rounds < MOST_ROUNDS and worst > tolerance:
        rounds += 1
        _slopes(scales, held, coupling, impulse, velocity, slopes, acts)
        if not _step(slopes, acts, off, change, places):
            break
        step, before = 1.0, squares
        while step > LEAST_STEP:
            for i in range(size):
                tried[i] = impulse[i] + step * change[i]
            put_velocity(apart, coupling, tried, there)
            worst, squares = mismatch(scales, held, HELD_SHARE, tried, there, off)
            if squares < before:
                break
            step *= 0.5
        if not squares < before:
            break
        put(impulse, tried)
        put(velocity, there)
    for k in range(0, size, 3):
        impulse[k] = max(impulse[k], 0.0)
    put_velocity(apart, coupling, impulse, velocity)
    return bool(worst <= tolerance)


# A point rests while its rate, and that of its oscillation, are below its load's acceleration over
# so many steps; without a load, below a rate (m/s) too slow for an impact.
AT_REST, SLOWEST = 2.0, 1e-3
# (h ω)² up to which a step resolves an impact: a contact of π / ω takes 31 steps or more.
RESOLVED = 0.01
# A step is divided into so many at most; that is too few where more than the second number would be
# needed: (h ω)² of a part is then above 0.3, and rebounds are off by more than 2 %.
MOST_PARTS, TOO_MANY_PARTS = 256, 1400
# Rate (m/s) at which a point that is not reached in a step would have to arrive to be pushed.
NEVER = 1e30


@inner
def find_impacts(
    contacts: Contacts,
    apart: Array,
    now: Array,
    depths: Array,
    coupling: Array,
    impulse: Array,
    velocity: Array,
    step: float,
    impacts: Array,
) -> float:
    """Mark the points that impact, and return the largest (h ω)² of those that a step reaches.

    Args:
        contacts: with ``points``, ``owners`` and ``laws``.
        apart: (3 n,) rates of the points at the step's end without contacts, by accelerations at
            its start, m/s, normal ones first.
        now: (3 n,) at its start, m/s.
        depths: (n,) at its start, m.
        coupling: (3 n, 3 n) effect of impulses on rates, 1/kg.
        impulse: (3 n,) of the step before, N s: friction keeps its value; replaced.
        velocity: (3 n,) to work in.
        step: h, s.
        impacts: (n,) to fill with 1 and 0.

    Returns:
        0 if none is reached. ω² is bounded by the row sums of G K, in 1/s².
    """
    n, laws, owners, fastest = depths.size, contacts.laws, contacts.owners, 0.0
    for c in range(n):
        impulse[3 * c] = step * laws[owners[c], STIFFNESS] * max(depths[c], 0.0)
    put_velocity(apart, coupling, impulse, velocity)
    for c in range(n):
        k, impacts[c] = 3 * c, 0
        square = laws[owners[c], STIFFNESS] * coupling[k, k]
        if not square > 0.0:
            continue
        rate = (velocity[k] - now[k]) / step
        swing = now[k] * now[k] + rate * rate / square
        slow = max(AT_REST * abs(apart[k] - now[k]), SLOWEST)
        # With forces half a step ahead, a point gains energy on its way in, and loses it on its way
        # out: an oscillating point comes to rest on its way out, and makes no energy.
        if now[k] < 0.0:
            slow *= 0.5
        if swing <= slow * slow and step * step * square > RESOLVED:
            continue
        impacts[c] = 1
        depth = contacts.points[c, 6]
        end = max(depths[c] - 0.5 * step * (now[k] + apart[k]), depth - step * apart[k])
        if max(depth, depths[c], end) > 0.0:
            total = 0.0
            for j in range(n):
                total += abs(coupling[k, 3 * j]) * laws[owners[j], STIFFNESS]
            fastest = max(fastest, step * step * total)
    return float(fastest)


@inner
def parts_of(fastest: float) -> int:
    """Return into how many parts a step should be divided, for the largest (h ω)² of its points."""
    if fastest <= RESOLVED:
        return 1
    return math.ceil(min(math.sqrt(fastest / RESOLVED), 2.0 * TOO_MANY_PARTS))


@inner
def mean_push(law: Array, depth: float, way: float, step: float) -> tuple[float, float]:
    """Return λ_n, N, of a point that moves on from a depth by ``way``, m, and its slope, N/m.

    Without its limit: it may be below 0.
    """
    end, stiffness = depth + way, law[STIFFNESS]
    # ȳ and its slope; the part of ``way`` below the surface, and its slope.
    if depth <= 0.0 and end <= 0.0:
        return 0.0, 0.0
    if depth >= 0.0 and end >= 0.0:
        mean, slope, below, joins = 0.5 * (depth + end), 0.5, way, 1.0
    elif depth < 0.0:
        share = end / way
        mean, slope, below, joins = 0.5 * end * share, share - 0.5 * share * share, end, 1.0
    else:
        share = -depth / way
        mean, slope, below, joins = 0.5 * depth * share, 0.5 * share * share, -depth, 0.0
    growth = law[DISSIPATION] * stiffness / step
    push = stiffness * mean + law[DAMPING] * below / step + growth * mean * way
    return push, stiffness * slope + law[DAMPING] * joins / step + growth * (mean + slope * way)


@inner
def fill_impact_scales(
    c: int,
    law: Array,
    depth: float,
    way: float,
    rate: float,
    step: float,
    coupling: Array,
    scales: Array,
) -> None:
    """Fill a point's row of ``scales`` for an impact, linearised about a motion ``way`` (m)."""
    k = 3 * c
    push, slope = mean_push(law, depth, way, step)
    scales[c, OWN], scales[c, FRICTION] = coupling[k, k], law[COULOMB]
    if slope > 0.0:
        scales[c, GIVE] = 2.0 / (step * step * slope)
        scales[c, PUSH] = 2.0 * (push / slope - way) / step - rate
    else:
        scales[c, GIVE], scales[c, PUSH] = 0.0, -NEVER
    fill_across(c, coupling, scales)


@inner
def fill_across(c: int, coupling: Array, scales: Array) -> None:
    """Fill the largest effect of a point's friction on its own rates, 1/kg."""
    k = 3 * c
    p, q, r = coupling[k + 1, k + 1], coupling[k + 1, k + 2], coupling[k + 2, k + 2]
    scales[c, ACROSS] = 0.5 * (p + r) + math.sqrt(0.25 * (p - r) * (p - r) + q * q)
