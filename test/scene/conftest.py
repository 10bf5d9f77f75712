# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Documents that tests spoil: plain dictionaries of shipped scenes, a fresh copy each time."""

import copy

import pytest

from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import document_of


@pytest.fixture(scope="session")
def _documents():
    return {name: document_of(load_scene(name)) for name in ("five_bar", "spatial_arm")}


@pytest.fixture
def planar(_documents):
    return copy.deepcopy(_documents["five_bar"])


@pytest.fixture
def spatial(_documents):
    return copy.deepcopy(_documents["spatial_arm"])
