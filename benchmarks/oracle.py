# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Oracles that results are compared with, from the tests of this source tree."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType

from hapticmech_ros.errors import HapticMechError


def oracle(name: str) -> ModuleType:
    """Return a module of ``test/oracles``, by its name there.

    Raises:
        HapticMechError: there are no tests beside the benchmarks.
    """
    tests = str(Path(__file__).parents[1] / "test")
    if tests not in sys.path:
        sys.path.append(tests)
    try:
        return importlib.import_module(f"oracles.{name}")
    except ImportError as error:
        raise HapticMechError(f"no oracle {name} in {tests}/oracles: {error}") from None
