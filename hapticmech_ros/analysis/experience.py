# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drift, penetration, contact force and energy during a scene's own experiment.

Energy is counted at the port between hand and device:

    E_h = ∫ F_h · ẋ dt,      remainder = E_h + E(0) - E(t) + W_e  ≥ 0

E is the energy stored in the mechanism (kinetic, potential, contacts), W_e the work of constant
efforts in its joints. The remainder is dissipated or in the device's motion; a negative remainder
means that the rendering generated energy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hapticmech_ros.analysis.scene_variants import at_once
from hapticmech_ros.analysis.touch import Setup
from hapticmech_ros.arrays import Array
from hapticmech_ros.control.clutch import pose_error
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.session import Sample, Session

# Distance of device and operational point, in m of the metric, beyond which a session is lost.
LOST_M = 0.1
# A contact is steady if F_c is above the first (N) and speeds are below the second (m/s).
PUSHING_N, STANDING_M_S = 0.2, 2e-3


@dataclass(frozen=True, slots=True)
class Experience:
    """Results of an experiment.

    Attributes:
        drift_rms: of e along free directions, m of the metric, from the hand's start on.
        penetration_rms, penetration_peak: of e along constrained directions, m.
        hand_energy: least E_h, J; below 0 the hand received more energy than it supplied.
        left_energy: least remainder, J; below 0 the rendering generated energy.
        contact_error: median of |F_h + F_c + F_0| / |F_c| in steady contact, F_0 being the
            mechanism's own wrench at the point; None without steady contact.
        steady: number of samples with steady contact.
        kept: whether device and operational point stayed together to the end.
    """

    drift_rms: float
    penetration_rms: float
    penetration_peak: float
    hand_energy: float
    left_energy: float
    contact_error: float | None
    steady: int
    kept: bool


def experience(setup: Setup) -> Experience:
    """Run a scene's own experiment with its own hand.

    Args:
        setup: of the session.

    Returns:
        Drift, penetration, energies and contact error.

    Raises:
        InvalidInputError: no such point, or a delay below 0.
    """
    session = replace(setup, scene=at_once(setup.scene)).session()
    watch = _Watch(session, setup.point)
    scene = setup.scene
    ticks = round((scene.hand.start_delay + scene.experiment.duration) / session.period)
    kept = True
    try:
        for _ in range(ticks):
            if not watch.record(session.tick()):
                kept = False
                break
    except HapticMechError:
        kept = False
    return watch.result(kept)


class _Watch:
    def __init__(self, session: Session, point: str) -> None:
        self._session, self._start = session, session.scene.hand.start_delay
        self._mass = Analyser(session.simulator.mechanism, point).metric.mass
        self._squares: list[tuple[float, float]] = []
        self._powers: list[tuple[float, float]] = []
        self._stored: list[float] = []
        self._contact: list[float] = []

    def record(self, sample: Sample) -> bool:
        """Process a sample.

        Returns:
            Whether device and point are together.
        """
        analysis = sample.analysis
        error = pose_error(sample.point.pose, sample.device.pose)[analysis.rows]
        along = (analysis.spectrum.wrenches.T @ error) ** 2 / self._mass
        free, held = (1.0 - analysis.weights) @ along, analysis.weights @ along
        if not free + held < LOST_M**2:
            return False
        if sample.time >= self._start:
            self._squares.append((float(free), float(held)))
        state, mechanism = sample.mechanism, self._session.simulator.mechanism
        effort = self._session.simulator.evaluate(state).effort
        power = sample.hand_wrench @ sample.device.twist
        self._powers.append((float(power), float(effort @ state.v)))
        kinetic, potential = mechanism.energy(state.q, state.v)
        self._stored.append(kinetic + potential + state.account.contact_energy)
        self._touch(sample)
        return True

    def _touch(self, sample: Sample) -> None:
        contact = sample.contact_wrench[:3]
        size = float(np.linalg.norm(contact))
        speeds = sample.device.twist[:3], sample.point.twist[:3]
        still = max(np.linalg.norm(speed) for speed in speeds) < STANDING_M_S
        if size > PUSHING_N and still:
            itself = own_wrench(sample.analysis)[:3]
            left = sample.hand_wrench[:3] + contact + itself
            self._contact.append(float(np.linalg.norm(left)) / size)

    def result(self, kept: bool) -> Experience:
        squares = np.array(self._squares).reshape(-1, 2)
        powers = np.array(self._powers).reshape(-1, 2)
        period, stored = self._session.period, np.array(self._stored)
        # Trapezoidal rule, from the first sample on.
        works = np.zeros((len(powers), 2))
        works[1:] = np.cumsum(0.5 * period * (powers[1:] + powers[:-1]), axis=0)
        left = works.sum(axis=1) + (stored[:1] - stored)
        rms = np.sqrt(squares.mean(axis=0)) if len(squares) else np.full(2, np.nan)
        return Experience(
            drift_rms=float(rms[0]),
            penetration_rms=float(rms[1]),
            penetration_peak=float(np.sqrt(squares[:, 1].max(initial=0.0))),
            hand_energy=float(works[:, 0].min(initial=0.0)),
            left_energy=float(left.min(initial=0.0)),
            contact_error=float(np.median(self._contact)) if self._contact else None,
            steady=len(self._contact),
            kept=kept,
        )


def own_wrench(analysis: OperationalAnalysis) -> Array:
    """Return F_0 (6,), the wrench equivalent to the free acceleration a_0 at the point.

    X F_0 = a_0 along free directions: F_0 = Σ (1 - w_i) n_i (n_iᵀ a_0) / μ_i; N, N m,
    world axes.
    """
    found, free = analysis.spectrum, analysis.weights < 1.0
    along = found.wrenches.T @ analysis.free_acceleration[analysis.rows]
    shares = np.zeros(along.size)
    shares[free] = (1.0 - analysis.weights[free]) * along[free] / found.mu[free]
    wrench = np.zeros(6)
    wrench[analysis.rows] = found.wrenches @ shares
    return wrench
