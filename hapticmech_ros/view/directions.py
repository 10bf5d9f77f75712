# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid and free directions of an operational point, so that they can be drawn.

Columns n_i of the spectrum are unique only where their μ are: any rotation among equal ones will
do, and which one comes out changes from sample to sample. Drawn as they come they would flicker, so
they are turned first: forces are gathered into as few columns as possible.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.operational import OperationalAnalysis


class Direction(NamedTuple):
    """A wrench as shares of the largest ones of unit length in the metric; axes of the world.

    Attributes:
        force: (3,) of length 0 to 1.
        torque: (3,) of length 0 to 1.
    """

    force: Array
    torque: Array


def directions(
    analysis: OperationalAnalysis, count: int
) -> tuple[list[Direction], list[Direction]]:
    """Return rigid directions, ``count`` of them, and free ones: all the others.

    Raises:
        InvalidInputError: count is negative, or more than there are directions.
    """
    wrenches = np.zeros((6, analysis.rows.size))
    wrenches[analysis.rows] = analysis.spectrum.wrenches
    size = wrenches.shape[1]
    if not 0 <= count <= size:
        raise InvalidInputError("count", count, f"must be 0 to {size}")
    # I_ℓ is the sum of all n_i n_iᵀ, so the largest force and torque of a unit wrench are these.
    metric = wrenches @ wrenches.T
    largest_force = np.sqrt(np.linalg.eigvalsh(metric[:3, :3])[-1])
    largest_torque = np.sqrt(np.linalg.eigvalsh(metric[3:, 3:])[-1])
    parts = []
    for columns in (wrenches[:, size - count :], wrenches[:, : size - count]):
        turned = gathered(columns)
        parts.append([Direction(n[:3] / largest_force, n[3:] / largest_torque) for n in turned.T])
    return parts[0], parts[1]


def gathered(columns: Array) -> Array:
    """Return ``columns`` (6, k) turned among themselves, those of the largest force first.

    The forces of the result are perpendicular to each other, and the span is the same.

    Args:
        columns: (6, k) wrenches, forces first, world axes, in any unit.
    """
    if columns.shape[1] < 2:
        return columns
    _, _, turn = np.linalg.svd(columns[:3])
    return np.asarray(columns @ turn.T)
