# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the tree weighs, in statements without imports and docstrings: ``python test/weight.py``."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]


def statements(path: Path) -> int:
    """Return how many statements a file has that are neither imports nor docstrings."""
    found = [node for node in ast.walk(ast.parse(path.read_bytes())) if isinstance(node, ast.stmt)]
    return sum(not (isinstance(one, ast.Import | ast.ImportFrom) or _is_text(one)) for one in found)


def _is_text(node: ast.stmt) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


if __name__ == "__main__":
    for part in ("hapticmech_ros", "test", "benchmarks"):
        files = sorted((ROOT / part).rglob("*.py"))
        print(f"{part}: {sum(map(statements, files))} statements in {len(files)} files")
