# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m benchmarks``: what developers measure about the package."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from importlib import import_module

import typer

from hapticmech_ros.cli import run_app

COMMANDS = (
    "ablation",
    "accuracy",
    "graph",
    "haply",
    "live",
    "realtime",
    "robot",
    "session",
    "small_machine",
    "speed",
    "study",
)


def app_of(names: Iterable[str] = COMMANDS) -> typer.Typer:
    """Return the command line of benchmarks by their names."""
    app = typer.Typer(
        name="python -m benchmarks",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    for name in names:
        app.command(name)(getattr(import_module(f"benchmarks.{name}.benchmark"), name))

    @app.callback()
    def _options() -> None:
        """Check that results agree first, then time.

        Faults of every kind against the graph: python -m benchmarks.reliability.
        """

    return app


if __name__ == "__main__":
    # The libraries of a benchmark that is not asked for would count in the memory of one that is.
    run_app(app_of([name for name in COMMANDS if name in sys.argv[1:2]] or COMMANDS))
