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
    scene,
    study,
)
from hapticmech_ros.cli.commands import BAGS, GRAPH, SCENES, START, STUDIES, Commands
from hapticmech_ros.cli.console import errors, say
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.system.discovery import choose_discovery

app = Commands(
    "Feel virtual mechanisms: run the graph of nodes, and the paper's experiment.",
    "demo",
    "live five_bar",
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


for group, command, *examples in (
    (START, experiment.demo, "demo", "demo four_bar_closing --out demo/closing"),
    (START, experiment.experiment, "experiment", "experiment door --out session --duration 2"),
    (START, live.live, "live", "live examples/pantograph.yaml"),
    (GRAPH, graph.run, "run five_bar", "run door --view --record bags/door --duration 5"),
    (GRAPH, graph.topics, "topics", "topics --cpp"),
    (GRAPH, graph.parameters, "parameters"),
    (GRAPH, graph.policy, "policy", "policy --namespace /left"),
    (BAGS, analyse.analyse, "analyse bags/live", "analyse bags/live --scene door --out door"),
    (STUDIES, analyse.sweep, "sweep two_link --joint joint2=0:1:20"),
    (STUDIES, study.study, "study five_bar --vary device.mass=0.1:0.5:5"),
):
    app.command(None, *examples, group=group)(command)
for family, name, group in (
    (scene, "scene", SCENES),
    (device, "device", GRAPH),
    (bag, "bag", BAGS),
    (feel, "feel", STUDIES),
):
    app.add_typer(family.app, name=name, rich_help_panel=group)


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
