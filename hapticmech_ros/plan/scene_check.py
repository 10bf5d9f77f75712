# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Properties of a scene, and warnings to its author before it is rendered."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.loop_stability import ENOUGH_PERIODS, LoopMargins, loop_margins
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.mechanism.elements import stiff_elements
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.mechanism.redundancy import Redundancy, redundancy
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import rigid_count
from hapticmech_ros.operational.results import felt_masses
from hapticmech_ros.plan.loop_check import connection_warning
from hapticmech_ros.plan.step_accuracy import StepAccuracy, step_accuracy
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.holding_rules import hand_beyond_device, pose_without_torques
from hapticmech_ros.simulation import MechanismState, Simulator

# Relative σ below which the start counts as next to a singular position: directions change within
# degrees.
NEAR_SINGULAR = 1e-2
# Closure error in scene lengths beyond which the start as written was not closed.
FAR = 1e-3
# In scene lengths, from which shorter steps make a difference that can be felt.
COARSE = 1e-3
# Of what turns and moves freely, from which a link turns as it is moved.
TURNS = 1e-3


@dataclass(frozen=True, slots=True)
class PointCheck:
    """An operational point at the start.

    Attributes:
        name, link: as in the scene.
        rank: of X, the number of directions in which it can be moved.
        count: joint constraints felt.
        mass_kg: least and largest inertia to forces, kg; None if no force moves it.
        loop: delay margin and gain margin of the rendering there.
    """

    name: str
    link: str
    rank: int
    count: int
    mass_kg: tuple[float, float] | None
    loop: LoopMargins


@dataclass(frozen=True, slots=True)
class SceneCheck:
    """Properties of a scene.

    Attributes:
        scene: name.
        links: number of links.
        joints: number of moving joints.
        nv: degrees of freedom of the open tree.
        mass_kg: of all links.
        closures: name, kind, rows m, and number of rows independent of those of earlier closures.
        rank: of all active closures.
        mobility: nv - rank.
        fitted: how frames of loops were moved that are written with few digits; empty if none was.
        points: operational points.
        accuracy: of the mechanism's steps.
        warnings: to the author.
    """

    scene: str
    links: int
    joints: int
    nv: int
    mass_kg: float
    closures: tuple[tuple[str, str, int, int], ...]
    rank: int
    mobility: int
    fitted: str
    points: tuple[PointCheck, ...]
    accuracy: StepAccuracy
    warnings: tuple[str, ...]


def check_scene(
    scene: Scene,
    is_over: Callable[[], bool] | None = None,
    show: Callable[[str], None] | None = None,
) -> SceneCheck:
    """Return the properties of a scene at its start.

    Args:
        scene: what to look at.
        is_over: whether the time is up, so that what is not known yet of the steps' accuracy is
            left out; never if None.
        show: called with what is done now.

    Raises:
        SingularInertiaError: a joint moves no mass.
        ClosureError: its loops cannot be closed.
    """
    simulator = Simulator(scene)
    mechanism, state = simulator.mechanism, simulator.initial_state()
    rows = redundancy(mechanism, state.q, state.active)
    followed = {one.name: len(one.redundant) for one in rows.closures}
    points, accuracy = tuple(_points(simulator, state)), step_accuracy(scene, is_over, show)
    return SceneCheck(
        scene=scene.name,
        links=len(scene.links),
        joints=len(mechanism.tree.joints),
        nv=mechanism.nv,
        mass_kg=sum(link.inertial.mass for link in scene.links),
        closures=tuple(
            (loop.name, loop.kind, loop.rows, loop.rows - followed.get(loop.name, 0))
            for loop in mechanism.closures
        ),
        rank=rows.rank,
        mobility=rows.mobility,
        fitted="" if mechanism.fit is None else str(mechanism.fit),
        points=points,
        accuracy=accuracy,
        warnings=(
            *_warnings(simulator, state, rows),
            *_loops(points, scene),
            *_accuracy(accuracy, mechanism.length),
        ),
    )


