# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A mechanism as its operational point shows it for small motions: x⁺ = A x + B F, y = C x.

x holds θ and v in coordinates that the closures leave free and that are orthonormal in the mass
metric: q = q_0 ⊕ L⁻ᵀ N θ, v = v_0 + L⁻ᵀ N v', N an orthonormal complement of range(L⁻¹Wᵀ). A and B
are central differences of the simulator's own step, so they have its integrator's errors; C those
of kinematics and analysis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.projection import project
from hapticmech_ros.operational.analysis import Analyser
from hapticmech_ros.operational.results import CompensatedResponse, OperationalAnalysis
from hapticmech_ros.simulation import MechanismState, Simulator

# Of a difference, in √kg m and √kg m/s, and N and N m. Errors are about 1e-9 of it where nothing
# but rounding counts, and its square where something bends.
CHANGE = 1e-5


@dataclass(frozen=True, slots=True)
class LinearSystem:
    """A wrench in, a twist out: x⁺ = A x + B F, V = C x, once a period.

    Attributes:
        period: s.
        step: (n, n) A; x in √kg m and √kg m/s.
        push: (n, 6) B, of F held over the period, N and N m, world axes at the point.
        twist: (6, n) C, of V at the period's start, m/s and rad/s, likewise.
    """

    period: float
    step: Array
    push: Array
    twist: Array

    def admittance(self, frequencies: Array) -> Array:
        """Return C (z - A)⁻¹ B at z = exp(i ω T), (k, 6, 6) complex: V per F, SI, world axes.

        Args:
            frequencies: (k,) Hz.
        """
        turns = np.exp(2j * np.pi * self.period * np.asarray(frequencies, dtype=float))
        one = np.eye(len(self.step))
        answers = [np.linalg.solve(z * one - self.step, self.push) for z in turns]
        return np.array([self.twist @ answer for answer in answers])

    def run(self, external: Array) -> Array:
        """Return twists (k, 6), m/s and rad/s, from rest under wrenches, one a period.

        Args:
            external: (k, 6) N and N m, world axes at the point.
        """
        return self.driven(np.asarray(external, dtype=float) @ self.push.T)

    def driven(self, driven: Array) -> Array:
        """Return twists (k, 6), m/s and rad/s, from rest.

        Args:
            driven: (k, n) B F of each period.
        """
        states = np.zeros((len(driven), len(self.step)))
        for index in range(len(driven) - 1):
            states[index + 1] = self.step @ states[index] + driven[index]
        return np.asarray(states @ self.twist.T)

    @property
    def growth(self) -> float:
        """Largest eigenvalue's size of A; above 1 it is unstable."""
        return float(np.abs(np.linalg.eigvals(self.step)).max())


@dataclass(frozen=True, slots=True)
class LinearPoint(LinearSystem):
    """What one period makes of a mechanism's small deviations: n/2 positions, then velocities.

    Attributes:
        pose: (6, n) of the point, deviation in m and rad, world axes, per deviation.
        acceleration: (6, n) of the point's free acceleration, m/s² and rad/s²: of a_0, or of a_τ
            with delay compensation.
        by_past: (6, n/2) of the same, by the velocities that were ``periods_before`` ago.
        periods_before: how long ago; 0 if those are not known.
        analysis: of the point where the mechanism is linearised.
        compensated: X_τ and a_τ there.
    """

    pose: Array
    acceleration: Array
    by_past: Array
    periods_before: int
    analysis: OperationalAnalysis
    compensated: CompensatedResponse


def linear_point(
    simulator: Simulator,
    state: MechanismState,
    point: str = "",
    compensated_delay: float = 0.0,
    periods_before: int = 0,
) -> LinearPoint:
    """Return the linear model of a mechanism at a state.

    A state at rest that stays so is what it is meant for; of another one it is the tangent there.

    Args:
        simulator: of the mechanism.
        state: where; loops may be closed.
        point: operational point; the first one if empty.
        compensated_delay: τ, s; 0 for none.
        periods_before: how long before a state the rates are that its compensation knows; 0 if none
            are.

    Raises:
        InvalidInputError: unknown point.
        ClosureError: a closed loop came apart.
    """
    return _Differences(simulator, state, point, compensated_delay, periods_before).found()


