# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mechanism and experiment of the scene that a file of tests is about."""

import pytest

from hapticmech_ros import Mechanism, load_scene
from oracles.sessions import whole


@pytest.fixture
def run(request):
    """Return the whole experiment of the module's ``NAME``, made once for all tests."""
    return whole(request.module.NAME)


@pytest.fixture(scope="module")
def mechanism(request):
    """Return the mechanism of the module's ``NAME``."""
    return Mechanism(load_scene(request.module.NAME))
