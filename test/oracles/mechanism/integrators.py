# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The rules of ``mechanism.schemes`` as functions on the manifold, before the projection."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.inertia import dpotrf, dtrsv, singular_inertia
from hapticmech_ros.mechanism.motion import Rates
from hapticmech_ros.mechanism.schemes import (
    COUPLED,
    DIAGONAL,
    REACHED,
    TSITOURAS_REACHED,
    TSITOURAS_WEIGHTS,
    WEIGHTS,
)
from oracles.mechanism.mechanism import ReadableSpace


class Motion(Protocol):
    """The equations of motion, forces from outside held."""

    def __call__(self, q: Array, v: Array) -> Rates:
        """Return the rates at a stage."""

    def resistance(self, q: Array, v: Array, period: float, reach: float) -> Springs | None:
        """Return springs and dampers at a step's start, seen over ``reach`` = γh (s).

        None where there is none of them.
        """


class Advance(NamedTuple):
    """A step's outcome before projection.

    Attributes:
        q, v: the state.
        change: (nv,) q - q₀, in local coordinates.
        work_in, energy_lost: in the step, J.
    """

    q: Array
    v: Array
    change: Array
    work_in: float
    energy_lost: float


Integrator = Callable[[pin.Model, Motion, Array, Array, float], Advance]


def rk4(model: pin.Model, motion: Motion, q: Array, v: Array, period: float) -> Advance:
    """Classical Runge–Kutta of order 4; the two energies are integrated with the same weights."""
    flat = model.nq == model.nv
    rates = motion(q, v)
    turn, accel = v, rates.acceleration
    total_turn, total_accel = turn.copy(), accel.copy()
    work, lost = rates.power_in, rates.power_lost
    for weight, fraction in ((2.0, 0.5), (2.0, 0.5), (1.0, 1.0)):
        step = fraction * period
        theta = step * turn
        turn = v + step * accel
        rates = motion(pin.integrate(model, q, theta), turn)
        accel = rates.acceleration
        if not flat:
            turn = local_rate(model, q, theta, turn)
        total_turn += weight * turn
        total_accel += weight * accel
        work += weight * rates.power_in
        lost += weight * rates.power_lost
    sixth = period / 6.0
    change = sixth * total_turn
    return Advance(
        np.asarray(pin.integrate(model, q, change)),
        v + sixth * total_accel,
        change,
        sixth * work,
        sixth * lost,
    )


def tsit5(model: pin.Model, motion: Motion, q: Array, v: Array, period: float) -> Advance:
    """Tsitouras' rule of order 5, written for any explicit rule by its table."""
    flat = model.nq == model.nv
    turns, gains, powers = [], [], []
    for row in TSITOURAS_REACHED:
        before = row[: len(turns)]
        theta = period * sum(
            (a * k for a, k in zip(before, turns, strict=True)), np.zeros(model.nv)
        )
        speed = v + period * sum(
            (a * k for a, k in zip(before, gains, strict=True)), np.zeros(model.nv)
        )
        rates = motion(np.asarray(pin.integrate(model, q, theta)), speed)
        turns.append(speed if flat or not turns else local_rate(model, q, theta, speed))
        gains.append(rates.acceleration)
        powers.append((rates.power_in, rates.power_lost))
    change = period * (TSITOURAS_WEIGHTS @ np.array(turns))
    work, lost = period * (TSITOURAS_WEIGHTS @ np.array(powers))
    new_q = np.asarray(pin.integrate(model, q, change))
    return Advance(new_q, v + period * (TSITOURAS_WEIGHTS @ np.array(gains)), change, work, lost)


def rk2(model: pin.Model, motion: Motion, q: Array, v: Array, period: float) -> Advance:
    """Explicit midpoint rule, order 2: half of rk4's evaluations, enough at haptic rates.

    On the manifold it needs no correction: θ̇ = v holds to the order of the rule.
    """
    half = 0.5 * period
    rates = motion(q, v)
    speed = v + half * rates.acceleration
    rates = motion(pin.integrate(model, q, half * v), speed)
    change = period * speed
    return Advance(
        np.asarray(pin.integrate(model, q, change)),
        v + period * rates.acceleration,
        change,
        period * rates.power_in,
        period * rates.power_lost,
    )


