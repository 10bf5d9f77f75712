"""The ``hapticmech`` command."""

from __future__ import annotations

import signal
import sys
import threading
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from hapticmech_ros.errors import HapticMechError

app = typer.Typer(
    name="hapticmech",
    help="Feel virtual mechanisms: run the graph of nodes, and the paper's experiment.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
console = Console()
errors = Console(stderr=True)

SceneArgument = Annotated[str, typer.Argument(help="shipped scene, or path of a YAML file")]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="folder for the results")]
CHECK_PERIOD_S = 0.2


def _show_version(wanted: bool) -> None:
    if wanted:
        console.print(version("hapticmech_ros"))
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="show version")
    ] = False,
) -> None:
    return


@app.command()
def run(
    scene: SceneArgument = "five_bar",
    composed: Annotated[bool, typer.Option(help="all four nodes in one process")] = False,
    namespace: Annotated[str, typer.Option(help="put nodes and topics under this name")] = "",
) -> None:
    """Start the four nodes on SCENE and keep them running until Ctrl-C."""
    from hapticmech_ros.graph import Graph
    from hapticmech_ros.scene import load_scene

    load_scene(scene)
    stop = threading.Event()
    # Also where a shell has switched SIGINT off, as for jobs in the background.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    with Graph(scene, composed, namespace) as graph:
        console.print(f"running {scene}; Ctrl-C ends it")
        while not stop.wait(CHECK_PERIOD_S):
            graph.check()


@app.command()
def demo(
    scene: SceneArgument = "five_bar",
    out: OutOption = Path("demo"),
    composed: Annotated[bool, typer.Option(help="all four nodes in one process")] = False,
    duration: Annotated[float | None, typer.Option(help="s after the hand starts", min=0.1)] = None,
    storage: Annotated[str, typer.Option(help="mcap or sqlite3")] = "mcap",
) -> None:
    """Run the paper's experiment over ROS: graph, bag, figures, summary."""
    from hapticmech_ros.experiment.demo import run_demo

    with _progress() as bar:
        task = bar.add_task("starting the graph", total=None)

        def show(stage: str, done: float | None) -> None:
            bar.update(task, description=stage, total=1.0 if done is not None else None)
            if done is not None:
                bar.update(task, completed=done)

        summary = run_demo(scene, out, composed, duration, storage, show)
    _print_results(summary, out)


@app.command()
def experiment(
    scene: SceneArgument = "five_bar",
    out: OutOption = Path("experiment"),
    duration: Annotated[float | None, typer.Option(help="s after the hand starts", min=0.1)] = None,
) -> None:
    """Run the same experiment in one process, without ROS."""
    from hapticmech_ros.experiment.from_session import run_session
    from hapticmech_ros.experiment.run import write_results
    from hapticmech_ros.scene import load_scene

    loaded = load_scene(scene)
    with _progress() as bar:
        task = bar.add_task("simulating", total=1.0)
        record = run_session(loaded, duration, lambda share: bar.update(task, completed=share))
        bar.update(task, description="writing results")
        summary = write_results(record, loaded, out)
    _print_results(summary, out)


@app.command()
def topics() -> None:
    """Print the table of topics, as in docs/topics.md."""
    from hapticmech_ros.wire.table import markdown

    print(markdown(), end="")


def main() -> None:
    """Run the command; errors of ours are one clear message and exit code 1."""
    try:
        app()
    except HapticMechError as error:
        errors.print(f"error: {error}", style="red", highlight=False, markup=False)
        sys.exit(1)


def _progress() -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        console=console,
        transient=True,
    )


def _print_results(summary: dict[str, object], out: Path) -> None:
    from hapticmech_ros.experiment.report import table

    console.print(table(summary))
    console.print(f"results: {out.resolve()}", highlight=False, soft_wrap=True)
