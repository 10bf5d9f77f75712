# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Computations of a session's tick for a scene: how often each is done, or why it is omitted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.mechanism.tolerances import PROJECTION_ITERATIONS
from hapticmech_ros.plan.running import Running


@dataclass(frozen=True, slots=True)
class TickPart:
    """A computation of a tick.

    Attributes:
        stage: ``evaluate``, ``analyse``, ``control``, ``step`` or ``device``.
        what: is computed.
        times: least number in a tick; 0 if it is omitted.
        why: reason of the number.
    """

    stage: str
    what: str
    times: int
    why: str

    @property
    def computed(self) -> bool:
        """Whether it is done in a tick."""
        return self.times > 0


def parts_of_tick(run: Running) -> tuple[TickPart, ...]:
    """Return all computations in the order of a tick, omitted ones included."""
    return (
        *_evaluate(run),
        *_analyse(run),
        TickPart("control", "wrenches of all controllers", 1, "the same for all scenes"),
        *_solve(run),
        *_elements(run),
        *_closures(run),
        *_contacts(run),
        *_device(run),
    )


def _evaluate(run: Running) -> Iterator[TickPart]:
    names = run.mechanism.point_names
    why = "taken from the end of the previous step"
    yield TickPart("evaluate", "D, W and their factors", 0, why)
    gravity = run.mechanism.model.gravity.linear
    pull = float(np.sqrt(gravity @ gravity))
    why = f"with gravity, {pull:g} m/s²" if pull else "gravity is zero: the same recursion"
    yield TickPart("evaluate", "h: Coriolis, centripetal, gravity", 1, why)
    why = f"{len(names)} in the scene, all of them evaluated"
    yield TickPart("evaluate", "pose, Jacobian, twist, drift of points", len(names), why)


def _analyse(run: Running) -> Iterator[TickPart]:
    t, held, rest = run.analyser.rows.size, run.analyser.point.name, len(run.mechanism.point_names)
    why = f"{held} is held; SVD of {t} rows"
    yield TickPart("analyse", "Λ_h⁻¹ and its spectrum", 1, why)
    if rest > 1:
        why = f"{rest - 1}: analysed by a further session, or by nodes in a further namespace"
        yield TickPart("analyse", "spectrum of further points", 0, why)
    yield _if_closed(run, "analyse", "projection of S onto closed-loop motions", 1)


def _solve(run: Running) -> Iterator[TickPart]:
    stages, substeps = len(run.scheme.weights), run.stepping.substeps
    each = f"{stages} stages of {run.stepping.integrator} in {substeps} substeps"
    yield TickPart("step", "D, joint Jacobians, poses; Cholesky of D", stages * substeps, each)
    yield _if_closed(run, "step", "W and its factorisation", stages * substeps)
    why = "the configuration is a vector: steps are added" if run.flat else each
    yield TickPart("step", "integration on a manifold", 0 if run.flat else stages * substeps, why)
    why = f"{run.stepping.integrator} is explicit"
    if run.scheme.implicit:
        why = "used if elements have stiffness or damping"
    times = substeps if run.scheme.implicit else 0
    yield TickPart("step", "factorisation of D with stiffness and damping", times, why)


def _elements(run: Running) -> Iterator[TickPart]:
    elements, times = run.mechanism.elements, len(run.scheme.weights) * run.stepping.substeps
    count = int(np.count_nonzero(elements.damping))
    why = f"{count} of {elements.damping.size} rates are damped; all are computed"
    yield TickPart("step", "damping of joints", times, why)
    for what, number in (
        ("springs, friction, stops of joints", len(elements.joints)),
        ("springs between points", len(elements.springs)),
    ):
        why = f"{number} in the scene" if number else "none in the scene"
        yield TickPart("step", what, times if number else 0, why)


def _closures(run: Running) -> Iterator[TickPart]:
    substeps, closures = run.stepping.substeps, run.mechanism.closures
    pulled = run.stepping.baumgarte_rate > 0.0
    what = "projection onto the closures"
    if pulled and run.rows.rows:
        yield TickPart("step", what, 0, "Baumgarte stabilisation instead")
    else:
        why = f"iterations until convergence, at most {PROJECTION_ITERATIONS} a substep"
        yield _if_closed(run, "step", what, substeps, why)
    times, latching = len(run.can_latch), ", ".join(run.can_latch)
    why = f"{latching}: D and W are evaluated for each" if times else "no open closure can latch"
    yield TickPart("step", "distance of closures that can latch", times, why)
    still = sum(not on for on in run.state.active)
    frames = 2 * still * len(run.scheme.weights) * substeps
    why = f"{still} of {len(closures)} closures are open; computed with all other frames"
    yield TickPart("step", "frames of open closures", frames, why if still else "no open closures")


def _contacts(run: Running) -> Iterator[TickPart]:
    pairs, substeps = len(run.scene.contacts), run.stepping.substeps
    if not pairs:
        for what in ("bounding boxes of declared pairs", "points of contact and their forces"):
            yield TickPart("step", what, 0, "no contact pairs are declared")
        return
    declared = f"{pairs} declared pair{'s' if pairs > 1 else ''}"
    yield TickPart("step", "bounding boxes of declared pairs", substeps, declared)
    why = "for pairs whose boxes overlap; D, W and their factors at the step's start are reused"
    yield TickPart("step", "points of contact and their forces", 0, why)


def _device(run: Running) -> Iterator[TickPart]:
    device = run.scene.device
    why = f"hand: {run.scene.hand.kind}"
    yield TickPart("device", "motion of the device", device.substeps, why)
    bandwidth = device.actuator_bandwidth
    why = f"{bandwidth:g} Hz" if bandwidth else "the actuators are ideal"
    yield TickPart("device", "lag of the actuators", device.substeps if bandwidth else 0, why)
    frictions = device.coulomb_friction, device.angular_coulomb_friction
    why = f"{frictions[0]:g} N, {frictions[1]:g} N m" if any(frictions) else "none"
    yield TickPart("device", "Coulomb friction", device.substeps if any(frictions) else 0, why)
    limits = device.workspace.radius, device.workspace.angle
    why = f"{limits[0]:g} m, {limits[1]:g} rad; 0 is none" if any(limits) else "none"
    yield TickPart("device", "end stops", device.substeps if any(limits) else 0, why)
    steps = device.position_resolution, device.angle_resolution
    why = f"steps of {steps[0]:g} m, {steps[1]:g} rad" if any(steps) else "the encoders are ideal"
    yield TickPart("device", "rounding to encoder steps", int(any(steps)), why)
    estimated = device.force_sensor == "estimated"
    why = f"the hand's wrench is {device.force_sensor}"
    yield TickPart("device", "observer of the hand's wrench", int(estimated), why)


def _if_closed(run: Running, stage: str, what: str, times: int, why: str = "") -> TickPart:
    m = run.rows.rows
    if m == 0:
        return TickPart(stage, what, 0, "no closure is active")
    return TickPart(stage, what, times, why or f"{m} active rows, rank {run.rows.rank}")
