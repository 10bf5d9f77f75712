# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Planar bars by hand: points are sums of arms in the complex plane, derivatives term by term.

A point is z = c + sum_k a_k exp(i s_k), s_k = S_k q. So dz/dq = sum_k i a_k exp(i s_k) S_k and at
q'' = 0 z'' = -sum_k a_k exp(i s_k) (S_k q')^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Place:
    """A point of a bar: arms a (k,) complex, m, at angles turns (k, n) q, from a fixed point."""

    arms: Array
    turns: Array
    fixed: complex = 0.0

    def __add__(self, other: Place) -> Place:
        arms = np.concatenate((self.arms, other.arms))
        return Place(arms, np.vstack((self.turns, other.turns)), self.fixed + other.fixed)

    def __sub__(self, other: Place) -> Place:
        return self + Place(-other.arms, other.turns, -other.fixed)

    def at(self, q: Array) -> complex:
        """Return z, m."""
        return complex(self.fixed + self._turned(q).sum())

    def jacobian(self, q: Array) -> Array:
        """Return dz/dq (n,), complex."""
        return 1j * self._turned(q) @ self.turns

    def bias(self, q: Array, v: Array) -> complex:
        """Return z'' at q'' = 0, m/s^2."""
        return complex(-self._turned(q) @ (self.turns @ v) ** 2)

    def _turned(self, q: Array) -> Array:
        return self.arms * np.exp(1j * (self.turns @ q))


def arm(length: complex, turn: Sequence[float], fixed: complex = 0.0) -> Place:
    """Return the place at ``length`` along a bar that turns by ``turn`` times q."""
    return Place(np.array([length], dtype=complex), np.array([turn], dtype=float), fixed)


def chained(places: Sequence[Place]) -> Place:
    """Return the sum of arms."""
    return reduce(Place.__add__, places)


@dataclass(frozen=True)
class Bar:
    """Mass kg, inertia about the centre kg m^2, centre of mass, and turn (n,): angle = turn q."""

    mass: float
    inertia: float
    centre: Place
    turn: Array


def dynamics(
    bars: Sequence[Bar], q: Array, v: Array, gravity: complex = 0.0
) -> tuple[Array, Array]:
    """Return M (n, n) and f (n,) of M q'' = f: f are inertial forces at q'' = 0 and weights."""
    inertia, force = np.zeros((q.size, q.size)), np.zeros(q.size)
    for bar in bars:
        turn, jacobian = np.asarray(bar.turn, dtype=float), bar.centre.jacobian(q)
        inertia += bar.mass * np.outer(jacobian.conj(), jacobian).real
        inertia += bar.inertia * np.outer(turn, turn)
        force += bar.mass * (jacobian.conj() * (gravity - bar.centre.bias(q, v))).real
    return inertia, force
