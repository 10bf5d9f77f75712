# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering methods that are compared: the architecture with and without constraints, and proxies.

Architecture and proxy are both used with two pairs of gains: the scene's own joint-constraint
gains, and the stiffest ones with a gain margin of 2, chosen in the same way, so that the comparison
does not depend on the choice of gains.

A proxy is a virtual coupling, the same stiff spring and damper in all directions:

    u = -(κ Λ_d e + β Λ_d ė)   on the device,      κ Λ_d e + β Λ_d ė   on the mechanism

It uses neither Λ_h⁻¹ nor force feedforward, and does not distinguish constrained directions. The
hand feels the mechanism through the spring, with the device's inertia added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from hapticmech_ros.analysis.experience import directions
from hapticmech_ros.analysis.linear_loop import FINE, Law, diverges, frontier, law_of, tick_matrix
from hapticmech_ros.analysis.scene_variants import (
    at_once,
    held_by_nobody,
    with_constraint,
)
from hapticmech_ros.analysis.touch import Setup, touched
from hapticmech_ros.arrays import Array
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.architecture import LawControl, LawInput, device_inertia
from hapticmech_ros.control.loop_stability import LoopTerms, spectral_radius
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Sample

# Gain margin of the chosen gains.
GAIN_MARGIN = 2.0
# Candidates for β / κ, in units of the loop's latency (delay + 1/2) T.
RATIOS = np.geomspace(0.5, 8.0, 17)


class ProxyControl(LawControl):
    """A spring and damper between device and operational point.

    Args:
        scene: whose device, limits and ramps are used.
        stiffness: κ, 1/s².
        damping: β, 1/s.

    Raises:
        InvalidInputError: a gain that is negative or not finite.
    """

    def __init__(self, scene: Scene, stiffness: float, damping: float) -> None:
        super().__init__(scene, self._pulled)
        for name, value in (("stiffness", stiffness), ("damping", damping)):
            if not (np.isfinite(value) and value >= 0.0):
                raise InvalidInputError(f"proxy's {name}", value, "must be 0 or more")
        self.spring = stiffness * self.device_inertia
        self.damper = damping * self.device_inertia

    def _pulled(self, seen: LawInput, /) -> tuple[Array, Array]:
        pull = self.spring @ seen.error + self.damper @ seen.rate
        return -pull, pull

    def law(self) -> Law:
        """Return the linear law of this controller."""
        zero = np.zeros((6, 6))
        return Law(zero, self.spring, self.damper, zero, self.spring, self.damper, local=False)


def stiffest_proxy(scene: Scene, found: OperationalAnalysis, delay: int) -> tuple[float, float]:
    """Return κ (1/s²) and β (1/s) of the stiffest proxy with a gain margin of 2.

    With the position frozen ë = -(1 + X Λ_d) (κ e + β ė), delayed; see :func:`stiffest_gains`.

    Args:
        scene: whose device and period are used.
        found: analysis at the position where the loop has to be stable.
        delay: whole periods from measuring to acting.

    Raises:
        InvalidInputError: a delay below 0.
    """
    rows = found.rows
    inertia = device_inertia(scene.device)[np.ix_(rows, rows)]
    loop = np.eye(len(rows)) + found.inverse_inertia[np.ix_(rows, rows)] @ inertia
    return stiffest_gains(scene, loop, delay)


def stiffest_gains(scene: Scene, loop: Array, delay: int) -> tuple[float, float]:
    """Return the largest k and b of a delayed ë = -A (k e + b ė) with a gain margin of 2.

    They are half of the limit gains for the ratio of b to k with the largest stable k.

    Args:
        scene: whose period is used.
        loop: (n, n) A; without unit for k in 1/s² and b in 1/s, in 1/kg for N/m and N s/m.
        delay: whole periods from measuring to acting.

    Raises:
        InvalidInputError: a delay below 0.
    """
    if delay < 0:
        raise InvalidInputError("delay", delay, "must be 0 or more periods")
    period = scene.simulation.period
    latency = (delay + 0.5) * period
    best = (0.0, 0.0)
    for ratio in latency * RATIOS:

        def stable(gain: float, ratio: float = ratio) -> bool:
            late = gain * loop, gain * ratio * loop
            terms = LoopTerms(late, (np.zeros_like(loop), np.zeros_like(loop)))
            return spectral_radius(terms, period, delay) < 1.0

        guess = 0.25 / latency**2 / float(np.trace(loop))
        most = frontier(stable, guess, 1e-6 * guess, 1e3 * guess, FINE)
        if most is not None and most > best[0]:
            best = (most, most * float(ratio))
    return best[0] / GAIN_MARGIN, best[1] / GAIN_MARGIN


