# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ``hapticmech`` command: a file per family of sub-commands."""

from __future__ import annotations

import os
import sys
from importlib.metadata import version
from typing import Annotated

import typer

from hapticmech_ros.cli import (
    analyse,
    bag,
    device,
    experiment,
    feel,
    graph,
    live,
    replay,
    scene,
    study,
)
from hapticmech_ros.cli.console import errors, say
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.system.discovery import choose_discovery

app = typer.Typer(
    name="hapticmech",
    help="Feel virtual mechanisms: run the graph of nodes, and the paper's experiment.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        say(version("hapticmech_ros"))
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="show version")
    ] = False,
) -> None:
    return


for command in (
    graph.run,
    experiment.demo,
    experiment.experiment,
    graph.topics,
    graph.parameters,
    live.live,
    graph.policy,
    analyse.analyse,
    analyse.sweep,
    study.study,
):
    app.command()(command)
app.add_typer(feel.app, name="feel")
bag.app.command()(replay.replay)
app.add_typer(bag.app, name="bag")
app.add_typer(scene.app, name="scene")
app.add_typer(device.app, name="device")


def main() -> None:
    """Run the command ``hapticmech``."""
    run_app(app)


def run_app(commands: typer.Typer) -> None:
    """Run a command; errors of ours, and files, are one clear message and exit code 1."""
    choose_discovery(os.environ)
    try:
        commands()
    except HapticMechError as error:
        _end(str(error))
    except BrokenPipeError:
        # The reader of the output, such as `head`, has ended; Python must not write the rest.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:  # no permission, a full disk
        where = "" if error.filename is None else f"{error.filename}: "
        _end(f"{where}{error.strerror or error}")


def _end(reason: str) -> None:
    say(f"error: {reason}", "red", errors, hang=4)
    sys.exit(1)
