# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech scene``: checks and descriptions of a scene, before it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hapticmech_ros.cli.commands import Commands
from hapticmech_ros.cli.console import (
    ChangesOption,
    SceneArgument,
    errors,
    progress,
    progress_of,
    say,
)

app = Commands(
    "List, check, draw, assemble, plan and copy scenes.", "scene list", "scene check door"
)


@app.command("plan", "scene plan five_bar", "scene plan ur5e --json")
def plan(
    scene: SceneArgument,
    point: Annotated[
        str, typer.Option(help="operational point held", show_default="the scene's first")
    ] = "",
    json_only: Annotated[
        bool, typer.Option("--json", help="print the plan as JSON, and nothing else")
    ] = False,
    changes: ChangesOption = None,
) -> None:
    """Print how SCENE is computed: its numbers, which methods are used, and why."""
    from hapticmech_ros.cli.scene_tables import show_plan
    from hapticmech_ros.loading import load_scene
    from hapticmech_ros.plan.scene_plan import plan_scene

    found = plan_scene(load_scene(scene, changes=changes or ()), point)
    if json_only:
        import json
        from dataclasses import asdict

        print(json.dumps(asdict(found), ensure_ascii=False))
    else:
        show_plan(found)


@app.command("list", "scene list")
def list_scenes() -> None:
    """List the scenes that come with the package."""
    from hapticmech_ros.cli.scene_tables import show_scenes
    from hapticmech_ros.loading import load_scene, shipped_scenes

    show_scenes([(name, load_scene(path).description) for name, path in shipped_scenes().items()])


@app.command("check", "scene check door", "scene check examples/pantograph.urdf")
def check(
    scene: SceneArgument,
    json_only: Annotated[
        bool, typer.Option("--json", help="print the result as JSON, and nothing else")
    ] = False,
    seconds: Annotated[
        float, typer.Option(min=0.0, help="leave out results on its steps after so long, s")
    ] = 10.0,
    changes: ChangesOption = None,
) -> None:
    """Print a summary of SCENE, unused parts of its model file, and possible problems."""
    import time

    from hapticmech_ros.cli.scene_tables import show_check
    from hapticmech_ros.formats import left_out
    from hapticmech_ros.loading import find_scene, load_scene
    from hapticmech_ros.plan.scene_plan import check_scene

    ends = time.monotonic() + seconds
    loaded = load_scene(scene, changes=changes or ())
    with errors.status("scene") as status:
        found = check_scene(loaded, lambda: time.monotonic() > ends, status.update)
    left = left_out(find_scene(scene))
    if json_only:
        import json
        from dataclasses import asdict

        notes = [str(note) for note in left.notes]
        print(json.dumps({**asdict(found), "notes": notes, "model_shapes": left.shapes}))
    else:
        show_check(found, left)


@app.command("steps", "scene steps two_link", "scene steps five_bar --error 1e-5 --out fast.yaml")
def steps(
    scene: SceneArgument,
    error: Annotated[
        float, typer.Option(help="largest error of the operational point that is wanted, m")
    ] = 1e-6,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="copy of SCENE with the fastest settings, to write"),
    ] = None,
    json_only: Annotated[
        bool, typer.Option("--json", help="print the result as JSON, and nothing else")
    ] = False,
    changes: ChangesOption = None,
) -> None:
    """Try all integrators on SCENE's experiment: which takes the least time at a wanted error."""
    import json
    import time

    from hapticmech_ros.analysis.study import plain
    from hapticmech_ros.cli.scene_tables import show_steps
    from hapticmech_ros.loading import load_scene
    from hapticmech_ros.loading.loader import copy_scene
    from hapticmech_ros.plan.step_accuracy import step_choices

    loaded = load_scene(scene, changes=changes or ())
    with progress() as bar:
        task = bar.add_task("", total=1.0)
        found = step_choices(
            loaded,
            error,
            time.process_time,
            lambda what, share: bar.update(task, description=what, completed=share),
        )
    if json_only:
        print(json.dumps(plain(found), allow_nan=False))
    else:
        show_steps(found)
    if found.best is None:
        raise typer.Exit(1)
    if out is not None:
        keys = {"integrator": found.best.integrator, "substeps": found.best.substeps}
        chosen = [f"simulation.{key}={value}" for key, value in keys.items()]
        copy_scene(scene, out, [*(changes or ()), *chosen])
        if not json_only:
            say(out)


