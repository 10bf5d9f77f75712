"""``hapticmech analyse``: what a recording felt like, over all its samples."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hapticmech_ros.cli.console import OutOption, console, progress


def analyse(
    bag: Annotated[Path, typer.Argument(help="bag folder, or one .mcap or .db3 file")],
    scene: Annotated[str, typer.Option(help="shipped scene, or path of a YAML file")] = "five_bar",
    point: Annotated[
        str, typer.Option(help="operational point", show_default="the scene's first")
    ] = "",
    topic: Annotated[
        str,
        typer.Option(
            help="joint states of any graph", show_default="mechanism/state, or measured_js"
        ),
    ] = "",
    namespace: Annotated[str, typer.Option(help="namespace of the graph")] = "",
    out: OutOption = Path("analysis"),
) -> None:
    """Compute Λ_h⁻¹, spectrum and count at every state of a recording: a table and a plot."""
    from hapticmech_ros.experiment.figure_style import save
    from hapticmech_ros.mechanism import build
    from hapticmech_ros.offline import analyse_states, states_from_bag
    from hapticmech_ros.offline.figure import analysis_figure
    from hapticmech_ros.scene import load_scene

    mechanism = build(load_scene(scene))
    states = states_from_bag(bag, mechanism, topic, namespace)
    begun = time.perf_counter()
    with progress() as bar:
        task = bar.add_task("analysing", total=states.stamps_ns.size)
        found = analyse_states(
            mechanism, states, point, lambda done, total: bar.update(task, completed=done)
        )
    taken = time.perf_counter() - begun
    out.mkdir(parents=True, exist_ok=True)
    table = found.save(out / "analysis.npz")
    picture = save(analysis_figure(found), out / "analysis.png")
    counts = ", ".join(str(count) for count in np.unique(found.count).tolist())
    console.print(
        f"{found.times.size} states of {states.topic}, {found.times[-1]:.3f} s:"
        f" analysed in {taken:.2f} s; joint constraints felt: {counts}",
        highlight=False,
    )
    console.print(f"{table}\n{picture}", highlight=False)
