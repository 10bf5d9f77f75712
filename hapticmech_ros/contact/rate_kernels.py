# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How fast two bodies move against each other where they touch."""

from __future__ import annotations

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import inner, local
from hapticmech_ros.contact.touch_kernels import tangents


@inner
def contact_frame(point: Array, frame: Array) -> None:
    """Put a point's normal and two tangents into the rows of ``frame``."""
    for i in range(3):
        frame[0, i] = point[3 + i]
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
            for i in range(6):
                now[i] += axes[j, i] * rates[j]
                then[i] += later[j, i] * free[j]
    x = point[0] + step * (now[0] + now[4] * centre[2] - now[5] * centre[1])
    y = point[1] + step * (now[1] + now[5] * centre[0] - now[3] * centre[2])
    z = point[2] + step * (now[2] + now[3] * centre[1] - now[4] * centre[0])
    parting[0] += sign * (then[0] + then[4] * z - then[5] * y)
    parting[1] += sign * (then[1] + then[5] * x - then[3] * z)
    parting[2] += sign * (then[2] + then[3] * y - then[4] * x)
