# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Pages in a browser; whoever imports this is skipped where viser or Chromium is not installed."""

from __future__ import annotations

from importlib.util import find_spec

import pytest

if find_spec("viser") is None:
    pytest.skip("viser, of the extra live, is not installed", allow_module_level=True)

from benchmarks.live.browser import Browser, chromium, wait_until

if chromium() is None:
    pytest.skip("Chromium is not installed", allow_module_level=True)

from benchmarks.live.served import Served, drag, sight

__all__ = ["Browser", "Served", "drag", "sight", "wait_until"]
