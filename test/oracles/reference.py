# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The motion of a scene to ten digits and more, offline: adaptive steps of high order.

What fixed steps are judged by where no closed form is known. Latching closures stay as they start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.integrate import solve_ivp

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.projection import consistent_initial_state, project
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene

# A segment starts on the closures, in local coordinates of its own. In between, closures keep their
# second derivative at zero, so that they open with the square of the segment's length, s...
SEGMENT = 0.05
# ...and local coordinates turn by this at most, rad: they have a corner at a whole turn.
TURN = 1.0


class ReferenceMotion(NamedTuple):
    """States at given times: q (times, nq) and v (times, nv)."""

    q: Array
    v: Array


def reference_motion(
    scene: Scene,
    times: Sequence[float],
    wrenches: npt.ArrayLike = 0.0,
    tolerance: float = 1e-12,
    stiff: bool = False,
) -> ReferenceMotion:
    """Integrate a scene by DOP853, or by Radau if it is stiff.

    Args:
        scene: its integrator and step are not used.
        times: s, from 0 on, increasing.
        wrenches: (points, 6) held at the operational points, world axes, N and N m; or 0.
        tolerance: of a step, relative and absolute (rad, m and per s); at least 1e-13.
        stiff: whether springs, dampers or stops are much faster than the motion.

    Raises:
        InvalidInputError: times that do not increase, or wrenches of another shape.
        HapticMechError: the solver gave up; ClosureError: a closed loop came apart.
    """
    mechanism = Mechanism(scene)
    points = len(mechanism.point_names)
    held = np.array(wrenches, dtype=float)
    held = np.zeros((points, 6)) + held if held.ndim == 0 else held
    if held.shape != (points, 6):
        raise InvalidInputError("wrenches", held.shape, f"must have shape {(points, 6)}")
    if not np.all(np.diff(np.array([0.0, *times])) >= 0.0) or not np.isfinite(times).all():
        raise InvalidInputError("times", list(times), "must increase from 0 on")
    q, v = consistent_initial_state(mechanism)
    solve = _solver("Radau" if stiff else "DOP853", max(tolerance, 1e-13))
    found, now = [], 0.0
    for time in times:
        while time > now:
            until = min(time, now + _segment(mechanism, v))
            q, v = _through(mechanism, q, v, held, until - now, solve)
            # The last segment must not leave a rest of rounding.
            now = until if time - until > 1e-12 * max(time, 1.0) else time
        found.append((q, v))
    return ReferenceMotion(np.array([q for q, _ in found]), np.array([v for _, v in found]))


Solve = Callable[[Callable[[float, Array], Array], float, Array], Array]


def _solver(method: str, tolerance: float) -> Solve:
    def solve(rates: Callable[[float, Array], Array], duration: float, start: Array) -> Array:
        solved = solve_ivp(rates, (0.0, duration), start, method, rtol=tolerance, atol=tolerance)
        if not solved.success:
            raise HapticMechError(f"the reference motion stopped: {solved.message}")
        return np.asarray(solved.y[:, -1])

    return solve


def _segment(mechanism: Mechanism, v: Array) -> float:
    """Return how long (s) a segment may be that starts with these rates."""
    if mechanism.nq == mechanism.nv:
        return SEGMENT
    return min(SEGMENT, TURN / max(float(np.abs(v).max()), 1e-9))


def _through(
    mechanism: Mechanism, q: Array, v: Array, wrenches: Array, duration: float, solve: Solve
) -> tuple[Array, Array]:
    """Return (q, v) at the end of a segment, on the closures."""
    nv, active, flat = mechanism.nv, mechanism.initially_active, mechanism.nq == mechanism.nv

    def rates(_: float, state: Array) -> Array:
        theta, speed = state[:nv], state[nv:]
        terms = mechanism.evaluate(mechanism.integrate(q, theta), speed, active)
        force = np.zeros(nv)
        for point, wrench in zip(terms.points, wrenches, strict=True):
            force += wrench @ point.jacobian
        turn = speed if flat else local_rate(mechanism.model, q, theta, speed)
        return np.concatenate((turn, terms.acceleration(force)[0]))

    end = solve(rates, duration, np.concatenate((np.zeros(nv), v)))
    projected = project(mechanism, mechanism.integrate(q, end[:nv]), end[nv:], active)
    return projected.q, projected.v


def local_rate(model: pin.Model, q: Array, theta: Array, speed: Array) -> Array:
    """Return θ̇ (nv,) = J_r(θ)⁻¹ speed at q ⊕ θ."""
    right_jacobian = pin.dIntegrate(model, q, theta, pin.ArgumentPosition.ARG1)
    return np.asarray(np.linalg.solve(np.atleast_2d(right_jacobian), speed))
