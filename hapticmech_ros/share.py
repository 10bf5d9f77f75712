# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the package's own files are: in the source tree, or in the share folder of a prefix."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

PACKAGE = "hapticmech_ros"


def shared(relative: str) -> Path | None:
    """Return the first existing ``relative`` file or folder of the package's data, or None."""
    for folder in _folders():
        if (folder / relative).exists():
            return folder / relative
    return None


def _folders() -> Iterator[Path]:
    here = Path(__file__).resolve()
    # The source tree: the package's folder stands beside config/.
    yield here.parents[1]
    # Installed, lib/pythonX.Y/site-packages/hapticmech_ros/: the prefix is a few levels up.
    for parent in here.parents[2:6]:
        yield parent / "share" / PACKAGE
    yield Path(sys.prefix) / "share" / PACKAGE
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix) / "share" / PACKAGE
