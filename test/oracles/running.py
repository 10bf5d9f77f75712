# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scene documents with a start and a step, run by the package's simulator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from pydantic import BaseModel

from hapticmech_ros.mechanism.motion import ExternalWrenches
from hapticmech_ros.scene import scene_from_document
from hapticmech_ros.simulation import MechanismState, Simulator
from oracles.generator import RATE_SIZE, floats
from oracles.kinematics import POSITION_SIZE, Array, Document

Part = TypeVar("Part", bound=BaseModel)


def varied(part: Part, **changes: object) -> Part:
    """Return a part of a scene with other values, not validated; a dictionary is of its part."""
    inner = {
        key: varied(own, **value) if isinstance(own := getattr(part, key), BaseModel) else value
        for key, value in changes.items()
        if isinstance(value, dict)
    }
    return part.model_copy(update=changes | inner)


def with_start(document: Document, q: Array, v: Array | None = None) -> Document:
    """Return the scene with (q, v) authored joint by joint."""
    start: Document = {"q": {}, "v": {}}
    for key, values, sizes in (("q", q, POSITION_SIZE), ("v", v, RATE_SIZE)):
        at = 0
        for link in document["links"] if values is not None else ():
            size = sizes[link["joint"]["type"]]
            part = floats(values[at : at + size])
            at += size
            if size:
                start[key][link["joint"]["name"]] = part[0] if size == 1 else part
    return document | {"initial_state": start}


def with_joints(document: Document, **parts: object) -> Document:
    """Return the document with these values in each of its hinges and slides."""
    links = [
        link | {"joint": link["joint"] | parts}
        if link["joint"]["type"] in ("revolute", "prismatic")
        else link
        for link in document["links"]
    ]
    return document | {"links": links}


def simulator(
    document: Document, period: float = 1e-3, integrator: str = "rk4", **simulation: object
) -> Simulator:
    """Return a simulator of the document with another step, and other keys of ``simulation``."""
    step = {"period": period, "integrator": integrator, **simulation}
    return Simulator(scene_from_document(document | {"simulation": step}))


def wrenches_on(sim: Simulator, **points: Sequence[float]) -> Array:
    """Return wrenches (points, 6) that are zero but on points that are named."""
    return np.array([points.get(name, np.zeros(6)) for name in sim.mechanism.point_names])


def unpushed(sim: Simulator) -> ExternalWrenches:
    """Return what a step takes where nothing is pushed."""
    return ExternalWrenches(wrenches_on(sim))


def run(sim: Simulator, duration: float, wrenches: Array | None = None) -> list[MechanismState]:
    """Return the states from the start to ``duration``, wrenches held (points, 6)."""
    held = wrenches_on(sim) if wrenches is None else wrenches
    states = [sim.initial_state()]
    for _ in range(round(duration / sim.period)):
        states.append(sim.step(states[-1], held))
    return states


def total_energy(sim: Simulator, state: MechanismState) -> float:
    """Return kinetic and potential energy, J."""
    return sum(sim.mechanism.energy(state.q, state.v))


def unaccounted(sim: Simulator, states: list[MechanismState]) -> Array:
    """Return energy now - at the start - work in + losses, J, for every state."""
    energies = np.array([total_energy(sim, state) for state in states])
    accounts = [state.account for state in states]
    bought = np.array([a.work_in - a.damping_loss - a.latch_loss for a in accounts])
    return energies - energies[0] - bought
