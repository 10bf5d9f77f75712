# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What of a sweep is tested: all of it with ``pytest --long``, otherwise a sample that is fixed.

A sweep repeats one law at many seeds, states or values. What decides by itself, such as a case of a
bug that was fixed, is no part of one.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar
from zlib import crc32

import pytest

Case = TypeVar("Case")
Test = TypeVar("Test", bound=Any)
# Set by conftest.py before any test is read.
LONG = False


def only_long(*cases: Case) -> list[Case]:
    """Return cases with ``--long``, and none without: others of the same law are in every run."""
    return list(cases) if LONG else []


def long_ones(test: Test) -> Test:
    """Mark a test that is done with ``--long`` only: others assert the same at less cost."""
    return test if LONG else pytest.mark.skip(reason="with --long only")(test)


def sampled(cases: Iterable[Case], of: object = "", every: int = 5) -> list[Case]:
    """Return one of so many cases, and one at least; all of them with ``--long``.

    Args:
        cases: of one law, for one scene or kind of it.
        of: that scene or kind: which case is the first one depends on it.
        every: of how many cases one is taken.
    """
    found = list(cases)
    return found if LONG else found[crc32(str(of).encode()) % min(every, len(found)) :: every]