FULL, STIFF = "architecture", "architecture, stiffest"
FREE = "no joint constraint"
PROXY, SOFT = "proxy, stiffest", "proxy, as soft"
# Speed of the device after the touch, and of a session that is lost, m/s of the metric.
TOUCH_SPEED, LOST_SPEED = 2e-3, 0.04
WATCHED_S = 1.5
# Share of the touch that counts as rest, since a mechanism that swings by itself leaves some
# relative velocity of device and point. An unstable loop exceeds it.
FLOOR_SHARE = 0.05
# Largest delay tried, periods.
MOST_DELAY = 50


@dataclass(frozen=True, slots=True)
class Variant:
    """One rendering method of a scene.

    Attributes:
        name: of the method.
        setup: of its sessions.
        law: linear law at the scene's start.
        holds: whether it renders stiffness along all constrained directions.
        gains: stiffness and damping of the joint constraint, or of a proxy, N/m and N s/m.
    """

    name: str
    setup: Setup
    law: Law
    holds: bool
    gains: tuple[float, float]


def variants(scene: Scene, point: str = "", delay: int = 1) -> list[Variant]:
    """Return the rendering methods of a scene; 'stiffest' gains are those for the given delay.

    Args:
        scene: whose mechanism, device and hand are used.
        point: operational point; the first one if empty.
        delay: periods from measuring to acting.

    Raises:
        InvalidInputError: a delay below 0.
    """
    found = directions(scene, point)
    joint, mass = scene.controller.joint_constraint, scene.device.mass
    stiff = joint.stiffness, joint.damping
    if found.held.size:
        # Device's mass per unit of P_c along the direction with the largest gain.
        gain = found.held.T @ np.linalg.inv(device_inertia(scene.device)) @ found.held
        loop = np.linalg.eigvalsh(gain)[-1:, None]
        stiff = stiffest_gains(scene, loop, 0 if joint.local else delay)
    kappa, beta = stiffest_proxy(scene, found.analysis, delay)
    return [
        _architecture(FULL, scene, point, delay),
        _architecture(STIFF, with_constraint(scene, *stiff), point, delay),
        _architecture(FREE, with_constraint(scene, 0.0, 0.0), point, delay),
        _proxy(PROXY, scene, point, delay, kappa, beta),
        _proxy(SOFT, scene, point, delay, joint.stiffness / mass, joint.damping / mass),
    ]


def _architecture(name: str, scene: Scene, point: str, delay: int) -> Variant:
    found = directions(scene, point)
    model = operational_model_of(found.analysis)
    law, joint = law_of(ControlArchitecture(scene), model), scene.controller.joint_constraint
    holds = joint.stiffness > 0.0 or not found.held.size
    return Variant(name, Setup(scene, point, delay), law, holds, (joint.stiffness, joint.damping))


def _proxy(name: str, scene: Scene, point: str, delay: int, kappa: float, beta: float) -> Variant:
    setup = Setup(scene, point, delay, partial(ProxyControl, stiffness=kappa, damping=beta))
    law, mass = ProxyControl(scene, kappa, beta).law(), scene.device.mass
    return Variant(name, setup, law, True, (kappa * mass, beta * mass))


def largest_delay(variant: Variant) -> int | None:
    """Return the delay margin of sessions, up to 50 periods; -1 if unstable without delay.

    The device is touched along all directions at once, without a hand; stability is judged by the
    velocity of the device relative to the operational point. None for a method without coupling
    along some direction: the device then moves on and does not come to rest.
    """
    if not variant.holds:
        return None
    setup = variant.setup
    scene = at_once(held_by_nobody(setup.scene))
    found = directions(scene, setup.point)
    mobility, normals = np.linalg.inv(device_inertia(scene.device)), found.normals
    speeds = np.full(normals.shape[1], TOUCH_SPEED / np.sqrt(normals.shape[1]))
    impulse = normals @ np.linalg.solve(normals.T @ mobility @ normals, speeds)
    ticks = round(WATCHED_S / scene.simulation.period)
    floor = FLOOR_SHARE * TOUCH_SPEED

    def watch(sample: Sample) -> Array:
        return np.asarray(normals.T @ (sample.device.twist - sample.point.twist))

    def stable(delay: int) -> bool:
        case, push = replace(setup, scene=scene, delay=delay), impulse / scene.simulation.period
        return touched(case, push, watch, ticks, LOST_SPEED, floor).stable

    return _largest(stable)


def predicted_delay(variant: Variant) -> int:
    """Return the delay margin of the linear model of the loop."""
    setup = variant.setup
    found = directions(setup.scene, setup.point).analysis

    def stable(delay: int) -> bool:
        x, rows = found.inverse_inertia, found.rows
        return not diverges(tick_matrix(setup.scene, variant.law, x, rows, delay))

    return _largest(stable)


def _largest(stable: Callable[[int], bool]) -> int:
    low, high = -1, 1
    while stable(high):
        low = high
        if high == MOST_DELAY:
            return high
        high = min(2 * high, MOST_DELAY)
    if low < 0:
        return 0 if stable(0) else -1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low
