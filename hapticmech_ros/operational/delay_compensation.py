# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Delay compensation: X and a_0 of an operational point for a loop with a delay τ.

What springs, dampers and weight do at a state reaches the hand after τ; a force takes effect during
that time. So the state is predicted: q' is where the mechanism will be after τ at its rates, and
with the accelerations v̇ of then, rates v_b a time τ_b ago, and r = τ / τ_b,

    v(τ) = v + r² / (1 + 2 r) (v - v_b) + h v̇,      h = τ (1 + r) / (1 + 2 r)
    q(τ) = q' ⊕ k v̇,                                k = τ² / 2

which is the backward differentiation formula of second order for v. With the stiffness K and the
damping C of springs and dampers

    X_τ = J (D + h C + k K)⁻¹ Jᵀ
    a_τ = a_0(q', v) - J (D + h C + k K)⁻¹ ((h C + k K) v̇_0(q', v) + C r² / (1 + 2 r) (v - v_b))

where v̇_0 are the accelerations at zero hand wrench, and closures hold on as they do in X. That is
a step of length τ, implicit in springs and dampers: X_τ F + a_τ is the acceleration by then, also
if F varies meanwhile, with an error of third order in τ, but for what Coriolis forces change as v
does, and for what X does on the way. Where v_b is not known, as at the start or after a closure has
closed, r is 0 and k is τ², and the error is of second order. Both are found in the directions of X
alone: with rows ζ_i = n_iᵀ J D⁻¹ / s_i, closures kept, which are orthonormal in the mass metric,
and B = 1 + ζ (h C + k K) ζᵀ, which is never smaller than 1,

    X_τ = Z B⁻¹ Zᵀ,  a_τ = a_0(q', v) - Z B⁻¹ ζ ((h C + k K) v̇_0(q', v) + ...)

with columns I_ℓ⁻¹ n_i s_i in Z. What joints that move without the point add to it is left out of
B, which is exact to first order too; and B being no smaller than 1, no gain is larger than X's.

To second order q' = q ⊕ (τ v - ½ τ² D⁻¹Wᵀ(W D⁻¹Wᵀ)⁺ Ẇv) is on the closures. Next to a singular
position, where what is left of φ there turns free rates by more than 1 %, q' is q.
"""

from __future__ import annotations

from typing import NamedTuple

from hapticmech_ros.arrays import Array


class CompensatedResponse(NamedTuple):
    """X_τ and a_τ, which replace X and a_0 in a loop with delay; world axes, at the point.

    Attributes:
        inverse_inertia: (6, 6) X_τ; 1/kg, 1/(kg m), 1/(kg m²).
        free_acceleration: (6,) a_τ, m/s² and rad/s².
    """

    inverse_inertia: Array
    free_acceleration: Array
