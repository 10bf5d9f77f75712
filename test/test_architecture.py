# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where tests of graphs are; what may import what is in pyproject.toml, for ``lint-imports``."""

import re
from pathlib import Path


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
