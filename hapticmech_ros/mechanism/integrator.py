"""Fixed-step integration on the configuration manifold, without closures' drift (see projection).

Runge–Kutta stages live in local coordinates θ around the step's start, q = q₀ ⊕ θ, whose rate is
θ̇ = J_r(θ)⁻¹ v with J_r the right Jacobian of ⊕ (Munthe-Kaas); on vector-space joints θ̇ = v.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.model import Array


class Rates(NamedTuple):
    """What the equations of motion give at a stage: v̇, and two powers to be summed (W)."""

    acceleration: Array
    power_in: float
    power_lost: float


class Resistance(Protocol):
    """Springs and dampers linearised at a step's start, with what they do to a velocity's rate.

    Attributes:
        stiffness, damping: (nv, nv) K and C.
        slope: (nv, nv) S = γh C + (γh)² K.
    """

    stiffness: Array
    damping: Array
    slope: Array

    def answer(self, force: Array) -> Array:
        """Return x (nv,) with (D + S) x + Wᵀμ = force and W x = 0."""


class Motion(Protocol):
    """The equations of motion, forces from outside held."""

    def __call__(self, q: Array, v: Array) -> Rates:
        """Return the rates at a stage."""

    def resistance(self, q: Array, v: Array, period: float, reach: float) -> Resistance | None:
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
    return Advance(new_q, new_v, change, period * rates.power_in, period * rates.power_lost)


def local_rate(model: pin.Model, q: Array, theta: Array, speed: Array) -> Array:
    """Return θ̇ (nv,) = J_r(θ)⁻¹ speed at q ⊕ θ."""
    right_jacobian = pin.dIntegrate(model, q, theta, pin.ArgumentPosition.ARG1)
    return np.asarray(np.linalg.solve(np.atleast_2d(right_jacobian), speed))
