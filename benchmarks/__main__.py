"""``python -m benchmarks``: what developers measure about the package."""

from __future__ import annotations

import typer

from benchmarks.ablation.benchmark import ablation
from benchmarks.accuracy.benchmark import accuracy
from benchmarks.graph.benchmark import graph
from benchmarks.graph.kills import kills
from benchmarks.memory.benchmark import memory
from benchmarks.speed.benchmark import speed
from hapticmech_ros.cli import run_app

app = typer.Typer(
    name="python -m benchmarks",
    help="Benchmarks: they check that results agree first, then time. Faults of every kind:"
    " python -m benchmarks.reliability.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (accuracy, ablation, graph, kills, memory, speed):
    app.command()(command)


if __name__ == "__main__":
    run_app(app)
