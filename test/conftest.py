# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: tools, and how much of sweeps is tested.

The tools are those in benchmarks/, which are not installed.
"""

import gc
import os
import sys
from pathlib import Path

import pytest

# Before NumPy is there: tests share the processors among themselves.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sampling

# Last, so that the package is still the installed one.
sys.path.append(str(Path(__file__).resolve().parents[1]))


def pytest_addoption(parser):
    parser.addoption("--long", action="store_true", help="whole sweeps, not samples of them")


def pytest_configure(config):
    sampling.LONG = config.getoption("--long")


def pytest_make_parametrize_id(val, argname):
    """Name bytes by their argument: what the middleware leaves between fields differs each time."""
    return argname if isinstance(val, bytes) else None


@pytest.hookimpl(hookwrapper=True)
def pytest_collection():
    """Collect tests, which stay: garbage is not looked for in them again and again."""
    gc.disable()
    yield
    gc.freeze()
    gc.enable()
