# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The documentation as a site: every page is in it, every link leads somewhere, nothing warns."""

from __future__ import annotations

import re
from importlib import import_module
from inspect import isclass, isfunction
from pathlib import Path

import pytest

import hapticmech_ros
from commands import printed_by
from sampling import long_ones

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    places = "-d", out / "doctrees", ".", out / "html"
    printed_by("-m", "sphinx", "-W", "--keep-going", "-q", *places, cwd=ROOT, timeout=600.0)
    return out / "html"


@long_ones
def test_every_page_is_in_the_site_and_is_reached(site: Path) -> None:
    pages = [*(ROOT / "docs").glob("*.md"), *ROOT.glob("*.md")]
    index = (site / "docs" / "index.html").read_text(encoding="utf-8")
    for page in pages:
        name = page.relative_to(ROOT).with_suffix(".html")
        assert (site / name).is_file(), name
        shown = f"../{name}" if name.parent == Path() else name.name
        assert name == Path("docs/index.html") or f'href="{shown}"' in index, name


@long_ones
def test_every_public_name_has_an_entry(site: Path) -> None:
    page = (site / "docs" / "api.html").read_text(encoding="utf-8")
    entries = set(re.findall(r'id="(hapticmech_ros[\w.]*)"', page))
    names = {entry.rpartition(".")[2] for entry in entries}
    assert set(hapticmech_ros.__all__) <= names
    assert {"SafetyLimits", "plan_scene"} <= names
    for folder in ("bag", "control", "device", "experiment", "formats", "offline", "view"):
        module = import_module(f"hapticmech_ros.{folder}")
        # Of constants and aliases of types there is no entry.
        public = {name: getattr(module, name) for name in module.__all__}
        whole = {name for name, one in public.items() if isclass(one) or isfunction(one)}
        assert whole <= names, folder
