# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the command line prints, and the options that its commands share.

Durations as people write them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from textwrap import fill
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.system.discovery import Transport

_UNITS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6}


def seconds_of(option: str, text: str) -> float:
    """Return a duration in s: ``50ms``, ``0.05s``, or a bare number of seconds.

    Args:
        option: that the text was given to.
        text: a number that is not negative, and a unit.

    Raises:
        InvalidInputError: it is no duration.
    """
    found = re.fullmatch(r"([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*(s|ms|us|)", text.strip())
    if found is None:
        raise InvalidInputError(option, text, "must be a duration such as 50ms or 0.05s")
    return float(found[1]) * _UNITS[found[2]]


def vector_of(option: str, text: str, parts: Sequence[str], rule: str) -> tuple[float, ...]:
    """Return the three numbers that the parts of an option's text are.

    Args:
        option: its name, for the error.
        text: as it was given.
        parts: of the text.
        rule: for the error.

    Raises:
        InvalidInputError: they are not three finite numbers.
    """
    try:
        found = tuple(map(float, parts))
    except ValueError:
        found = ()
    if len(found) != 3 or not all(map(math.isfinite, found)):
        raise InvalidInputError(option, text, rule)
    return found


# Names in tables are not folded up to this width, characters.
WIDEST_NAME = 60

console = Console()
errors = Console(stderr=True)


def say(text: object, style: str | None = None, where: Console = console, hang: int = 0) -> None:
    """Print text as it is; on a terminal, new lines begin between words.

    Args:
        text: of lines, none of which a program that reads them finds broken.
        style: of rich.
        where: standard output or error.
        hang: indentation of new lines, characters.
    """
    lines = str(text).splitlines()
    if where.is_terminal:
        lines = [
            fill(
                line,
                where.width,
                subsequent_indent=" " * hang,
                break_long_words=False,
                break_on_hyphens=False,
            )
            for line in lines
        ]
    where.print("\n".join(lines), style=style, highlight=False, markup=False, soft_wrap=True)


SceneArgument = Annotated[
    str, typer.Argument(help="shipped scene, or path of a YAML, URDF, MJCF or SDF file")
]
ChangesOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="key of the scene, any number of them"),
]
PointOption = Annotated[
    str, typer.Option(help="operational point", show_default="the scene's first")
]
OutOption = Annotated[Path, typer.Option("--out", "-o", help="folder for the results")]
ComposedOption = Annotated[bool, typer.Option(help="all four nodes in one process")]
TransportOption = Annotated[
    Transport,
    typer.Option(
        metavar="auto|middleware", help="auto: not through ROS 2 between nodes of this host"
    ),
]


def progress() -> Progress:
    """Return a bar on standard error that vanishes when it is done; nothing without a terminal."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeRemainingColumn(),
        console=errors,
        transient=True,
        disable=not errors.is_terminal,
        # Lines for a program stay on standard output.
        redirect_stdout=console.is_terminal,
    )


@contextmanager
def progress_of(what: str) -> Iterator[Callable[[float, float], None]]:
    """Show a bar, and yield the function to call with what is done, and all of it (0: unknown)."""
    with progress() as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, every: bar.update(task, completed=done, total=every or None)


def words(text: str) -> tuple[str, ...]:
    """Return the parts of an option, separated by commas."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def with_changes(scenes: Sequence[str], changes: Sequence[str] | None, out: Path) -> list[str]:
    """Return scenes, checked before anything is started; if some change, paths of changed copies.

    Copies are in the folder ``scenes`` of the results, for all processes, and as a record. Those of
    an earlier run are replaced.

    Args:
        scenes: names or paths.
        changes: ``key=value`` each, of every scene.
        out: folder for the results.

    Raises:
        SceneError: a bad scene or change.
    """
    from hapticmech_ros.loading.loader import copy_scene, load_scene

    if not changes:
        # Minutes of work on the first ones would be lost.
        for scene in scenes[1:]:
            load_scene(scene)
        return list(scenes)
    folder, made = out / "scenes", list[str]()
    folder.mkdir(parents=True, exist_ok=True)
    for number, scene in enumerate(scenes):
        copy = folder / f"{Path(scene).stem}.yaml"
        while str(copy) in made:
            copy = copy.with_name(f"{copy.stem}_{number}.yaml")
        # The source may be such a copy itself: it stays until the new one is whole.
        new = folder / f".{copy.name}"
        new.unlink(missing_ok=True)
        copy_scene(scene, new, changes)
        new.replace(copy)
        made.append(str(copy))
    return made
