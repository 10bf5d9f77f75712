# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a user has, one thing a line: ``python test/interface.py > test/interface.txt``.

Commands with their options, topics, services, parameters, scene keys, public names, and names of
files that are read or written. ``test_interface.py`` compares: what is gone or new is seen in a
diff, and is named in the CHANGELOG.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import typer

import hapticmech_ros
from hapticmech_ros.cli import app
from hapticmech_ros.nodes.parameter_table import markdown as parameters
from hapticmech_ros.scene.key_reference import key_reference, scene_schema
from hapticmech_ros.scene.part import Part
from hapticmech_ros.wire.table import markdown as topics

PACKAGE = Path(hapticmech_ros.__file__).parent
# Parts of which docs/api.md publishes names beside the package's own.
ROOMS = ("", ".bag", ".control", ".device", ".experiment", ".formats", ".offline", ".view")
FILE_NAME = re.compile(r"[\w-]+\.(csv|html|json|jsonl|md|mcap|npz|png|svg|txt|yaml|zip)")
# Of a method that passes services on the names are its own.
SERVICE = re.compile(
    r"(?<!super\(\)\.)(?<!def )create_service\(\s*(\w+), (?:f?\"([^\"]+)\"|([\w.]+))"
)


def rows(table: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the heading above each row of Markdown tables, and its cells."""
    heading = ""
    for line in table.splitlines():
        if line.startswith("#"):
            heading = line.strip("# ")
        elif line.startswith("| ") and not line.startswith(("| topic |", "| node |", "| key |")):
            yield heading, [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def commands(command: Any, path: str) -> Iterator[str]:
    """Yield a command and its options, then those below it."""
    yield f"command {path}"
    for one in command.params:
        if one.param_type_name == "argument":
            yield f"command {path}: {one.name.upper()}"
        elif one.name != "help":
            kind = "" if one.is_flag else " VALUE"
            names = "/".join([*one.opts, *one.secondary_opts])
            yield f"command {path}: {names}{kind}, default {one.default}"
    for name, below in sorted(getattr(command, "commands", {}).items()):
        yield from commands(below, f"{path} {name}")


def members(kind: type) -> Iterator[str]:
    """Yield what a class has beside what Python gives it."""
    for name in sorted(set(dir(kind)) - set(dir(Exception)) - set(dir(tuple))):
        if not name.startswith("_") and name not in dir(Part):
            found: Any = inspect.getattr_static(kind, name)
            found = getattr(found, "__func__", found)
            yield f"{name}{inspect.signature(found)}" if inspect.isfunction(found) else name


def names() -> Iterator[str]:
    """Yield public names, with parameters of functions and members of classes."""
    for room in ROOMS:
        module = import_module(f"hapticmech_ros{room}")
        for name in module.__all__:
            one, path = getattr(module, name), f"name {module.__name__}.{name}"
            yield f"{path}{inspect.signature(one)}" if inspect.isfunction(one) else path
            if inspect.isclass(one):
                fields = getattr(one, "__dataclass_fields__", {})
                yield from (f"{path}: {field}" for field in fields if not field.startswith("_"))
                yield from (f"{path}: {member}" for member in members(one))


def sources() -> Iterator[str]:
    """Yield names of files and services that the package's sources have."""
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for kind, literal, constant in SERVICE.findall(text):
            yield f"service {literal or constant}, {kind}"
        for node in ast.walk(ast.parse(text)):
            value = getattr(node, "value", None)
            if isinstance(value, str) and FILE_NAME.fullmatch(value):
                yield f"file {value}"


def interface() -> list[str]:
    """Return all lines, each once, in order."""
    keys = key_reference(scene_schema(), {})
    found = list(commands(typer.main.get_command(app), "hapticmech"))
    found += [f"topic {', '.join(cells[:6])}" for _, cells in rows(topics())]
    found += [f"parameter {', '.join(cells[:5])}" for _, cells in rows(parameters())]
    found += [f"key {kind}: {', '.join(cells[:3])}" for kind, cells in rows(keys)]
    found += [*names(), *sources()]
    # Where a function is in memory is another place each time.
    return sorted({re.sub(r"<function (.+?) at \w+>", r"\1", line) for line in found})


if __name__ == "__main__":
    sys.stdout.write("".join(f"{line}\n" for line in interface()))
