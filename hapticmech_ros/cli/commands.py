# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Commands whose help has names beside words, in groups, and examples.

typer's own gives types and negations columns of their own, and breaks words at 80 characters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from inspect import cleandoc
from typing import Any, TypeVar

import typer
from rich.table import Table
from rich.text import Text
from typer.core import TyperCommand, TyperGroup

from hapticmech_ros.cli.console import console, say

START, SCENES, GRAPH, BAGS, STUDIES = "Start here", "Scenes", "The graph", "Bags", "Studies"
GROUPS = ("Arguments", START, SCENES, GRAPH, BAGS, STUDIES, "Commands", "Options")

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


def show_help(command: Any, context: Any) -> None:
    """Print a command's help.

    Args:
        command: of typer, with examples in its epilog, a line each.
        context: of its call.
    """
    say(command.get_usage(context))
    for paragraph in cleandoc(command.help or "").split("\n\n"):
        say("\n" + " ".join(paragraph.split()))
    groups: dict[str, list[tuple[str, str]]] = {title: [] for title in GROUPS}
    for one in command.get_params(context):
        title = "Arguments" if one.param_type_name == "argument" else "Options"
        groups[title].append((_names(one), _words(one)))
    below = getattr(command, "commands", {})
    for name, one in below.items():
        title = one.rich_help_panel if one.rich_help_panel in GROUPS else "Commands"
        groups[title].append((name, " ".join(cleandoc(one.help or "").split("\n\n")[0].split())))
    wide = max(len(name) for rows in groups.values() for name, _ in rows)
    for title, rows in groups.items():
        if rows:
            say(f"\n{title}:", "bold")
            table = Table.grid(padding=(0, 2, 0, 0))
            table.add_column(width=wide + 2, no_wrap=True)
            for name, text in rows:
                table.add_row(Text(f"  {name}", style="cyan"), Text(text))
            console.print(table)
    if command.epilog:
        say("\nExamples:", "bold")
        for line in command.epilog.splitlines():
            say(f"  {line}", hang=6)


def _names(one: Any) -> str:
    """Return an argument's name, or an option's names, the short one first, and its value's."""
    if one.param_type_name == "argument":
        return str(one.name).upper()
    names = ", ".join(sorted(one.opts, key=len))
    return names if one.is_flag else f"{names} {one.metavar or 'VALUE'}"


def _words(one: Any) -> str:
    """Return an option's description with its default, unless that is nothing, zero or no."""
    value = one.default.value if isinstance(one.default, Enum) else one.default
    value = one.show_default if isinstance(one.show_default, str) else value
    default = f" [{value}]" if value and value is not True else ""
    return f"{one.help or ''}{' (required)' * one.required}{default}".strip()


class _Command(TyperCommand):
    def format_help(self, ctx: Any, formatter: object) -> None:
        show_help(self, ctx)


class _Group(TyperGroup):
    def format_help(self, ctx: Any, formatter: object) -> None:
        show_help(self, ctx)


class Commands(typer.Typer):
    """Commands, or families of them.

    Args:
        words: that describe them.
        examples: of their use, without ``hapticmech``.
    """

    def __init__(self, words: str, *examples: str) -> None:
        super().__init__(
            cls=_Group,
            help=words,
            epilog=_lines(examples),
            no_args_is_help=True,
            pretty_exceptions_enable=False,
            context_settings={"help_option_names": ["-h", "--help"]},
        )

    def command(  # type: ignore[override]
        self, name: str | None = None, *examples: str, group: str = ""
    ) -> Callable[[Decorated], Decorated]:
        """Return a decorator that adds a function as a command.

        Args:
            name: of the command; the function's if None.
            examples: of its use, without ``hapticmech``.
            group: of the help that it stands in.
        """
        epilog = _lines(examples)
        return super().command(name, cls=_Command, epilog=epilog, rich_help_panel=group)


def _lines(examples: Sequence[str]) -> str:
    return "\n".join(f"hapticmech {example}" for example in examples)
