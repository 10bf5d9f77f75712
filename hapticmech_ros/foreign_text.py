# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Text that somebody else wrote, taken apart by parsers in a child process with limits.

LibYAML and expat are C: what one of them does wrong with a damaged text ends the child and not a
node. What they return is plain, of bounded size, and is judged here. The package's own files are
read without a child.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from hapticmech_ros.cage import CageError, Limits, caged
from hapticmech_ros.errors import FileError
from hapticmech_ros.share import is_own

# Texts of the largest size took 0.7 s of a processor and 163 MB; a slow machine may take more.
LIMITS = Limits(memory=512_000_000, seconds=10, output=32_000_000)


def parsed(parse: Callable[[Any], Any], file: Path, item: Any) -> Any:
    """Return what a parser makes of a file's text.

    Args:
        parse: a function of a module; takes the item and raises FileError.
        file: that the text comes from.
        item: for the parser, as JSON has it.

    Raises:
        FileError: the parser's; or its child ended, or reached a limit.
    """
    if is_own(file):
        return parse(item)
    task = {"module": parse.__module__, "name": parse.__qualname__, "item": item}
    try:
        (answer,) = caged(answer_of, [task], LIMITS)
    except CageError as error:
        raise FileError(str(file), str(file), f"cannot be read: its parser {error.rule}") from None
    if "refused" in answer:
        raise FileError(*answer["refused"])
    return answer["value"]


def answer_of(task: dict[str, Any]) -> dict[str, Any]:
    """Return, in the child, what a parser says: a value, or the arguments of its error."""
    parse = getattr(import_module(task["module"]), task["name"])
    try:
        return {"value": parse(task["item"])}
    except FileError as error:
        return {"refused": [error.file, error.value, error.rule, error.where]}
