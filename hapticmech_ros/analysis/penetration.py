# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Penetration into joint constraints under a steady push, compared with F / k.

    u_jc = -(k / m_ℓ) Σ w_i n_i n_iᵀ e,   F_h = f n_i / √m_ℓ   give   n_iᵀ e / √m_ℓ = f / k

at rest, for any combination of force and torque in the direction. The same session without the push
is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hapticmech_ros.analysis.scene_variants import at_once, held_by_nobody
from hapticmech_ros.analysis.touch import Setup
from hapticmech_ros.arrays import Array
from hapticmech_ros.control.clutch import pose_error
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session


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
