# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What all tests share: developers' tools are found, and texts are taken apart without a child.

The tools are those in benchmarks/, which are not installed. A child takes a tenth of a second for
each file, and tests read thousands: ``test_foreign_text`` shows that it makes no difference.
"""

import os
import sys
from pathlib import Path

import pytest

# Before NumPy is there: tests share the processors among themselves.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hapticmech_ros import foreign_text

# Last, so that the package is still the installed one.
sys.path.append(str(Path(__file__).resolve().parents[1]))


@pytest.fixture(autouse=True)
def _texts_are_parsed_here(request, monkeypatch):
    if request.path.stem != "test_foreign_text":
        monkeypatch.setattr(foreign_text, "is_own", lambda file: True)
