# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A folder of kernels of one's own, with the library in it that is built already."""

import os
import shutil

import pytest

from hapticmech_ros.compilation import cache, library
from hapticmech_ros.compilation.cache import read_own


@pytest.fixture
def alone(tmp_path, monkeypatch):
    """Let every question for the library be asked anew, in a folder of its own."""
    library.library()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    library.library.cache_clear()
    yield tmp_path
    library.library.cache_clear()


@pytest.fixture(scope="session")
def good():
    """Return the library as it was built, in the user's own folder."""
    library.compile_ahead()
    return library.library_path()


@pytest.fixture
def place(good, alone):
    """Return where the library is in a folder of its own, a copy of the good one."""
    path = library.library_path()
    path.parent.mkdir(parents=True)
    shutil.copy2(good, path)
    return path


@pytest.fixture
def builds(good, monkeypatch):
    """Let a build take no time: it copies the good library. Return what was built so far."""
    built = []

    def made():
        built.append(library.library_path())
        return read_own(good)

    monkeypatch.setattr(library, "_made", made)
    return built


@pytest.fixture
def foreign(monkeypatch):
    """Return what makes a file or folder that of another user."""

    def give(path):
        if os.geteuid() == 0:
            os.chown(path, 12345, 12345, follow_symlinks=False)
        else:
            # Whose files cannot be given away is himself another.
            monkeypatch.setattr(cache.os, "geteuid", lambda: 12345)

    return give