class _Differences:
    def __init__(
        self,
        simulator: Simulator,
        state: MechanismState,
        point: str,
        compensated_delay: float,
        periods_before: int,
    ) -> None:
        self._simulator, self._state = simulator, state
        self._mechanism = simulator.mechanism
        self._analyser = Analyser(self._mechanism, point, compensated_delay)
        terms = simulator.evaluate(state)
        self._pose = terms.points[self._analyser.index].pose
        self._analysis = self._analyser.analyse(terms)
        self._periods_before = periods_before
        before = self._before(state.v)
        self._compensated = self._analyser.compensated(terms, self._analysis, before)
        space = terms.space
        self._factor = space.factor
        nv = self._mechanism.nv
        basis = np.hstack((space.basis, np.eye(nv)))
        self._free = np.linalg.qr(basis)[0][:, space.rank : nv]
        self._rates = np.linalg.solve(self._factor.T, self._free)
        self._wrenches = np.zeros((len(self._mechanism.point_names), 6))

    def found(self) -> LinearPoint:
        """Return the model."""
        size, calm = 2 * self._free.shape[1], np.zeros(6)
        stepped = self._columns(size, lambda x: self._stepped(self._moved(x), calm))
        external_count = self._columns(6, lambda wrench: self._stepped(self._state, wrench))
        shown = self._columns(size, lambda x: self._shown(self._moved(x)))
        rows, half = shown.reshape(3, 6, size), size // 2
        by_past = np.zeros((6, half))
        if self._periods_before:
            by_past = self._columns(half, self._free_after)
        return LinearPoint(
            period=self._simulator.period,
            step=stepped,
            push=external_count,
            twist=rows[1],
            pose=rows[0],
            acceleration=rows[2],
            by_past=by_past,
            periods_before=self._periods_before,
            analysis=self._analysis,
            compensated=self._compensated,
        )

    @staticmethod
    def _columns(size: int, function: Callable[[Array], Array]) -> Array:
        """Return the derivative of a function of ``size`` numbers, where they are 0."""
        changes = CHANGE * np.eye(size)
        columns = [(function(one) - function(-one)) / (2.0 * CHANGE) for one in changes]
        return np.array(columns).T

    def _moved(self, x: Array) -> MechanismState:
        """Return the state with these coordinates, its closures met."""
        mechanism, state = self._mechanism, self._state
        theta, speed = np.split(x, 2)
        q = mechanism.integrate(state.q, self._rates @ theta)
        v = state.v + self._rates @ speed
        q, v, error, _ = project(mechanism, q, v, state.active)
        return replace(state, q=q, v=v, closure_error=error)

    def _stepped(self, state: MechanismState, wrench: Array) -> Array:
        """Return the coordinates a period later."""
        wrenches = self._wrenches.copy()
        wrenches[self._analyser.index] = wrench
        after, start = self._simulator.step(state, wrenches), self._state
        moved = pin.difference(self._mechanism.model, start.q, after.q)
        both = np.column_stack((moved, after.v - start.v))
        return np.asarray((self._free.T @ self._factor.T @ both).T.ravel())

    def _shown(self, state: MechanismState) -> Array:
        """Return deviation of the pose, twist and free acceleration of the point, (18,)."""
        terms = self._simulator.evaluate(state)
        seen = terms.points[self._analyser.index]
        found = self._analyser.analyse(terms)
        before = self._before(self._state.v)
        compensated = self._analyser.compensated(terms, found, before)
        turned = pin.log3(seen.pose.rotation @ self._pose.rotation.T)
        away = seen.pose.translation - self._pose.translation
        return np.concatenate((away, turned, seen.twist, compensated.free_acceleration))

    def _before(self, rates: Array) -> Array:
        """Return (1 + nv,) what the compensation is told of rates that were."""
        return np.concatenate(((self._periods_before * self._simulator.period,), rates))

    def _free_after(self, speed: Array) -> Array:
        """Return the point's free acceleration at the state, after other rates, (6,)."""
        terms = self._simulator.evaluate(self._state)
        before = self._before(self._state.v + self._rates @ speed)
        return self._analyser.compensated(terms, self._analysis, before).free_acceleration