def semi_implicit_euler(
    model: pin.Model, motion: Motion, q: Array, v: Array, period: float
) -> Advance:
    """Velocity first, then position with the new velocity: order 1, one evaluation a step."""
    rates = motion(q, v)
    new_v = v + period * rates.acceleration
    change = period * new_v
    new_q = np.asarray(pin.integrate(model, q, change))
    # Forces from outside act over the way that there is: with the new velocity.
    work_in = period * motion(q, new_v).power_in if np.isfinite(new_v).all() else np.nan
    return Advance(new_q, new_v, change, work_in, period * rates.power_lost)


class Springs:
    """Springs and dampers linearised at a step's start.

    With P = 1 - U Uᵀ and Ŝ = L⁻¹ S L⁻ᵀ, x = L⁻ᵀ (1 + P Ŝ P)⁻¹ P L⁻¹ force: the factorisation of D
    and W serves, and what is factored anew is never worse than 1 + |Ŝ|.

    Args:
        space: factorisation of D and W.
        stiffness, damping: (nv, nv) K and C, symmetric, positive semi-definite.
        reach: γh, s.

    Raises:
        SingularInertiaError: K or C is not finite.
    """

    def __init__(
        self, space: ReadableSpace, stiffness: Array, damping: Array, reach: float
    ) -> None:
        self.stiffness, self.damping = stiffness, damping
        self.slope = reach * damping + reach**2 * stiffness
        self._space = space
        half = space.without_closure_part(space.to_mass_metric(self.slope))
        free = space.without_closure_part(space.to_mass_metric(half.T))
        self._factor, info = dpotrf(np.eye(len(free)) + free, lower=1)
        if info != 0:
            raise singular_inertia(info - 1)

    def answer(self, force: Array) -> Array:
        """Return x (nv,) with (D + S) x + Wᵀμ = force and W x = 0."""
        space = self._space
        free = space.without_closure_part(space.to_mass_metric(force))
        free = dtrsv(self._factor, free, lower=1)
        return space.from_mass_metric(dtrsv(self._factor, free, lower=1, trans=1))


def linearly_implicit(
    model: pin.Model, motion: Motion, q: Array, v: Array, period: float
) -> Advance:
    """ROS34PW2, order 3. Powers are further components of y, in which J is zero."""
    flat = model.nq == model.nv
    springs = motion.resistance(q, v, period, DIAGONAL * period)
    turns, gains = np.zeros((4, v.size)), np.zeros((4, v.size))
    work, lost = 0.0, 0.0
    for stage, weight in enumerate(WEIGHTS.tolist()):
        reached, coupled = REACHED[stage], COUPLED[stage]
        speed = v + period * (reached @ gains)
        if stage == 0:
            rates, turn = motion(q, v), v
        else:
            theta = period * (reached @ turns)
            rates = motion(pin.integrate(model, q, theta), speed)
            turn = speed if flat else local_rate(model, q, theta, speed)
        turn = turn + period * (coupled @ gains)
        gain = rates.acceleration
        if springs is not None:
            met = springs.stiffness @ (DIAGONAL * turn + coupled @ turns)
            met += springs.damping @ (coupled @ gains)
            gain = gain - springs.answer(springs.slope @ gain + period * met)
        turns[stage], gains[stage] = turn + period * DIAGONAL * gain, gain
        work += weight * rates.power_in
        lost += weight * rates.power_lost
    change = period * (WEIGHTS @ turns)
    return Advance(
        np.asarray(pin.integrate(model, q, change)),
        v + period * (WEIGHTS @ gains),
        change,
        period * work,
        period * lost,
    )


def local_rate(model: pin.Model, q: Array, theta: Array, speed: Array) -> Array:
    """Return θ̇ (nv,) = J_r(θ)⁻¹ speed at q ⊕ θ."""
    right_jacobian = pin.dIntegrate(model, q, theta, pin.ArgumentPosition.ARG1)
    return np.asarray(np.linalg.solve(np.atleast_2d(right_jacobian), speed))


INTEGRATORS: dict[str, Integrator] = {
    "rk4": rk4,
    "tsit5": tsit5,
    "rk2": rk2,
    "semi_implicit_euler": semi_implicit_euler,
    "linearly_implicit": linearly_implicit,
}
