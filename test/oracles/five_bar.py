# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The five-bar in its two independent coordinates, the angles of links 1 and 2.

Lagrange's equations of the second kind: the loop is solved, not cut. With α̇ = R [α̇₁ α̇₂] of all four
links, T = ½ α̇₁₂ᵀ M α̇₁₂, and at rest a wrench F_j at a point of a link accelerates another one by
X_ij F_j = J_i M⁻¹ J_jᵀ F_j.
"""

from __future__ import annotations

import numpy as np

from oracles.bars import dynamics
from oracles.planar_linkages import INERTIAS, LENGTHS, MASSES, PIVOT
from oracles.planar_loops import Loop

Array = np.ndarray


class FiveBar:
    """The linkage at the angles of links 1 and 2 from x, rad; links 3 and 4 bent outwards.

    Attributes:
        angles: of all links from x, rad.
        starts: (4, 2) where each link starts, m.
        mass: (2, 2) M.
    """

    def __init__(self, one: float, two: float) -> None:
        loop, still = Loop(LENGTHS, MASSES, INERTIAS, PIVOT), np.zeros(4)
        self.angles = loop.angles(np.array([one, two]))
        ends = np.cumsum(LENGTHS * np.exp(1j * self.angles))
        starts = np.append(0.0, ends[:-1])
        self.starts = np.column_stack((starts.real, starts.imag))
        self._bars, (self._rates, _) = loop.bars, loop.along(self.angles, still)
        inertia, _ = dynamics(self._bars, self.angles, still)
        self.mass = self._rates.T @ inertia @ self._rates

    def jacobian(self, link: int) -> Array:
        """Return the (3, 2) Jacobian of the middle of a link, counted from 0: x, y, rotation."""
        moved = self._bars[link].centre.jacobian(self.angles) @ self._rates
        return np.vstack([moved.real, moved.imag, self._rates[link]])

    def coupling(self, one: int, other: int) -> Array:
        """Return X_ij (3, 3) of the middles of two links: 1/kg, 1/(kg m) and 1/(kg m²)."""
        return self.jacobian(one) @ np.linalg.solve(self.mass, self.jacobian(other).T)

    def compliance(self, held: int, line: float, turn: float, pushed: int) -> Array:
        """Return how a link's middle yields (3, 3), m and rad per N and N m, at rest.

        Args:
            held: link whose middle is held by a spring.
            line: N/m, of the spring.
            turn: N m/rad, likewise.
            pushed: link whose middle is pushed.
        """
        at, there = self.jacobian(held), self.jacobian(pushed)
        spring = at.T @ np.diag([line, line, turn]) @ at
        return there @ np.linalg.solve(spring, there.T)

    def balanced(self, link: int, line: int) -> Array:
        """Return the wrench (3,) at a link's middle that is a unit force along another link."""
        direction = np.array([np.cos(self.angles[line]), np.sin(self.angles[line])])
        middle = self._bars[link].centre.at(self.angles)
        x, y = self.starts[line] - (middle.real, middle.imag)
        return np.array([*direction, x * direction[1] - y * direction[0]])
