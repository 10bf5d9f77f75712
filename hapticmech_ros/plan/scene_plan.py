# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a scene, taken from the objects that run.

Properties of a scene, and warnings to its author before it is rendered.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.loop_stability import ENOUGH_PERIODS, LoopMargins, loop_margins
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.device import device_for
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.elements import stiff_elements
from hapticmech_ros.mechanism.kernels.factor_kernels import APART
from hapticmech_ros.mechanism.kernels.many_rows import FEW_ROWS, SOME_ROWS
from hapticmech_ros.mechanism.kernels.model import Data
from hapticmech_ros.mechanism.kernels.step_kernels import work_size
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.mechanism.redundancy import Redundancy, redundancy
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample, OperationalModelSample
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import rigid_count
from hapticmech_ros.operational.results import felt_masses
from hapticmech_ros.plan.loop_check import connection_warning
from hapticmech_ros.plan.step_accuracy import StepAccuracy, step_accuracy
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.holding_rules import hand_beyond_device, pose_without_torques
from hapticmech_ros.scene.mechanism import Simulation
from hapticmech_ros.simulation import MechanismState, Simulator

# Relative σ below which the start counts as next to a singular position: directions change within
# degrees.
NEAR_SINGULAR = 1e-2
# Closure error in scene lengths beyond which the start as written was not closed.
FAR = 1e-3
# In scene lengths, from which shorter steps make a difference that can be felt.
COARSE = 1e-3
# Largest entry of X between force and rotation, over its diagonal's, above which a push turns a
# link.
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
        scene: to check.
        is_over: whether the time is up: the rest of the steps' accuracy is then left out; never if
            None.
        show: called with a description of the present work.

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
        yield (
            f"{found.inaccurate} steps of the scene's experiment exceed simulation.accuracy"
            ".tolerance: shorten the period"
        )
    if found.position_m > COARSE * length:
        yield (
            f"ten times shorter steps move the operational point by {found.position_m:.2g} m in the"
            " scene's experiment: shorten the period, or add substeps"
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
        yield f"loops are open at the start as written: joints were moved by up to {moved:.2g}"


def _stiffness(simulator: Simulator) -> Iterator[str]:
    """Yield warnings about elements that are unstable with the explicit rule that was chosen."""
    mechanism, scene = simulator.mechanism, simulator.scene
    if scene.simulation.integrator == "linearly_implicit":
        return
    for element in stiff_elements(scene, mechanism.tree, mechanism.elements.springs):
        yield (
            f"{element}: {scene.simulation.integrator} may be unstable with it; leave integrator"
            " out, or set linearly_implicit"
        )


@dataclass(frozen=True, slots=True)
class Choice:
    """Choice of a method.

    Attributes:
        about: the computed quantity.
        taken: the chosen method.
        why: reason of the choice.
    """

    about: str
    taken: str
    why: str


def _integrator(run: Running) -> Choice:
    taken = run.stepping.integrator
    if run.scene.simulation.integrator != "auto":
        return Choice("rule of a step", taken, "chosen by the scene")
    mechanism = run.mechanism
    stiff = next(stiff_elements(mechanism.scene, mechanism.tree, mechanism.elements.springs), None)
    return Choice(
        "rule of a step", taken, "nothing is too stiff for it" if stiff is None else str(stiff)
    )


def _configuration(run: Running) -> Choice:
    nq, nv = run.mechanism.nq, run.mechanism.nv
    if nq == nv:
        return Choice("configuration", "a vector", f"nq = nv = {nv}: steps are added")
    why = f"nq = {nq}, nv = {nv}: a step is integrated on the manifold at every stage"
    return Choice("configuration", "on a manifold", why)


def _path(run: Running) -> Choice:
    mechanism = run.mechanism
    active_set, nv = mechanism.active_set(run.state.active), mechanism.nv
    if active_set.is_sparse:
        model = active_set.model
        shared = f", {model.border} shared by many closures" if model.border else ""
        why = f"{nv} rates{shared}, bandwidth {model.width}; dense where the rank is uncertain"
        return Choice("factorisation", "sparse, linear in size", why)
    if mechanism.needs_matrix:
        return Choice("factorisation", "dense", "the integrator needs D as a matrix")
    why = f"few rates ({nv}) and rows ({active_set.m}), or redundant rows"
    return Choice("factorisation", "dense", why)


def _closure_rows(run: Running) -> Choice:
    m = run.rows.rows
    active_set = run.mechanism.active_set(run.state.active)
    if active_set.is_sparse and m:
        kind = "bordered banded QR" if active_set.model.border else "banded QR"
        return Choice("closure factorisation", kind, "see factorisation")
    if m == 0:
        return Choice("closure factorisation", "none", "no closure is active")
    if m < SOME_ROWS:
        return Choice("closure factorisation", "SVD", f"{m} rows, fewer than {SOME_ROWS}")
    where = f"the smallest σ is below {APART:g}" if m <= FEW_ROWS else "the rank is uncertain"
    return Choice("closure factorisation", "pivoted QR", f"{m} rows; SVD where {where}")


def _stabilisation(run: Running) -> Choice:
    if run.rows.rows == 0 and not run.can_latch:
        return Choice("stabilisation", "none", "no closure is active or can latch")
    if run.stepping.stabilisation == "baumgarte":
        rate = run.stepping.baumgarte_rate
        return Choice("stabilisation", "baumgarte", f"chosen by the scene, rate {rate:g} /s")
    return Choice("stabilisation", "projection", "after every substep, in the mass metric")


@dataclass(frozen=True, slots=True)
class ArraySize:
    """An array of a tick.

    Attributes:
        name: description of the content.
        shape: of the array.
        size_bytes: size of its data.
    """

    name: str
    shape: tuple[int, ...]
    size_bytes: int


def _arrays(run: Running) -> Iterator[tuple[str, Array]]:
    """Yield the arrays of a tick, with the closures that are active at the start."""
    mechanism = run.mechanism
    points, t = len(mechanism.point_names), run.analyser.rows.size
    yield "q", run.state.q
    yield "v", run.state.v
    active_set = mechanism.active_set(run.state.active)
    yield from zip(("model, integers", "model, reals"), active_set.constants, strict=True)
    yield "data of a configuration", np.empty(active_set.size)
    packed = Data(active_set.model.numbers, np.empty(active_set.size))
    views = {f"of which {name}": part.view(packed) for name, part in Data.parts.items()}
    yield from ((name, view) for name, view in views.items() if view.size)
    yield "workspace of a step", np.empty(work_size(mechanism.nq, mechanism.nv, points))
    terms = run.simulator.evaluate(run.state)
    yield "h", terms.bias_force
    yield "Ẇv", terms.closure_bias
    yield "J_h of each point", np.empty((points, 6, mechanism.nv))
    yield "wrenches of the task space", np.empty((t, t))
    yield "operational model for the controllers", np.empty(OperationalModelSample.layout.size)
    yield "device sample for the controllers", np.empty(DeviceSample.layout.size)
    held = device_for(run.scene).at_rest(terms.points[run.analyser.index].pose)
    yield "state of the device", held.flat


@dataclass(frozen=True, slots=True)
class Running:
    """Objects of a scene at its start.

    Attributes:
        scene: they are made from.
        simulator: steps the mechanism.
        state: initial state, loops closed.
        analyser: of the operational point that is held.
        rows: rows, rank and mobility of the closures active there.
        stepping: of the scene; its integrator is not ``auto``.
    """

    scene: Scene
    simulator: Simulator
    state: MechanismState
    analyser: Analyser
    rows: Redundancy
    stepping: Simulation

    @property
    def mechanism(self) -> Mechanism:
        """The simulator's mechanism."""
        return self.simulator.mechanism

    @property
    def can_latch(self) -> tuple[str, ...]:
        """Names of the open closures that latch when their frames come near each other."""
        return tuple(
            loop.name
            for loop, on in zip(self.mechanism.closures, self.state.active, strict=True)
            if not on and loop.latch_distance is not None
        )


@dataclass(frozen=True, slots=True)
class ClosurePlan:
    """One closure of the scene.

    Attributes:
        name, kind: as in the scene.
        rows: number of scalar constraints.
        active: whether it is active at the start.
        can_latch: whether it is open and latches when its frames come near each other.
        redundant: names of rows that depend on those before them, at the start.
    """

    name: str
    kind: str
    rows: int
    active: bool
    can_latch: bool
    redundant: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ScenePlan:
    """The plan of a scene.

    Attributes:
        scene: name.
        topology: ``closed`` if a closure is active at the start; else ``serial`` if each joint
            follows the one before, or ``branched``.
        joints: number of moving joints by type.
        still_joints: number of fixed and locked joints, whose links are merged with their parents.
        nq, nv: length of configuration and of rates.
        task_space: ``planar`` or ``spatial``.
        task_rows: number of its rows in a six-vector.
        gravity: (3,) m/s².
        points: operational points.
        analysed: the operational point that is held.
        closures: in the scene's order.
        rows: m of all closures together.
        active_rows: m of the closures active at the start.
        rank: r of these rows at the start.
        mobility: nv - r.
        redundant_rows: names of the m - r redundant rows.
        elements: number of passive elements by kind; dampers and efforts by degree of freedom.
        integrator: name.
        stages: of the integrator.
        period: s.
        substeps: steps of the integrator in a period.
        choices: methods chosen where there are alternatives.
        arrays: of a tick, with their sizes.
    """

    scene: str
    topology: str
    joints: Mapping[str, int]
    still_joints: int
    nq: int
    nv: int
    task_space: str
    task_rows: int
    gravity: tuple[float, ...]
    points: tuple[str, ...]
    analysed: str
    closures: tuple[ClosurePlan, ...]
    rows: int
    active_rows: int
    rank: int
    mobility: int
    redundant_rows: tuple[str, ...]
    elements: Mapping[str, int]
    integrator: str
    stages: int
    period: float
    substeps: int
    choices: tuple[Choice, ...]
    arrays: tuple[ArraySize, ...]


def plan_scene(scene: Scene, point: str = "") -> ScenePlan:
    """Return the plan of a scene.

    Args:
        scene: validated.
        point: operational point that is held; the scene's first one if empty.

    Raises:
        InvalidInputError: no such point.
        ClosureError: the scene cannot close.
    """
    simulator = Simulator(scene)
    mechanism = simulator.mechanism
    analyser, state = Analyser(mechanism, point), simulator.initial_state()
    rows = redundancy(mechanism, state.q, state.active)
    stepping = simulator.scene.simulation
    run = Running(scene, simulator, state, analyser, rows, stepping)
    return ScenePlan(
        scene=scene.name,
        topology=_topology(run),
        joints=dict(Counter(mechanism.tree.joint_types)),
        still_joints=len(scene.links) - len(mechanism.tree.joints),
        nq=mechanism.nq,
        nv=mechanism.nv,
        task_space=scene.task_space,
        task_rows=int(run.analyser.rows.size),
        gravity=tuple(mechanism.model.gravity.linear.tolist()),
        points=mechanism.point_names,
        analysed=run.analyser.point.name,
        closures=_closures(run),
        rows=sum(loop.rows for loop in mechanism.closures),
        active_rows=rows.rows,
        rank=rows.rank,
        mobility=rows.mobility,
        redundant_rows=rows.redundant,
        elements=_elements(run),
        integrator=stepping.integrator,
        stages=len(SCHEMES[stepping.integrator].weights),
        period=stepping.period,
        substeps=stepping.substeps,
        # One that is added to the solver must be added here.
        choices=(
            _integrator(run),
            _configuration(run),
            _path(run),
            _closure_rows(run),
            _stabilisation(run),
        ),
        arrays=tuple(ArraySize(name, a.shape, a.nbytes) for name, a in _arrays(run)),
    )


def _topology(run: Running) -> str:
    if run.rows.rows:
        return "closed"
    carried = Counter(list(run.mechanism.model.parents)[1:])
    return "serial" if max(carried.values()) == 1 else "branched"


def _closures(run: Running) -> tuple[ClosurePlan, ...]:
    redundant = {closure.name: closure.redundant for closure in run.rows.closures}
    return tuple(
        ClosurePlan(
            loop.name,
            loop.kind,
            loop.rows,
            on,
            loop.name in run.can_latch,
            redundant.get(loop.name, ()),
        )
        for loop, on in zip(run.mechanism.closures, run.state.active, strict=True)
    )


def _elements(run: Running) -> dict[str, int]:
    elements = run.mechanism.elements
    joints = [element.joint for element in elements.joints]
    return {
        "dampers": int(np.count_nonzero(run.mechanism.tree.damping)),
        "springs in joints": sum(joint.stiffness > 0.0 for joint in joints),
        "springs between points": len(elements.springs),
        "friction": sum(joint.friction > 0.0 for joint in joints),
        "stops": sum(joint.limits is not None for joint in joints),
        "efforts": int(np.count_nonzero(elements.effort)),
    }
