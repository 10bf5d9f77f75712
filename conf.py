# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The documentation as a site: ``make docs`` builds it, with warnings as errors.

Sources are the Markdown files here and in ``docs``, which are written to be read without Sphinx
too; ``docs/index.md`` and ``docs/api.md`` are for the site alone.
"""

import re
from pathlib import Path
from xml.etree import ElementTree

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.ext import autosummary

ROOT = Path(__file__).resolve().parent
MANIFEST = ElementTree.parse(ROOT / "package.xml").getroot()


def stated(tag):
    """Return the text of an element of package.xml."""
    return " ".join((MANIFEST.findtext(tag) or "").split())


project = stated("name")
author = stated("author") or stated("maintainer")
version = release = stated("version")
copyright = f"{author}; {stated('license')}"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
# Pages of modules are made by autosummary, from the list in docs/api.md.
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
root_doc = "docs/index"
include_patterns = ["docs/*.md", "docs/api/*.rst", "*.md"]
exclude_patterns = [".venv", "build", "install", "log", "test", "benchmarks", "**/__pycache__"]

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]
html_theme = "furo"
html_title = f"{project} {version}"
html_copy_source = False

autosummary_ignore_module_all = False
# The dots after which a sentence goes on.
autosummary.WELL_KNOWN_ABBREVIATIONS += ("Eq.", "Eqs.", "Fig.")
autodoc_default_options = {
    "members": True,
    # Of the package's own classes, but not what Python and pydantic give them.
    "inherited-members": "AbstractContextManager, BaseModel, Exception, str, tuple",
}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"Array": "Array", "Hand": "Hand"}
add_module_names = False
python_maximum_signature_line_length = 80
python_use_unqualified_type_names = True
toc_object_entries_show_parents = "hide"
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


def keep_words(app, what, name, thing, options, lines):
    """Keep what docstrings say: |x|, which is no substitution; what napoleon takes for a type."""
    del app, name, thing, options
    if what == "property" and lines and (found := re.match(r":type: (.*)", lines[-1])):
        lines[:] = [f"{found[1]}: {lines[0]}", *lines[1:-1]]
    # Of two names, Sphinx takes the first for the type of the second.
    lines[:] = [
        re.sub(r"^:(ivar|param) [\w, ]+:", lambda names: names[0].replace(", ", ","), line)
        for line in lines
    ]
    lines[:] = [short(line).replace("|", "\\|") for line in lines]


def short(text):
    """Return text with names of types as they are written in the code."""
    text = re.sub(r"~?numpy\.ndarray\[.*?numpy\.dtype\[~?numpy\.(\w+)]]", r"NDArray[\1]", text)
    return re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)


def shorten(app, what, name, thing, options, signature, returned):
    """Keep out of signatures the types of a scene's keys, and long defaults of dataclasses."""
    del app, what, name, options
    if not signature:
        return None
    if keys := getattr(thing, "model_fields", None):  # each has an entry, which states its type
        return f"(*, {', '.join(keys)})", returned
    for long in (r"(= )<(?:<\w+>|[^<>])*>", r"(array\()\[.*?]\)", r"(= [A-Z]\w*\()[^()]+\)"):
        signature = re.sub(long, lambda found: f"{found[1]}...{')' * ('(' in found[1])}", signature)
    return short(signature), returned and short(returned)


def formula(translator, node):
    """Write a formula as MathML, which browsers show without a network, unlike MathJax's."""
    whole = tex2mathml(node.astext())
    if isinstance(node, nodes.math_block):
        whole = whole.replace("<math ", '<math display="block" ', 1)
        whole = f'<div style="overflow-x: auto">{whole}</div>'
    translator.body.append(whole)
    raise nodes.SkipNode


def enter(app, failure):
    """Write the page that a browser opens in the folder of the site: it leads to the first."""
    if failure is None and app.builder.format == "html":
        first = app.builder.get_target_uri(root_doc)
        (Path(app.outdir) / "index.html").write_text(
            f'<!doctype html><meta charset="utf-8"><title>{project}</title>'
            f'<meta http-equiv="refresh" content="0; url={first}">'
            f'<a href="{first}">Documentation of {project}</a>\n'
        )


def setup(app):
    """Connect the functions above."""
    app.add_html_math_renderer("mathml", (formula, None), (formula, None))
    app.connect("source-read", name_folders)
    app.connect("autodoc-process-docstring", keep_words)
    app.connect("autodoc-process-signature", shorten)
    app.connect("build-finished", enter)
