# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Torques within the motors' limits: what is given up, in which order, and that it is told."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError


class Limited(NamedTuple):
    """Torques within limits.

    Attributes:
        torque: (nv,) N m or N.
        task: share of the task's torques that is left, 0 to 1.
        null: share of the null space's, 0 to 1.
        overloaded: whether the bias alone exceeds a limit.
    """

    torque: Array
    task: float
    null: float
    overloaded: bool

    @property
    def saturated(self) -> bool:
        """Whether anything was given up."""
        return self.overloaded or self.task < 1.0 or self.null < 1.0


def checked_limits(limits: Array, nv: int) -> Array:
    """Return limits (nv,), infinite ones where none is given.

    Args:
        limits: (nv,) N m or N; empty: no limits.
        nv: number of joint rates.

    Raises:
        InvalidInputError: another number of them, or one that is not positive.
    """
    given = np.asarray(limits, dtype=float)
    if given.size == 0:
        return np.full(nv, np.inf)
    if given.shape != (nv,) or not (given > 0.0).all():
        raise InvalidInputError("torque limits", limits, f"must be {nv} positive numbers")
    return given


def limited_torque(bias: Array, task: Array, null: Array, limits: Array) -> Limited:
    """Return bias + α task + β null within limits, with the largest α, then the largest β ≤ 1.

    The task's torques keep their ratios, so that a force keeps its direction, and weight is
    carried as long as any limit allows it.

    Args:
        bias: (nv,) what compensates for weight and speed, N m or N.
        task: (nv,) what moves the operational point.
        null: (nv,) what moves joints in its null space.
        limits: (nv,) largest torques.
    """
    held = np.clip(bias, -limits, limits)
    alpha = _share(held, task, limits)
    torque = held + alpha * task
    beta = _share(torque, null, limits)
    overloaded = bool((held != bias).any())
    return Limited(torque + beta * null, alpha, beta, overloaded)


def _share(start: Array, part: Array, limits: Array) -> float:
    """Return the largest share up to 1 of a part that keeps start + share part within limits."""
    room = np.where(part >= 0.0, limits - start, limits + start)
    tight = np.abs(part) > room
    if not tight.any():
        return 1.0
    return float(np.min(np.maximum(room[tight], 0.0) / np.abs(part[tight])))
