# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the robots of the package example-robot-data are, if it is installed (extra ``robots``)."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest


def robot_files(suffix):
    """Return the files of a kind, by their path in the package; none if it is not installed."""
    try:
        package = distribution("example-robot-data")
    except PackageNotFoundError:
        return {}
    where = "cmeel.prefix/share/example-robot-data/robots"
    folder = Path(str(package.locate_file(where)))
    return {str(path.relative_to(folder)): path for path in sorted(folder.rglob(f"*{suffix}"))}


def robot(suffix, name):
    """Return one of the files; the test is skipped if the package is not installed."""
    files = robot_files(suffix)
    if not files:
        pytest.skip("example-robot-data is not installed: pip install hapticmech_ros[robots]")
    return files[name]
