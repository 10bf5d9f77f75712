# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Slider-crank, four-bar and five-bar in as many coordinates as they have freedoms.

Bars of a chain have absolute angles theta. The first n are the coordinates u, the last close the
loop by a triangle; theta' = T u' and theta'' = T u'' + gamma follow from the closed loop, and
T^T M T u'' = T^T (f - M gamma).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from oracles.bars import Bar, Place, arm, chained, dynamics
from oracles.kinematics import Document
from oracles.odes import solve
from oracles.planar_linkages import chain, elbow, pin_end, relative_angles
from oracles.running import with_start

Array = np.ndarray


@dataclass(frozen=True)
class Loop:
    """Uniform bars of a chain from the origin, whose end is pinned, or slides along the x axis.

    Attributes:
        lengths, masses, inertias: per bar, m, kg, kg m^2 about the middle.
        pivot: m, where the end is pinned; None if it carries a slider instead.
        slider: kg.
        side: +1 or -1, to which side the last two bars bend; slider: +1 is ahead of the crank.
        gravity: m/s^2, along y.
        damping: N m s/rad, of the joints between bars and of the one at the origin.
    """

    lengths: Array
    masses: Array
    inertias: Array
    pivot: Array | None
    slider: float = 0.0
    side: int = 1
    gravity: float = 0.0
    damping: float = 0.0

    @property
    def freedoms(self) -> int:
        """Number of coordinates."""
        return len(self.lengths) - (1 if self.pivot is None else 2)

    def angles(self, u: Array) -> Array:
        """Return all absolute angles, closed by a triangle."""
        tip = complex((self.lengths[: u.size] * np.exp(1j * u)).sum())
        if self.pivot is None:
            last = float(np.arcsin(-tip.imag / self.lengths[-1]))
            return np.append(u, last if self.side > 0 else np.pi - last)
        base = np.array([tip.real, tip.imag])
        first, last = self.lengths[-2:]
        if not abs(first - last) < np.hypot(*(self.pivot - base)) < first + last:
            raise ArithmeticError("the last two bars are in line: coordinates end here")
        return np.append(u, elbow(base, first, last, self.pivot, self.side))

    def along(self, theta: Array, rates: Array) -> tuple[Array, Array]:
        """Return T (bars, n) and gamma (bars,): the loop differentiated once and twice."""
        jacobian, bias = self._end.jacobian(theta), self._end.bias(theta, rates)
        rows, rest = np.stack((jacobian.imag, jacobian.real)), np.array([bias.imag, bias.real])
        n = self.freedoms
        rows, rest = rows[: theta.size - n], rest[: theta.size - n]
        change, drift = np.eye(theta.size, n), np.zeros(theta.size)
        change[n:] = -np.linalg.solve(rows[:, n:], rows[:, :n])
        drift[n:] = -np.linalg.solve(rows[:, n:], rest)
        return change, drift

    def acceleration(self, u: Array, speed: Array) -> Array:
        """Return u'' (n,)."""
        theta = self.angles(u)
        change, _ = self.along(theta, np.zeros(theta.size))
        rates = change @ speed
        _, drift = self.along(theta, rates)
        inertia, force = dynamics(self.bars, theta, rates, 1j * self.gravity)
        relative = np.eye(theta.size) - np.eye(theta.size, k=-1)
        force -= self.damping * relative.T @ relative @ rates
        return np.linalg.solve(change.T @ inertia @ change, change.T @ (force - inertia @ drift))

    def motion(self, u: Array, speed: Array, times: Sequence[float]) -> Array:
        """Return the absolute angles (times, bars) from a start (u, u')."""

        def rates(_: float, state: Array) -> Array:
            return np.append(state[u.size :], self.acceleration(state[: u.size], state[u.size :]))

        states = solve(rates, np.append(u, speed), times)
        return np.array([self.angles(state[: u.size]) for state in states])

    def document(self, u: Array, speed: Array) -> Document:
        """Return the same as a scene document: joints turn by relative angles, a slider by x."""
        theta = self.angles(u)
        rates = self.along(theta, np.zeros(theta.size))[0] @ speed
        q, v = relative_angles(theta), np.diff(rates, prepend=0.0)
        document = chain(self.lengths, self.masses, self.inertias, self.gravity, self.damping)
        if self.pivot is not None:
            return with_start(pin_end(document, self.pivot), q, v)
        q, v = (
            np.append(q, self._end.at(theta).real),
            np.append(v, (self._end.jacobian(theta) @ rates).real),
        )
        return with_start(_with_slider(document, self.slider), q, v)

    @property
    def _end(self) -> Place:
        turns = np.eye(len(self.lengths))
        return chained([arm(a, row) for a, row in zip(self.lengths, turns, strict=True)])

    @property
    def bars(self) -> list[Bar]:
        """Bars of the chain, and the slider."""
        turns = np.eye(len(self.lengths))
        bars, before = [], []
        for length, mass, inertia, row in zip(
            self.lengths, self.masses, self.inertias, turns, strict=True
        ):
            centre = chained([*before, arm(length / 2.0, row)])
            bars.append(Bar(float(mass), float(inertia), centre, row))
            before.append(arm(length, row))
        # A slider does not turn; closed, its end moves along x only.
        return [*bars, Bar(self.slider, 0.0, chained(before), 0.0 * turns[0])]


def _with_slider(document: Document, mass: float) -> Document:
    joint = {"name": "slide", "type": "prismatic", "axis": [1.0, 0.0, 0.0]}
    inertial = {"mass": mass, "inertia": dict.fromkeys(("ixx", "iyy", "izz"), 0.0)}
    slider = {"name": "slider", "parent": "world", "joint": joint, "inertial": inertial}
    document["links"].append(slider)
    last = document["operational_points"][-2]
    ends = {"a": {"link": last["link"], "origin": last["origin"]}, "b": {"link": "slider"}}
    return document | {"closures": [{"name": "pin", "kind": "planar_pin", **ends}]}
