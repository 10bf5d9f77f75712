# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech analyse`` and ``sweep``: felt dynamics over a recording, or over a motion."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hapticmech_ros.cli.console import (
    ChangesOption,
    OutOption,
    PointOption,
    SceneArgument,
    progress_of,
    say,
)
from hapticmech_ros.cli.study import ClusterOption, ProcessesOption, workers_of
from hapticmech_ros.errors import InvalidInputError

if TYPE_CHECKING:
    from hapticmech_ros.offline import PrescribedJoint


def analyse(
    bag: Annotated[Path, typer.Argument(help="bag folder, or one .mcap or .db3 file")],
    scene: Annotated[str, typer.Option(help="shipped scene, or path of a YAML file")] = "five_bar",
    point: PointOption = "",
    topic: Annotated[
        str,
        typer.Option(
            help="joint states of any graph", show_default="mechanism/state, or measured_js"
        ),
    ] = "",
    namespace: Annotated[str, typer.Option(help="namespace of the graph")] = "",
    out: OutOption = Path("analysis"),
) -> None:
    """Compute Λ_h⁻¹ and the number of joint constraints at every recorded state: table, plot."""
    import numpy as np

    from hapticmech_ros.experiment.figure_style import save
    from hapticmech_ros.loading import load_scene
    from hapticmech_ros.mechanism import Mechanism
    from hapticmech_ros.offline import analyse_states, states_from_bag
    from hapticmech_ros.offline.figure import analysis_figure

    mechanism = Mechanism(load_scene(scene))
    states = states_from_bag(bag, mechanism, topic, namespace)
    begun = time.perf_counter()
    with progress_of("analysing") as show:
        found = analyse_states(mechanism, states, point, show)
    taken = time.perf_counter() - begun
    out.mkdir(parents=True, exist_ok=True)
    table = found.save(out / "analysis.npz")
    picture = save(analysis_figure(found, mechanism.scene), out / "analysis.png")
    counts = ", ".join(str(count) for count in np.unique(found.count).tolist())
    say(
        f"{found.times.size} states of {states.topic}, {found.times[-1]:.3f} s:"
        f" analysed in {taken:.2f} s; joint constraints felt: {counts}"
    )
    for note in states.notes:
        say(note, "yellow")
    say(f"{table}\n{picture}")


def sweep(
    scene: SceneArgument,
    joint: Annotated[
        list[str], typer.Option(help="NAME=FROM:TO:NUMBER, rad or m; once per prescribed joint")
    ],
    point: PointOption = "",
    processes: ProcessesOption = 2,
    cluster: ClusterOption = "",
    changes: ChangesOption = None,
    out: OutOption = Path("sweep"),
) -> None:
    """Compute the inertia felt over a grid of joint positions, loops closed: table and plot."""
    from hapticmech_ros.experiment.figure_style import save
    from hapticmech_ros.loading import load_scene
    from hapticmech_ros.offline import sweep as run_sweep
    from hapticmech_ros.offline.figure import sweep_figure

    prescribed = [_prescribed(text) for text in joint]
    loaded = load_scene(scene, changes=changes or ())
    begun = time.perf_counter()
    places = math.prod(len(one.values) for one in prescribed)
    with workers_of(processes, cluster) as workers, progress_of("sweeping") as show:
        found = run_sweep(loaded, prescribed, point, workers, lambda done: show(done, places))
    taken = time.perf_counter() - begun
    out.mkdir(parents=True, exist_ok=True)
    table = found.save(out / "sweep.npz")
    picture = save(sweep_figure(found, prescribed, loaded), out / "sweep.png")
    say(f"{found.count.size} of {places} places reached and analysed in {taken:.2f} s")
    say(f"{table}\n{picture}")


def _prescribed(text: str) -> PrescribedJoint:
    """Return the contents of ``NAME=FROM:TO:NUMBER``.

    Raises:
        InvalidInputError: it does not.
    """
    import numpy as np

    from hapticmech_ros.offline import PrescribedJoint

    name, _, way = text.partition("=")
    try:
        first, last, number = way.split(":")
        values = np.linspace(float(first), float(last), int(number))
    except ValueError:
        raise InvalidInputError("--joint", text, "must be NAME=FROM:TO:NUMBER") from None
    return PrescribedJoint(name, tuple(values.tolist()))
