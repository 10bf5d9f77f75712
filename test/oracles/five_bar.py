# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The five-bar in its two independent coordinates, the angles of links 1 and 2.

Lagrange's equations of the second kind: the loop is solved, not cut. With α̇ = R [α̇₁ α̇₂] of all four
links, T = ½ α̇₁₂ᵀ M α̇₁₂, and at rest a wrench F_j at a point of a link accelerates another one by
X_ij F_j = J_i M⁻¹ J_jᵀ F_j.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

LENGTHS = (0.045, 0.045, 0.045, 0.06)
MASSES = (1.0, 1.0, 1.0, 0.5)
INERTIAS = (0.0021, 0.0021, 0.0021, 0.00105)
BASE = np.array([0.09, 0.0])


def along(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])


def across(angle: float) -> Array:
    return np.array([-np.sin(angle), np.cos(angle)])


class FiveBar:
    """The linkage at the angles of links 1 and 2 from x, rad; links 3 and 4 bent outwards.

    Attributes:
        angles: of all links from x, rad.
        starts: (4, 2) where each link starts, m.
        mass: (2, 2) M.
    """

    def __init__(self, one: float, two: float) -> None:
        l1, l2, l3, l4 = LENGTHS
        second = l1 * along(one)
        third = second + l2 * along(two)
        x, y = BASE - third
        reach = np.hypot(x, y)
        three = np.arctan2(y, x) + np.arccos((l3**2 + reach**2 - l4**2) / (2.0 * l3 * reach))
        fourth = third + l3 * along(three)
        four = np.arctan2(*(BASE - fourth)[::-1])
        self.angles = np.array([one, two, three, four])
        self.starts = np.array([[0.0, 0.0], second, third, fourth])
        # l₃ α̇₃ e'(α₃) + l₄ α̇₄ e'(α₄) = -l₁ α̇₁ e'(α₁) - l₂ α̇₂ e'(α₂)
        ends = np.column_stack([l3 * across(three), l4 * across(four)])
        given = np.column_stack([l1 * across(one), l2 * across(two)])
        self._rates = np.vstack([np.eye(2), -np.linalg.solve(ends, given)])
        self.mass = np.zeros((2, 2))
        for link, (mass, inertia) in enumerate(zip(MASSES, INERTIAS, strict=True)):
            jacobian = self.jacobian(link)
            self.mass += jacobian.T @ np.diag([mass, mass, inertia]) @ jacobian

    def jacobian(self, link: int) -> Array:
        """Return the (3, 2) Jacobian of the middle of a link, counted from 0: x, y, rotation."""
        lengths = [*LENGTHS[:link], LENGTHS[link] / 2.0]
        parts = zip(lengths, self.angles, self._rates, strict=False)
        moved = sum(length * np.outer(across(angle), rate) for length, angle, rate in parts)
        return np.vstack([moved, self._rates[link]])

    def free_directions(self, link: int) -> Array:
        """Return an orthonormal basis (3, 2) of the directions in which a link's middle moves."""
        return np.linalg.qr(self.jacobian(link))[0]

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
        direction = along(self.angles[line])
        middle = self.starts[link] + LENGTHS[link] / 2.0 * along(self.angles[link])
        x, y = self.starts[line] - middle
        return np.array([*direction, x * direction[1] - y * direction[0]])
