# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Impacts: the law at points of contact whose normal motion is more than that of a body at rest.

What rests is held by forces that are implicit in the rates at a step's end; these damp by k h, so
that nothing rings whatever k is, and no body would rebound. A point that approaches, rebounds, or
swings about where its forces balance, and that faster than its load accelerates it in two steps, or
whose swing the step resolves, obeys the law by the mean over the step instead. With
y⁺ = y - h (v_n + v_n⁺) / 2, which is how positions move, and y₊ = max(0, y) along the straight line
between both depths,

    λ_n = max(0, k ȳ + (d θ + χ k ȳ) (y⁺ - y) / h),      ȳ the mean of y₊, θ the share with y > 0

so that the spring takes exactly what the motion loses, and dampers only take: no energy is made at
any stiffness, mass or step (T16b of docs/derivations.md). How well a rebound is resolved is another
question: steps are divided until (h ω)² of the points is below ``RESOLVED``.
"""

from __future__ import annotations

import math

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner
from hapticmech_ros.contact.layout import COULOMB, DAMPING, DISSIPATION, STIFFNESS, Contacts
from hapticmech_ros.contact.newton_kernels import (
    ACROSS,
    FRICTION,
    GIVE,
    OWN,
    PUSH,
    put_velocity,
)

# A point rests while its rate, and the one of its swing, are below what its load accelerates it to
# in so many steps, and below a rate (m/s) that nobody would call an impact without a load.
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
        coupling: (3 n, 3 n) what impulses do to rates, 1/kg.
        impulse: (3 n,) of the step before, N s: friction is as it was; replaced.
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
        # Held half a step ahead, energy is more where a point goes inwards, and less outwards: what
        # comes to rest does so on its way out, if it swings, and makes none.
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
    """Return λ_n, N, of a point that goes on from a depth by a way, m, and its slope, N/m.

    Without its limit: it may be below 0.
    """
    end, stiffness = depth + way, law[STIFFNESS]
    # ȳ and its slope; what of the way is below the surface, and its slope.
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
    """Fill a point's row of ``scales`` for an impact, linear about a way (m) from its depth on."""
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
    """Fill what friction at a point does to its own rates, at most, 1/kg."""
    k = 3 * c
    p, q, r = coupling[k + 1, k + 1], coupling[k + 1, k + 2], coupling[k + 2, k + 2]
    scales[c, ACROSS] = 0.5 * (p + r) + math.sqrt(0.25 * (p - r) * (p - r) + q * q)
