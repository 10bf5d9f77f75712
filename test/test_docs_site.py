# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The documentation as a site: every page is in it, every link leads somewhere, nothing warns."""

from __future__ import annotations

import re
import shutil
from html import unescape
from html.parser import HTMLParser
from importlib import import_module
from inspect import isclass, isfunction
from pathlib import Path
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import pytest

import hapticmech_ros
from commands import printed_by
from hapticmech_ros.wire.table import markdown as topics
from sampling import long_ones

ROOT = Path(__file__).resolve().parents[1]
SVG = "{http://www.w3.org/2000/svg}"


class Page(HTMLParser):
    """What a page shows, where its links lead, what it loads, and what links may lead to."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.text, self.links, self.loaded, self.ids = "", set(), set(), {""}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        said = {key: value or "" for key, value in attrs}
        self.ids.add(said.get("id", ""))
        place = said.get("href") or said.get("src")
        if place and said.get("rel") != "prev":
            (self.links if tag == "a" else self.loaded).add(place)

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site from a copy, since autosummary writes pages among the sources."""
    here = tmp_path_factory.mktemp("site")
    for one in ROOT.iterdir():
        if one.is_file():
            shutil.copy(one, here)
        elif one.name != "docs":
            (here / one.name).symlink_to(one)
    shutil.copytree(ROOT / "docs", here / "docs", ignore=shutil.ignore_patterns("api"))
    out = tmp_path_factory.mktemp("html")
    places = "-d", here / "doctrees", ".", out
    printed_by("-m", "sphinx", "-W", "--keep-going", "-q", *places, cwd=here, timeout=600.0)
    return out


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in site.rglob("*.html")}


@long_ones
def test_every_page_is_in_the_site_and_is_reached(site: Path, pages: dict[Path, Page]) -> None:
    first = site / "docs" / "index.html"
    for page in [*(ROOT / "docs").glob("*.md"), *ROOT.glob("*.md")]:
        name = page.relative_to(ROOT).with_suffix(".html")
        assert site / name in pages, name
        shown = f"../{name}" if name.parent == Path() else name.name
        assert site / name == first or shown in pages[first].links, name


@long_ones
def test_the_folder_opens_at_the_first_page(site: Path) -> None:
    entry = (site / "index.html").read_text(encoding="utf-8")
    (place,) = re.findall(r'http-equiv="refresh" content="0; url=(.*?)"', entry)
    assert (site / place).samefile(site / "docs" / "index.html")


@long_ones
def test_links_lead_to_places_that_there_are(pages: dict[Path, Page]) -> None:
    broken = []
    for path, page in pages.items():
        for link in page.links | page.loaded:
            where = urlsplit(link)
            if not where.scheme:
                target = (path.parent / unquote(where.path)).resolve() if where.path else path
                ids = pages[target].ids if target in pages else {""}
                if not target.is_file() or unquote(where.fragment) not in ids:
                    broken.append(f"{path.name}: {link}")
    assert not broken
    assert sum(len(page.links) for page in pages.values()) > 2000


@long_ones
def test_nothing_is_loaded_from_elsewhere(pages: dict[Path, Page]) -> None:
    """The site works without a network."""
    loaded = {place for page in pages.values() for place in page.loaded}
    assert any(place.endswith("architecture.svg") for place in loaded)
    assert not [place for place in loaded if "//" in place]


@long_ones
def test_formulas_are_formulas_and_types_have_names(site: Path, pages: dict[Path, Page]) -> None:
    assert "<math " in (site / "docs" / "index.html").read_text(encoding="utf-8")
    modules = [path for path in pages if path.parent == site / "docs" / "api"]
    assert len(modules) > 20
    noise = (
        r"\$\$|\\Lambda|Annotated\[|FieldInfo|ForwardRef|dtype\[|<function|<factory| at 0x|,\) – "
    )
    for path in [*modules, site / "docs" / "index.html"]:
        assert not re.search(noise, pages[path].text), path.name
    for path in modules:
        for entry in re.findall(r'<dt class="sig .*?</dt>', path.read_text(encoding="utf-8"), re.S):
            lines = re.sub(r"<dd>|<[^>]*>", lambda tag: "\n" * (tag[0] == "<dd>"), entry)
            assert max(map(len, unescape(lines).splitlines())) <= 110, f"{path.name}: {lines}"


@long_ones
def test_it_has_light_and_dark_colours_and_a_search(site: Path, pages: dict[Path, Page]) -> None:
    style = "".join(path.read_text() for path in (site / "_static").rglob("furo.css"))
    assert "prefers-color-scheme:dark" in style.replace(" ", "")
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    assert "inverse_inertia" in index
    assert "docs/api/hapticmech_ros.operational" in index


@long_ones
def test_every_public_name_has_an_entry(site: Path, pages: dict[Path, Page]) -> None:
    entries = set().union(*(pages[path].ids for path in (site / "docs" / "api").glob("*.html")))
    names = {entry.rpartition(".")[2] for entry in entries if entry.startswith("hapticmech_ros")}
    assert set(hapticmech_ros.__all__) <= names
    assert {"SafetyLimits", "plan_scene"} <= names
    for folder in ("bag", "control", "device", "experiment", "formats", "offline", "view"):
        module = import_module(f"hapticmech_ros.{folder}")
        # Of constants and aliases of types there is no entry.
        public = {name: getattr(module, name) for name in module.__all__}
        whole = {name for name, one in public.items() if isclass(one) or isfunction(one)}
        assert whole <= names, folder


def test_arrows_of_the_figure_are_topics() -> None:
    """Each is one of the table, from the node to the node that the table states."""
    rows = (line.split(" | ") for line in topics().splitlines() if line.startswith("| `"))
    table = {name.strip("| `"): (sender, readers) for name, _, sender, readers, *_ in rows}
    figure = ElementTree.parse(ROOT / "docs" / "images" / "architecture.svg").getroot()
    shown = {}
    for arrow in figure.iter(f"{SVG}g"):
        sender, _, reader = arrow.findtext(f"{SVG}title").partition(" to ")
        for text in arrow.iter(f"{SVG}text"):
            if text.get("class") == "topic":
                shown[text.text] = (sender, reader)
    assert {name for name in shown if name.endswith(("state", "model", "servo_cf"))} == {
        "device/state",
        "device/servo_cf",
        "mechanism/state",
        "mechanism/{point}/servo_cf",
        "analysis/{point}/operational_model",
    }
    for name, (sender, reader) in shown.items():
        assert sender == table[name][0]
        assert reader in table[name][1].split(", ")


def test_files_that_the_first_page_names_exist() -> None:
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    named = re.findall(r"`(\w[\w/]*(?:\.py|/))`", text)
    assert len(named) > 5
    for name in named:
        assert name == "hapticmech_ros/" or (ROOT / "hapticmech_ros" / name).exists(), name
