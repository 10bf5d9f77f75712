"""Fixed-step integration on the configuration manifold, without closures' drift (see projection).

Runge–Kutta stages live in local coordinates θ around the step's start, q = q₀ ⊕ θ, whose rate is
θ̇ = J_r(θ)⁻¹ v with J_r the right Jacobian of ⊕ (Munthe-Kaas); on vector-space joints θ̇ = v.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.mechanism.model import Array


@dataclass(frozen=True, slots=True)
class Rates:
    """What the equations of motion give at a stage: v̇, and two powers to be summed (W)."""

    acceleration: Array
    power_in: float
    power_lost: float


Motion = Callable[[Array, Array], Rates]


@dataclass(frozen=True, slots=True)
class Advance:
    """A step's outcome before projection: state, and work done and energy lost in it (J)."""

    q: Array
    v: Array
    work_in: float
    energy_lost: float


Integrator = Callable[[pin.Model, Motion, Array, Array, float], Advance]


def rk4(model: pin.Model, motion: Motion, q: Array, v: Array, period: float) -> Advance:
    """Classical Runge–Kutta of order 4; the two energies are integrated with the same weights."""
    weights = (1.0, 2.0, 2.0, 1.0)
    fractions = (0.0, 0.5, 0.5, 1.0)
    turn = np.zeros_like(v)
    accel = np.zeros_like(v)
    total_turn, total_accel = np.zeros_like(v), np.zeros_like(v)
    work = lost = 0.0
    for weight, fraction in zip(weights, fractions, strict=True):
        step = fraction * period
        theta = step * turn
        speed = v + step * accel
        rates = motion(pin.integrate(model, q, theta), speed)
        accel = rates.acceleration
        turn = _local_rate(model, q, theta, speed)
        total_turn += weight * turn
        total_accel += weight * accel
        work += weight * rates.power_in
        lost += weight * rates.power_lost
    sixth = period / 6.0
    return Advance(
        np.asarray(pin.integrate(model, q, sixth * total_turn)),
        v + sixth * total_accel,
        sixth * work,
        sixth * lost,
    )


def semi_implicit_euler(
    model: pin.Model, motion: Motion, q: Array, v: Array, period: float
) -> Advance:
    """Velocity first, then position with the new velocity: order 1, one evaluation a step."""
    rates = motion(q, v)
    new_v = v + period * rates.acceleration
    new_q = np.asarray(pin.integrate(model, q, period * new_v))
    return Advance(new_q, new_v, period * rates.power_in, period * rates.power_lost)


INTEGRATORS: dict[str, Integrator] = {"rk4": rk4, "semi_implicit_euler": semi_implicit_euler}


def _local_rate(model: pin.Model, q: Array, theta: Array, speed: Array) -> Array:
    if model.nq == model.nv:
        return speed
    right_jacobian = pin.dIntegrate(model, q, theta, pin.ArgumentPosition.ARG1)
    return np.asarray(np.linalg.solve(np.atleast_2d(right_jacobian), speed))
