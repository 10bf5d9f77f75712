# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Docstrings of public functions: shapes of arrays, results, and errors that are raised."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "hapticmech_ros"
Check = Callable[[ast.FunctionDef], Iterator[str]]
ARRAY = re.compile(r"\bArray\b|\bndarray\b")
SHAPE = re.compile(r"\([^()]*\)")


def is_public(node: ast.FunctionDef) -> bool:
    """Return whether others may call a function; parts of kernels are called by kernels alone."""
    names = {ast.unparse(decorator) for decorator in node.decorator_list}
    return not node.name.startswith("_") and not names & {"inner", "leaf"}


def functions(body: list[ast.stmt], owner: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield public functions and methods of public classes with their names."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from functions(node.body, f"{node.name}.")
        elif isinstance(node, ast.FunctionDef) and is_public(node):
            yield f"{owner}{node.name}", node


def is_array(annotation: ast.expr | None) -> bool:
    return annotation is not None and ARRAY.search(ast.unparse(annotation)) is not None


def entry(section: str, name: str) -> str:
    """Return what a section says of an argument; several names may share an entry."""
    pattern = rf"(?m)^    (?:\w+, )*{name}(?:, \w+)*: (.*(?:\n {{8}}.*)*)"
    found = re.search(pattern, section)
    return found.group(1) if found else ""


def raised(node: ast.AST) -> Iterator[str]:
    """Yield the names of what a function raises, without what functions inside it do."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.FunctionDef, ast.Lambda)):
            continue
        if isinstance(child, ast.Raise) and isinstance(child.exc, ast.Call):
            yield ast.unparse(child.exc.func).rpartition(".")[2]
        caught = {
            name.id
            for handler in getattr(child, "handlers", ())
            for name in ast.walk(handler.type or handler)
            if isinstance(name, ast.Name)
        }
        if "Exception" not in caught:
            yield from (name for name in raised(child) if name not in caught)


def missing_errors(node: ast.FunctionDef) -> Iterator[str]:
    """Yield errors that a docstring does not name; of a function that makes one, that none is."""
    section = (ast.get_docstring(node) or "").partition("Raises:")[2]
    for name in sorted(set(raised(node))):
        known = name in section if name[0].isupper() else bool(section)
        if not known and name != "AssertionError":
            yield f"{name}, in Raises:"


def missing_result(node: ast.FunctionDef) -> Iterator[str]:
    """Yield a fault where a docstring does not say what a function returns or yields."""
    doc = (ast.get_docstring(node) or "").partition("Args:")
    kinds = {ast.unparse(decorator).rpartition(".")[2] for decorator in node.decorator_list}
    nothing = node.returns is None or ast.unparse(node.returns) == "None"
    told = re.search(r"\b([Rr]eturn|[Yy]ield)", doc[0]) or re.search("Returns:|Yields:", doc[2])
    if not (nothing or told or kinds & {"property", "cached_property", "override", "setter"}):
        yield "what is returned"


def faults(node: ast.FunctionDef) -> Iterator[str]:
    """Yield what the docstring of a function does not say."""
    doc = ast.get_docstring(node) or ""
    before, _, arguments = doc.partition("Args:")
    for argument in (*node.args.args, *node.args.kwonlyargs):
        if is_array(argument.annotation) and not SHAPE.search(entry(arguments, argument.arg)):
            yield f"shape of {argument.arg}, in Args:"
    returned = doc.partition("Returns:")[2]
    if is_array(node.returns) and not SHAPE.search(before + returned):
        yield "shape of what is returned"


def undocumented(text: str, check: Check) -> list[str]:
    """Return the faults of a file's functions."""
    return [
        f"{node.lineno} {name}: {fault}"
        for name, node in functions(ast.parse(text).body)
        for fault in check(node)
    ]


def undocumented_files(check: Check, *, but: str) -> dict[str, list[str]]:
    """Return the faults in the package by file, but those of a folder."""
    files = [path for path in sorted(PACKAGE.rglob("*.py")) if path.parent.name != but]
    assert len(files) > 200
    found = {str(path): undocumented(path.read_text(encoding="utf-8"), check) for path in files}
    return {name: faulty for name, faulty in found.items() if faulty}


@pytest.mark.parametrize(
    ("check", "but"),
    # What a command line program raises ends it with a message; its docstring is its help.
    [(faults, ""), (missing_result, ""), (missing_errors, "cli")],
    ids=["shapes of arrays", "results", "errors"],
)
def test_public_functions_say_what_they_take_and_give(check: Check, but: str) -> None:
    assert undocumented_files(check, but=but) == {}
