# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Drift, penetration, contact force and energy during a scene's own experiment.

Energy is counted at the port between hand and device:

    E_h = ∫ F_h · ẋ dt,      remainder = E_h + E(0) - E(t) + W_e  ≥ 0

E is the energy stored in the mechanism (kinetic, potential, contacts), W_e the work of constant
efforts in its joints. The remainder is dissipated or in the device's motion; a negative remainder
means that the rendering generated energy.

Penetration into joint constraints under a steady push, compared with F / k.

    u_jc = -(k / m_ℓ) Σ w_i n_i n_iᵀ e,   F_h = f n_i / √m_ℓ   give   n_iᵀ e / √m_ℓ = f / k

at rest, for any combination of force and torque in the direction. The same session without the push
is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hapticmech_ros.analysis.scene_variants import at_once, held_by_nobody
from hapticmech_ros.analysis.touch import Setup
from hapticmech_ros.control.clutch import pose_error
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Sample, Session


@dataclass(frozen=True, slots=True)
class Directions:
    """Wrenches n_i / √m_ℓ, world axes at the point: 1 N at a link's centre of mass.

    Attributes:
        normals: (6, t) wrenches, N and N m per N; n_iᵀ e / √m_ℓ is a displacement in m.
        weights: (t,) rigidity w(s_i): 1 is constrained, 0 is free.
        mass: m_ℓ, kg.
        analysis: operational analysis they are taken from.
    """

    normals: Array
    weights: Array
    mass: float
    analysis: OperationalAnalysis

    @property
    def held(self) -> Array:
        """(6, k) directions constrained by the joints; units and axes of ``normals``."""
        return self.normals[:, self.weights == 1.0]

    @property
    def free(self) -> Array:
        """(6, t - k) other directions; likewise."""
        return self.normals[:, self.weights < 1.0]


def directions(scene: Scene, point: str = "") -> Directions:
    """Return the directions of a scene at its start.

    Args:
        scene: to analyse.
        point: operational point; the first one if empty.

    Raises:
        InvalidInputError: no such point.
    """
    session = Session(held_by_nobody(scene), point)
    analysis = session.tick().analysis
    mass = Analyser(session.simulator.mechanism, point).metric.mass
    normals = np.zeros((6, len(analysis.weights)))
    normals[analysis.rows] = analysis.spectrum.wrenches / np.sqrt(mass)
    return Directions(normals, analysis.weights, mass, analysis)


# N; along a free direction it moves the device by about 15 mm.
PUSH_N = 0.1
# Duration of the push, s, and of the average of displacements at its end.
LASTING_S, AVERAGED_S = 0.3, 0.05


@dataclass(frozen=True, slots=True)
class Yield:
    """Displacement by a steady push along one direction.

    Attributes:
        direction: (6,) n_i / √m_ℓ, wrench per N of the push.
        held: whether the direction is constrained by the joints.
        error: n_iᵀ e / √m_ℓ, m, between device and operational point; nan if the session was lost.
        moved: n_iᵀ x / √m_ℓ, m, displacement of the device.
        expected: f / k, m, by the joint-constraint law; infinite without one.
    """

    direction: Array
    held: bool
    error: float
    moved: float
    expected: float

    @property
    def stiffness(self) -> float:
        """Felt stiffness, N/m; 0 if the session was lost."""
        return float(PUSH_N / abs(self.moved)) if np.isfinite(self.moved) else 0.0


def penetration(setup: Setup) -> list[Yield]:
    """Return the displacements by a push along every direction of a scene, without a hand.

    Args:
        setup: of the sessions.

    Raises:
        ClosureError, InvalidInputError: a session that ended by itself.
    """
    alone = replace(setup, scene=at_once(held_by_nobody(setup.scene)))
    found = directions(alone.scene, alone.point)
    gains = alone.scene.controller.joint_constraint
    expected = PUSH_N / gains.stiffness if gains.stiffness > 0.0 else np.inf
    calm = _shifts(alone, np.zeros(6))
    yields = []
    for column, weight in zip(found.normals.T, found.weights, strict=True):
        error, moved = (_shifts(alone, PUSH_N * column) - calm) @ column
        held = bool(weight == 1.0)
        yields.append(Yield(column, held, float(error), float(moved), float(expected)))
    return yields


