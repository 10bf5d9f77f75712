# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The experiment of the scene that a file of tests is about."""

import pytest

from oracles.sessions import whole


@pytest.fixture
def run(request):
    """Return the whole experiment of the module's ``NAME``, made once for all tests."""
    return whole(request.module.NAME)
