# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The documentation as a site: ``make docs`` builds it, with warnings as errors.

Sources are the Markdown files here and in ``docs``, which are written to be read without Sphinx
too; ``docs/index.md`` and ``docs/api.md`` are for the site alone.
"""

import re
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent
MANIFEST = ElementTree.parse(ROOT / "package.xml").getroot()


def stated(tag):
    """Return the text of an element of package.xml."""
    return " ".join((MANIFEST.findtext(tag) or "").split())


project = stated("name")
author = stated("author") or stated("maintainer")
version = release = stated("version")
copyright = f"{author}; {stated('license')}"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
root_doc = "docs/index"
include_patterns = ["docs/*.md", "*.md"]
exclude_patterns = [".venv", "build", "install", "log", "test", "benchmarks", "**/__pycache__"]

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]
html_theme = "alabaster"
html_theme_options = {"page_width": "1100px", "description": stated("description")}
html_show_sourcelink = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True

_LINK = re.compile(r"\[([^][]+)\]\(([^()#:]+)\)")


def name_folders(app, page, source):
    """Leave of a link to a folder, which a site has no page for, what it is called."""
    del app

    def named(link):
        folder = (ROOT / page).parent / link[2]
        return link[1] if folder.is_dir() else link[0]

    source[0] = _LINK.sub(named, source[0])


def keep_bars(app, what, name, thing, options, lines):
    """Keep |x| in docstrings, which reStructuredText takes for a substitution."""
    del app, what, name, thing, options
    lines[:] = [line.replace("|", "\\|") for line in lines]


def setup(app):
    """Connect the two above."""
    app.connect("source-read", name_folders)
    app.connect("autodoc-process-docstring", keep_bars)
