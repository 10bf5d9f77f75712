# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A still picture of a scene, where it starts or elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hapticmech_ros.errors import ClosureError, SceneError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.inertia import is_massless
from hapticmech_ros.mechanism.model import authored_state
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.observation import rigid_count
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.contacts import Mesh, Shape
from hapticmech_ros.scene.mechanism import Inertia, Inertial
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.view.drawn import SIDE_PIXELS, draw_shapes
from hapticmech_ros.view.palette import hues
from hapticmech_ros.view.picture import Picture, Snapshot, UserSnapshot
from hapticmech_ros.view.placement import Placer
from hapticmech_ros.view.shapes import Hulls

# Behind the name of a scene that is drawn as it is written.
OPEN = "open as written: its loops do not close"


def draw_scene(
    scene: Scene,
    path: Path,
    point: str = "",
    side_pixels: int = SIDE_PIXELS,
    besides: Sequence[Shape] = (),
) -> None:
    """Write a picture of a scene at its start as a PNG file.

    The mechanism, its closures, and at each point held the directions that are rigid and free. Of a
    scene that cannot close, its loops as they are open in the configuration that is written; of one
    without any mass nothing else either.

    Args:
        scene: to draw.
        path: of the file; its folder is made.
        point: operational point that is held; those of the scene's hands, or its first one, if
            empty.
        side_pixels: width and height.
        besides: further shapes to draw, such as those of its model that no contact names.

    Raises:
        InvalidInputError: no such point.
        ClosureError: the scene cannot close; the picture is written before.
        SceneError: a mesh that cannot be read.
    """
    if is_massless(scene):
        drawn = weighed(scene.model_copy(update={"shapes": (*scene.shapes, *besides)}))
        q = authored_state(drawn, Mechanism(drawn).tree)[0]
        draw_configuration(drawn, q, path, side_pixels, "no link has a mass")
        return
    simulator = Simulator(scene)
    mechanism = simulator.mechanism
    try:
        state = simulator.initial_state()
    except ClosureError:
        draw_configuration(scene, authored_state(scene, mechanism.tree)[0], path, side_pixels, OPEN)
        raise
    terms, users = simulator.evaluate(state), []
    for name in (point,) if point else scene.held_points:
        analyser = Analyser(mechanism, name)
        analysis = analyser.analyse(terms)
        count = rigid_count(analysis.spectrum.s, scene.perception)
        users.append(UserSnapshot(analyser.point.name, analysis=analysis, count=count))
    snapshot = Snapshot(state.active, tuple(users))
    drawn = scene.model_copy(update={"shapes": (*scene.shapes, *besides)})
    shown = Mechanism(drawn) if besides else mechanism
    _draw(shown, snapshot, np.array(state.q), path, side_pixels, "")


def weighed(scene: Scene) -> Scene:
    """Return a scene each of whose links weighs something, to be drawn and no more."""
    some = Inertial(mass=1.0, inertia=Inertia(ixx=1.0, iyy=1.0, izz=1.0))
    links = tuple(link.model_copy(update={"inertial": some}) for link in scene.links)
    return scene.model_copy(update={"links": links})


def draw_configuration(
    scene: Scene, q: Array, path: Path, side_pixels: int = SIDE_PIXELS, note: str = ""
) -> None:
    """Write a picture of a scene in a configuration, with loops that may be open, as a PNG file.

    Args:
        scene: to draw.
        q: (nq,) configuration.
        path: of the file; its folder is made.
        side_pixels: width and height.
        note: behind the scene's name; if there is one, loops are drawn as open.
    """
    mechanism = Mechanism(scene)
    active = tuple(on and not note for on in mechanism.initially_active)
    _draw(mechanism, Snapshot(active), q, path, side_pixels, note)


def readable(shapes: Sequence[Shape]) -> tuple[list[Shape], list[SceneError]]:
    """Return the shapes that can be drawn, and why others cannot: meshes that cannot be read."""
    from hapticmech_ros.contact.hull import read_mesh

    kept, errors = [], []
    for shape in shapes:
        try:
            if isinstance(shape.geometry, Mesh):
                read_mesh(shape.geometry.file, shape.geometry.scale, shape.name)
            kept.append(shape)
        except SceneError as error:
            errors.append(error)
    return kept, errors


def _draw(
    mechanism: Mechanism, snapshot: Snapshot, q: Array, path: Path, side_pixels: int, note: str
) -> None:
    scene, placement = mechanism.scene, Placer(mechanism).at(q)
    shapes = Picture(mechanism, 0.0, 0.0).draw(snapshot, placement)
    shapes += Hulls(scene).draw(placement)
    path.parent.mkdir(parents=True, exist_ok=True)
    title = "  ·  ".join(words for words in (scene.name, note) if words)
    users = hues([user.point for user in snapshot.users])
    draw_shapes(shapes, path, scene.task_space == "planar", title, side_pixels, users)