def _shifts(setup: Setup, push: Array) -> Array:
    """Return error and displacement (2, 6) at the end of a push, m and rad."""
    session = setup.session()
    ticks = round(LASTING_S / session.period)
    last = max(1, round(AVERAGED_S / session.period))
    # Until the first command arrives the device is not controlled.
    session.run(setup.delay)
    sums, start = np.zeros((2, 6)), session.device.pose
    session.run(ticks - last, hand_wrench=push, every=ticks)
    for _ in range(last):
        sample = session.tick(hand_wrench=push)
        pose = sample.device.pose
        error = pose_error(sample.point.pose, pose)
        sums += np.array((error, pose_error(start, pose))) / last
    return sums


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
    session, scene = replace(setup, scene=at_once(setup.scene)).session(), setup.scene
    mass = Analyser(session.simulator.mechanism, setup.point).metric.mass
    ticks = round((scene.hand.start_delay + scene.experiment.duration) / session.period)
    kept, found = True, list[tuple[float, ...]]()
    try:
        for _ in range(ticks):
            sample = session.tick()
            analysis = sample.analysis
            error = pose_error(sample.point.pose, sample.device.pose)[analysis.rows]
            along = (analysis.spectrum.wrenches.T @ error) ** 2 / mass
            free, held = (1.0 - analysis.weights) @ along, analysis.weights @ along
            kept = bool(free + held < LOST_M**2)
            if not kept:
                break
            state = sample.mechanism
            effort = session.simulator.evaluate(state).effort
            power = sample.hand_wrench @ sample.device.twist
            kinetic, potential = session.simulator.mechanism.energy(state.q, state.v)
            stored = kinetic + potential + state.account.contact_energy
            contact = _contact_error(sample)
            found.append((sample.time, free, held, power, effort @ state.v, stored, contact))
    except HapticMechError:
        kept = False
    rows = np.array(found).reshape(-1, 7)
    start, powers = session.scene.hand.start_delay, rows[:, 3:5]
    squares = np.array([row[1:3] for row in found if row[0] >= start]).reshape(-1, 2)
    # Trapezoidal rule, from the first sample on.
    works = np.zeros((len(powers), 2))
    works[1:] = np.cumsum(0.5 * session.period * (powers[1:] + powers[:-1]), axis=0)
    left = works.sum(axis=1) + (rows[:1, 5] - rows[:, 5])
    rms = np.sqrt(squares.mean(axis=0)) if len(squares) else np.full(2, np.nan)
    steady = rows[np.isfinite(rows[:, 6]), 6]
    return Experience(
        drift_rms=float(rms[0]),
        penetration_rms=float(rms[1]),
        penetration_peak=float(np.sqrt(squares[:, 1].max(initial=0.0))),
        hand_energy=float(works[:, 0].min(initial=0.0)),
        left_energy=float(left.min(initial=0.0)),
        contact_error=float(np.median(steady)) if steady.size else None,
        steady=steady.size,
        kept=kept,
    )


def _contact_error(sample: Sample) -> float:
    """Return |F_h + F_c + F_0| / |F_c| of a sample in steady contact; NaN of others."""
    contact = sample.contact_wrench[:3]
    size = float(np.linalg.norm(contact))
    speed = max(np.linalg.norm(body.twist[:3]) for body in (sample.device, sample.point))
    if not (size > PUSHING_N and speed < STANDING_M_S):
        return np.nan
    left = sample.hand_wrench[:3] + contact + own_wrench(sample.analysis)[:3]
    return float(np.linalg.norm(left)) / size


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
