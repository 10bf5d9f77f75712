# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the command line prints, and the options that its commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from hapticmech_ros.discovery import Transport

console = Console()
errors = Console(stderr=True)

SceneArgument = Annotated[
    str, typer.Argument(help="shipped scene, or path of a YAML, URDF, MJCF or SDF file")
]
ChangesOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="key of the scene, any number of them"),
]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="folder for the results")]
ComposedOption = Annotated[bool, typer.Option(help="all four nodes in one process")]
TransportOption = Annotated[
    Transport, typer.Option(help="auto: between processes of this host directly")
]


def progress() -> Progress:
    """Return a bar that vanishes when it is done."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        console=console,
        transient=True,
    )


def words(text: str) -> tuple[str, ...]:
    """Return what stands between the commas of an option."""
    return tuple(word.strip() for word in text.split(",") if word.strip())
