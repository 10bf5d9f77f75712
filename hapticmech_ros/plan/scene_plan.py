# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a scene, taken from the objects that run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.plan.arrays import ArraySize, arrays_of_tick
from hapticmech_ros.plan.choices import Choice, choices
from hapticmech_ros.plan.running import Running, running
from hapticmech_ros.plan.tick import TickPart, parts_of_tick
from hapticmech_ros.scene import Scene


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
        tick: what a tick computes and omits.
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
    tick: tuple[TickPart, ...]
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
    run = running(scene, point)
    mechanism, rows, stepping = run.mechanism, run.rows, run.stepping
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
        stages=len(run.scheme.weights),
        period=stepping.period,
        substeps=stepping.substeps,
        choices=tuple(choices(run)),
        tick=parts_of_tick(run),
        arrays=arrays_of_tick(run),
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
        "dampers": int(np.count_nonzero(elements.damping)),
        "springs in joints": sum(joint.stiffness > 0.0 for joint in joints),
        "springs between points": len(elements.springs),
        "friction": sum(joint.friction > 0.0 for joint in joints),
        "stops": sum(joint.limits is not None for joint in joints),
        "efforts": int(np.count_nonzero(elements.effort)),
    }
