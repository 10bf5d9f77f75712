# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What contacts cost in a step: a pair out of reach, points on a floor, MuJoCo beside.

``python -m benchmarks.contacts``: CPU times of calls from Python, a period each, taken in turn
round by round, so that what else the machine does is met by all of them alike.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.machine import cpu_times, machine, speed_line
from benchmarks.speed.mujoco_peer import MujocoScene, at_start
from benchmarks.speed.mujoco_peer import stepping as mj_stepping
from hapticmech_ros.cli import run_app
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import Scene, document_of, scene_from_document
from hapticmech_ros.simulation import Simulator

# Steps of a round; so many before the first one, for boxes to come to rest.
STEPS, BEFORE = 200, 200
SIZE, MASS = 0.1, 1.0
LAW = {"stiffness": 1e5, "damping": 50.0, "friction": 0.5}
FLOOR = {"name": "floor", "link": "world", "geometry": {"kind": "half_space"}}


def out_of_reach(name: str, substeps: int) -> tuple[Scene, Scene]:
    """Return a scene of the library with a ball 10 m above a floor, and without both."""
    document: dict[str, Any] = document_of(load_scene(name))
    document["simulation"] |= {"substeps": substeps}
    low = {"xyz": [0.0, 0.0, -10.0]}
    ball = {"name": "ball", "link": document["links"][-1]["name"]}
    pair = {"name": "touch", "a": "ball", "b": "floor", **LAW}
    shapes = [FLOOR | {"origin": low}, ball | {"geometry": {"kind": "sphere", "radius": 0.01}}]
    with_pair = document | {"shapes": shapes, "contacts": [pair]}
    return scene_from_document(with_pair), scene_from_document(document)


def boxes_on_floor(count: int, touching: bool = True) -> Scene:
    """Return boxes beside each other on a floor, four points each, or where there is none."""
    moment = MASS * SIZE * SIZE / 6.0
    names = [f"box{index}" for index in range(count)]
    links = [
        {
            "name": name,
            "joint": {"name": f"of_{name}", "type": "free"},
            "inertial": {
                "mass": MASS,
                "inertia": dict.fromkeys(("ixx", "iyy", "izz"), moment),
            },
        }
        for name in names
    ]
    box = {"kind": "box", "size": [SIZE] * 3}
    shapes = [{"name": f"{name}_shape", "link": name, "geometry": box} for name in names]
    pairs = [{"name": f"{name}_down", "a": f"{name}_shape", "b": "floor", **LAW} for name in names]
    places = {
        f"of_{name}": [2.0 * SIZE * index, 0.0, 0.5 * SIZE, 0.0, 0.0, 0.0, 1.0]
        for index, name in enumerate(names)
    }
    return scene_from_document(
        {
            "format": "hapticmech-scene/1",
            "name": f"boxes{count}",
            "gravity": [0.0, 0.0, -9.81] if touching else [0.0, 0.0, 0.0],
            "links": links,
            "operational_points": [{"name": "held", "link": names[0]}],
            "shapes": [FLOOR, *shapes] if touching else [],
            "contacts": pairs if touching else [],
            "initial_state": {"q": places},
            "hand": {"kind": "constant_wrench"},
        }
    )


def stepping(scene: Scene) -> Callable[[], None]:
    """Return what steps a scene ``STEPS`` times from where it has come to rest."""
    simulator = Simulator(scene)
    calm = np.zeros((len(scene.operational_points), 6))
    begun = simulator.initial_state()
    for _ in range(BEFORE if scene.contacts else 0):
        begun = simulator.step(begun, calm)

    def call() -> None:
        state = begun
        for _ in range(STEPS):
            state = simulator.step(state, calm)

    return call


def in_mujoco(scene: Scene) -> Callable[[], None]:
    """Return what steps the same boxes in MuJoCo, called once a step from Python as well."""
    import mujoco

    bare = scene.model_copy(update={"contacts": (), "shapes": ()})
    converted = MujocoScene(bare)
    spec: Any = converted.spec
    spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    # Declared pairs alone: what is in the world against what moves.
    for shape in scene.shapes:
        still = shape.link == "world"
        floor = spec.worldbody, mujoco.mjtGeom.mjGEOM_PLANE, [0.0, 0.0, 1.0]
        box = spec.body(shape.link), mujoco.mjtGeom.mjGEOM_BOX, [0.5 * SIZE] * 3
        body, kind, size = floor if still else box
        body.add_geom(type=kind, size=size, contype=still, conaffinity=not still, mass=0.0)
    model, data = at_start(converted, bare)
    for _ in range(BEFORE):
        mujoco.mj_step(model, data)
    points = 4 * len(scene.contacts)
    if data.ncon != points or not data.nefc:
        raise RuntimeError(f"MuJoCo has {data.ncon} points where there are {points}")
    return mj_stepping(model, data, STEPS)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@app.command(help=__doc__)
def contacts(rounds: Annotated[int, typer.Option(help="rounds that medians are of")] = 40) -> None:
    """Print a table, in µs a step."""
    callers: dict[str, Callable[[], None]] = {}
    for substeps in (1, 4):
        pair, alone = out_of_reach("five_bar", substeps)
        callers[f"five_bar, {substeps} substeps, pair out of reach"] = stepping(pair)
        callers[f"five_bar, {substeps} substeps, no pair"] = stepping(alone)
    for count in (1, 2):
        boxes, points = boxes_on_floor(count), 4 * count
        callers[f"{points} points on a floor"] = stepping(boxes)
        callers[f"{points} points, no floor"] = stepping(boxes_on_floor(count, touching=False))
        callers[f"{points} points, mj_step"] = in_mujoco(boxes)
    costs = {}
    for name, taken in cpu_times(callers, rounds).items():
        costs[name], p90 = 1e6 * np.quantile(taken / STEPS, (0.5, 0.9))
        print(f"{name:45} {costs[name]:8.1f} {p90:8.1f}")
    for substeps in (1, 4):
        name = f"five_bar, {substeps} substeps"
        cost = (costs[f"{name}, pair out of reach"] - costs[f"{name}, no pair"]) / substeps
        print(f"a pair out of reach, per substep of {substeps}: {cost:.2f}")
    print(speed_line(machine()))


if __name__ == "__main__":
    run_app(app)
