# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The campaign's table in docs/reliability.md."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchmarks.children import ROOT
from benchmarks.reliability.figure import Figure, save, table
from hapticmech_ros.errors import HapticMechError

DOCUMENT = ROOT / "docs" / "reliability.md"
# The figures that the document shows, kept beside the code that measured them.
RESULTS = Path(__file__).with_name("results.json")
BEGIN, END = "<!-- campaign: begin -->", "<!-- campaign: end -->"


def publish(figures: Sequence[Figure]) -> None:
    """Write the figures' table into the document, and keep the figures.

    Raises:
        HapticMechError: the document has no place for it.
    """
    DOCUMENT.write_text(with_table(DOCUMENT.read_text("utf-8"), figures), "utf-8")
    save(figures, RESULTS)


def with_table(text: str, figures: Sequence[Figure]) -> str:
    """Return a document with the figures' table between its markers.

    Raises:
        HapticMechError: it has not both markers once.
    """
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end or BEGIN in after or END in after:
        raise HapticMechError(f"{DOCUMENT.name}: must have {BEGIN} and {END}, once each")
    return f"{before}{BEGIN}\n\n{table(figures)}\n{END}{after}"