def _points(simulator: Simulator, state: MechanismState) -> Iterator[PointCheck]:
    scene = simulator.mechanism.scene
    terms = simulator.evaluate(state)
    for point in scene.operational_points:
        control = ControlArchitecture(scene.held_at(point.name))
        analysis = Analyser(simulator.mechanism, point.name).analyse(terms)
        felt, _ = felt_masses(analysis)
        felt = felt[np.isfinite(felt)]
        masses = (float(felt[0]), float(felt[-1])) if felt.size else None
        count = rigid_count(analysis.spectrum.s, scene.perception)
        model = operational_model_of(analysis)
        margins = loop_margins(control, model, analysis.rows, scene.simulation.period)
        yield PointCheck(point.name, point.link, analysis.rank, count, masses, margins)


def _loops(points: Sequence[PointCheck], scene: Scene) -> Iterator[str]:
    """Yield warnings about points at which the rendering has too small a delay margin."""
    for point in points:
        warning = point.loop.warning(point.name, scene.simulation.period, ENOUGH_PERIODS)
        if warning is not None:
            yield warning
    users = [scene.held_at(point) for point in scene.held_points]
    found = [connection_warning(user, user.controller) for user in users]
    yield from dict.fromkeys(filter(None, found))


def _accuracy(found: StepAccuracy, length: float) -> Iterator[str]:
    """Yield warnings about steps that are too long."""
    if found.failed:
        yield f"the scene's experiment ends early: {found.failed}"
    if found.inaccurate:
        yield f"{found.inaccurate} steps of the experiment are inaccurate: shorten the period"
    if found.position_m > COARSE * length:
        yield (
            f"with steps of a tenth the operational point differs by {found.position_m:.2g} m in"
            " the scene's experiment: shorten the period, or add substeps"
        )


def _torques(simulator: Simulator, state: MechanismState) -> Iterator[str]:
    """Yield a warning about each point that turns as it moves, if the device has no torques."""
    mechanism, scene = simulator.mechanism, simulator.mechanism.scene
    for point in scene.operational_points:
        warning = pose_without_torques(scene.held_at(point.name))
        if not warning:
            continue
        terms = simulator.evaluate(state)
        x = Analyser(mechanism, point.name).analyse(terms).inverse_inertia
        size = np.sqrt(np.outer(x.diagonal()[:3], x.diagonal()[3:])).max()
        if np.abs(x[:3, 3:]).max() > TURNS * size:
            yield f"{point.name}: {warning}"


def _warnings(simulator: Simulator, state: MechanismState, rows: Redundancy) -> Iterator[str]:
    mechanism, scene = simulator.mechanism, simulator.mechanism.scene
    if rows.mobility == 0:
        yield "the mechanism cannot move: the closures leave no degree of freedom"
    if rows.wholly_redundant:
        yield f"redundant closures: {', '.join(rows.wholly_redundant)}"
    closing = mechanism.closing_terms(state.q, state.active)
    if closing.least < NEAR_SINGULAR:
        yield f"the start is next to a singular position: relative σ {closing.least:.1e}"
    yield from _start(simulator, state)
    yield from _stiffness(simulator)
    yield from _torques(simulator, state)
    users = [scene.held_at(point) for point in scene.held_points]
    yield from dict.fromkeys(filter(None, map(hand_beyond_device, users)))
    for link in scene.links:
        if link.joint.limits is not None and not link.joint.locked:
            at = scene.initial_state.q.get(link.joint.name, 0.0)
            low, high = link.joint.limits.lower, link.joint.limits.upper
            if isinstance(at, float) and not low <= at <= high:
                name = link.joint.name
                yield f"joint {name} starts at {at:g}, outside its stops at {low:g} and {high:g}"


def _start(simulator: Simulator, state: MechanismState) -> Iterator[str]:
    mechanism = simulator.mechanism
    written, _ = authored_state(mechanism.scene, mechanism.tree)
    moved = float(np.abs(mechanism.difference(written, state.q)).max())
    if moved > FAR:
        yield f"the start as written was not closed: joints were moved by up to {moved:.2g}"


def _stiffness(simulator: Simulator) -> Iterator[str]:
    """Yield warnings about elements that are unstable with the explicit rule that was chosen."""
    mechanism, scene = simulator.mechanism, simulator.scene
    if scene.simulation.integrator == "linearly_implicit":
        return
    for element in stiff_elements(scene, mechanism.tree, mechanism.elements.springs):
        yield (
            f"{element}, with which {scene.simulation.integrator} may be unstable: leave integrator"
            " out, or set linearly_implicit"
        )