@app.command("show", "scene show door", "scene show five_bar --out five_bar.gif")
def show(
    scene: SceneArgument,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="PNG file; or GIF or WebP file, of SCENE's experiment",
            show_default="SCENE's name",
        ),
    ] = None,
    point: Annotated[
        str,
        typer.Option(
            help="operational point held",
            show_default="what the scene's hands hold, or its first one",
        ),
    ] = "",
    pixels: Annotated[
        int | None,
        typer.Option(
            min=100, max=5000, help="width and height", show_default="1050; of a film 480"
        ),
    ] = None,
    changes: ChangesOption = None,
) -> None:
    """Draw SCENE: the points held, and their rigid and free directions."""
    from hapticmech_ros.errors import ClosureError
    from hapticmech_ros.formats import drawn_shapes
    from hapticmech_ros.live.film import FILM_PIXELS, FILMS, draw_experiment
    from hapticmech_ros.loading import find_scene, load_scene
    from hapticmech_ros.view.drawn import SIDE_PIXELS
    from hapticmech_ros.view.still import draw_scene, readable

    loaded = load_scene(scene, changes=changes or ())
    path = Path(f"{loaded.name}.png") if out is None else out
    if path.suffix in FILMS:
        with progress_of("drawing") as show_done:
            draw_experiment(scene, path, changes or (), point, pixels or FILM_PIXELS, show_done)
        say(path)
        return
    besides, unreadable = readable([one.shape for one in drawn_shapes(find_scene(scene))])
    for error in unreadable:
        say(f"not drawn: {error}")
    try:
        draw_scene(loaded, path, point, pixels or SIDE_PIXELS, besides)
    except ClosureError:
        say(f"as written: {path}")
        raise
    say(path)


@app.command("assemble", "scene assemble five_bar", "scene assemble bricard --picture closed.png")
def assemble(
    scene: SceneArgument,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="copy of SCENE that starts closed, to make")
    ] = None,
    starts: Annotated[int, typer.Option(min=1, help="how many starts to try at most")] = 200,
    processes: Annotated[
        int | None, typer.Option(min=1, help="default: one for each core", show_default=False)
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="PNG file of the configuration found, or least open")
    ] = None,
    changes: ChangesOption = None,
) -> None:
    """Find configurations in which the loops of SCENE are closed."""
    from hapticmech_ros.cli.scene_tables import show_assemblies
    from hapticmech_ros.loading import load_scene
    from hapticmech_ros.loading.loader import copy_scene
    from hapticmech_ros.offline.assembly_search import initial_state, search_assemblies

    loaded = load_scene(scene, changes=changes or ())
    with progress() as bar:
        task = bar.add_task("starts", total=starts)
        found = search_assemblies(
            loaded,
            starts,
            processes,
            show=lambda done, closed: bar.update(
                task, completed=done, description=f"starts, {closed} closed"
            ),
        )
    show_assemblies(loaded, found)
    if picture is not None:
        from hapticmech_ros.view.still import draw_configuration

        draw_configuration(loaded, found.open_q, picture)
        say(picture)
    if not found.found:
        raise typer.Exit(1)
    if out is not None:
        start = initial_state(loaded, found.found[0].q)
        copy_scene(scene, out, [*(changes or ()), f"initial_state={start}"])
        say(out)


@app.command("copy", "scene copy five_bar mine.yaml", "scene copy ur5e mine.yaml --expanded")
def copy(
    scene: SceneArgument,
    out: Annotated[Path, typer.Argument(help="YAML file to make")],
    changes: ChangesOption = None,
    expanded: Annotated[
        bool, typer.Option("--expanded", help="a linkage or model expanded to links")
    ] = False,
) -> None:
    """Write a copy of SCENE with other values, for nodes and for editing."""
    from hapticmech_ros.loading.loader import copy_scene

    copy_scene(scene, out, changes or (), expanded)
    say(out)


@app.command("schema", "scene schema", "scene schema --markdown")
def schema(
    markdown: Annotated[
        bool, typer.Option("--markdown", help="every key as tables, as in docs/scene-keys.md")
    ] = False,
) -> None:
    """Print the JSON Schema of scene files, for editors."""
    import json

    from hapticmech_ros.loading import load_scene, shipped_scenes
    from hapticmech_ros.scene.key_reference import examples, key_reference, scene_schema

    if markdown:
        scenes = [load_scene(name) for name in shipped_scenes()]
        print(key_reference(scene_schema(), examples(scenes)), end="")
        return
    print(json.dumps(scene_schema(), indent=2, ensure_ascii=False))
