# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where tests of graphs are; what may import what is in pyproject.toml, for ``lint-imports``."""

import re
from inspect import cleandoc
from pathlib import Path

import hapticmech_ros

ROOT = Path(__file__).parents[1]


def test_graphs_of_nodes_are_tested_in_the_folders_that_make_collects_them_from():
    folder = Path(__file__).parent
    marked = {
        path.relative_to(folder).parts[0]
        for path in folder.rglob("*.py")
        if re.search(r"pytest\.mark\.(ros|alone)\b", path.read_text(encoding="utf-8"))
    }
    makefile = (folder.parent / "Makefile").read_text(encoding="utf-8")
    named = re.search(r"^GRAPHS := (.*)$", makefile, re.MULTILINE)
    assert marked == {Path(name).name for name in named.group(1).split()}
    assert len(re.findall(r"pytest \$\(GRAPHS\) -m '?(?:ros and not )?alone", makefile)) == 2


def test_the_map_of_the_parts_is_the_same_wherever_it_is_shown():
    about = cleandoc(hapticmech_ros.__doc__ or "")
    parts = re.findall(r"^    (.*)$", about, re.MULTILINE)
    assert len(parts) == 10
    for page in ("CONTRIBUTING.md", "docs/index.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        assert "\n".join(["```text", *parts, "```"]) in text
        assert about.split("\n\n")[-1] in text
    for part in parts:
        assert (ROOT / "hapticmech_ros" / part.split()[0]).is_dir()
