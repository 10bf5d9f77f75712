# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: tools, how much of sweeps is tested, and texts are read without a child.

The tools are those in benchmarks/, which are not installed. A child takes a tenth of a second for
each file, and tests read thousands, also while they are collected: ``test_foreign_text`` shows that
it makes no difference.
"""

import gc
import os
import sys
from pathlib import Path

import pytest

# Before NumPy is there: tests share the processors among themselves.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sampling
from hapticmech_ros import foreign_text

# Last, so that the package is still the installed one.
sys.path.append(str(Path(__file__).resolve().parents[1]))

_is_own, foreign_text.is_own = foreign_text.is_own, lambda file: True


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


@pytest.fixture(autouse=True)
def _texts_of_others_are_parsed_in_a_child(request, monkeypatch):
    if request.path.stem == "test_foreign_text":
        monkeypatch.setattr(foreign_text, "is_own", _is_own)
