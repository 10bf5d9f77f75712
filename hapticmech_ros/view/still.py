"""A still picture of a scene, where it starts or elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.counter import rigid_count
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.view.drawn import SIDE_PIXELS, draw_shapes
from hapticmech_ros.view.picture import Picture, Snapshot
from hapticmech_ros.view.placement import Placer


def draw_scene(scene: Scene, path: Path, point: str = "", side_pixels: int = SIDE_PIXELS) -> None:
    """Write a picture of a scene at its start as a PNG file.

    The mechanism, its closures, and at the point held the directions that are rigid and free.

    Args:
        scene: what is drawn.
        path: of the file; its folder is made.
        point: operational point that is held; the scene's first one if empty.
        side_pixels: width and height.

    Raises:
        InvalidInputError: no such point.
        ClosureError: the scene cannot close.
    """
    simulator = Simulator(scene)
    mechanism, state = simulator.mechanism, simulator.initial_state()
    analyser = Analyser(mechanism, point)
    analysis = analyser.analyse(simulator.evaluate(state))
    count = rigid_count(analysis.spectrum.s, scene.perception)
    snapshot = Snapshot(state.active, held=analyser.point.name, analysis=analysis, count=count)
    _draw(mechanism, snapshot, np.array(state.q), path, side_pixels)


def draw_configuration(scene: Scene, q: Array, path: Path, side_pixels: int = SIDE_PIXELS) -> None:
    """Write a picture of a scene in a configuration, with loops that may be open, as a PNG file.

    Args:
        scene: what is drawn.
        q: (nq,) configuration.
        path: of the file; its folder is made.
        side_pixels: width and height.
    """
    mechanism = Mechanism(scene)
    _draw(mechanism, Snapshot(mechanism.initially_active), q, path, side_pixels)


def _draw(mechanism: Mechanism, snapshot: Snapshot, q: Array, path: Path, side_pixels: int) -> None:
    scene = mechanism.scene
    shapes = Picture(mechanism, 0.0, 0.0).draw(snapshot, Placer(mechanism).at(q))
    path.parent.mkdir(parents=True, exist_ok=True)
    draw_shapes(shapes, path, scene.task_space == "planar", scene.name, side_pixels)
