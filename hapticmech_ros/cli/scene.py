"""``hapticmech scene``: what a scene is, before it runs."""

from __future__ import annotations

from typing import Annotated

import typer

from hapticmech_ros.cli.console import SceneArgument

app = typer.Typer(help="Scenes: what one makes run.", no_args_is_help=True)


@app.callback()
def _options() -> None:
    """Scenes: what one makes run."""


@app.command()
def plan(
    scene: SceneArgument,
    point: Annotated[
        str, typer.Option(help="operational point held", show_default="the scene's first")
    ] = "",
    json_only: Annotated[
        bool, typer.Option("--json", help="print the plan as JSON, and nothing else")
    ] = False,
) -> None:
    """Print the plan compiled from SCENE: what a tick computes, what it leaves out, and why."""
    from hapticmech_ros.cli.scene_tables import show_plan
    from hapticmech_ros.plan import plan_scene
    from hapticmech_ros.scene import load_scene

    found = plan_scene(load_scene(scene), point)
    if json_only:
        import json
        from dataclasses import asdict

        print(json.dumps(asdict(found), ensure_ascii=False))
    else:
        show_plan(found)
