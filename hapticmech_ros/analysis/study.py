"""The protocol of a study: options, a run, results, and from those a file, tables and figures.

A study defines its own results and what they show; how they are written, printed and turned into an
exit code is the same for all, for those of this folder and for the developers' benchmarks.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import JustifyMethod
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Told of the progress, a line at a time.
Show = Callable[[str], None]

# Where a value does not exist.
NOTHING = "-"
# Of a table's first column, characters that are kept together where there is little room.
NAME_WIDTH = 20


def silent(line: str) -> None:
    """Show nothing."""


class Marked(str):
    """A cell that stands out on a terminal: its text, and rich's name of a style."""

    style: str

    def __new__(cls, text: str, style: str) -> Marked:
        """Return the text with a style."""
        made = super().__new__(cls, text)
        made.style = style
        return made


def judged(text: str, good: bool) -> Marked:
    """Return a cell that says whether something is as it should be."""
    return Marked(text, "green" if good else "bold red")


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table, for a terminal and for a document.

    Attributes:
        title: above it.
        headings: of the columns.
        rows: of texts, as many as headings; shorter ones are filled up.
        words: headings of columns of words, besides the first; numbers stand to the right.
        caption: below it.
    """

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: tuple[str, ...] = ()
    caption: str = ""

    def table(self) -> Table:
        """Return the sheet for a terminal."""
        table = Table(
            title=escape(self.title),
            title_justify="left",
            caption=escape(self.caption) or None,
            caption_justify="left",
            box=SIMPLE_HEAD,
            padding=(0, 1, 0, 0),
        )
        # On a narrow terminal numbers are folded before names are.
        names = [row[0] for row in self.rows if row]
        least = [min(NAME_WIDTH, max(map(len, names), default=0)), *[None] * len(self.headings)]
        for index, heading in enumerate(self.headings):
            left = index == 0 or heading in self.words
            justify: JustifyMethod = "left" if left else "right"
            table.add_column(heading, justify=justify, overflow="fold", min_width=least[index])
        for row in self.rows:
            table.add_row(*(_cell(text) for text in row))
        return table

    def markdown(self) -> str:
        """Return the sheet for a document."""
        lines = [
            f"**{self.title}**\n",
            "| " + " | ".join(self.headings) + " |",
            "|---|" + "--:|" * (len(self.headings) - 1),
        ]
        lines += ["| " + " | ".join(row) + " |" for row in self.rows]
        return "\n".join([*lines, *([f"\n{self.caption}"] if self.caption else [])]) + "\n"


class Results(ABC):
    """What a study found.

    A dataclass whose fields, with its public properties, are what is written as JSON.

    Attributes:
        NAME: of the files: ``<NAME>.json``, ``<NAME>.md`` and, of one figure, ``<NAME>.png``.
        FAULT: what to say of results that are not sound.
    """

    NAME: ClassVar[str]
    FAULT: ClassVar[str] = ""

    @property
    def sound(self) -> bool:
        """Whether the exit code is 0."""
        return True

    def document(self) -> Any:
        """Return the results as plain dictionaries, lists and numbers."""
        return plain(self)

    @abstractmethod
    def sheets(self) -> Iterator[Sheet]:
        """Yield the tables."""

    def notes(self) -> Iterable[str]:
        """Return lines that are printed below the tables."""
        return ()

    def figures(self) -> Mapping[str, Figure]:
        """Return figures by the names of their files."""
        return {}

    def markdown(self) -> str:
        """Return the tables for a document."""
        return "\n".join(sheet.markdown() for sheet in self.sheets())

    def write(self, out: Path, figure: Path | None = None) -> None:
        """Write JSON, tables and figures.

        Args:
            out: folder, made if it is not there.
            figure: path of the first figure; in the folder if None.
        """
        from hapticmech_ros.experiment.figure_style import save

        out.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.document(), indent=1, ensure_ascii=False, allow_nan=False)
        (out / f"{self.NAME}.json").write_text(text + "\n", encoding="utf-8")
        (out / f"{self.NAME}.md").write_text(self.markdown(), encoding="utf-8")
        for name, drawn in self.figures().items():
            save(drawn, figure or out / name)
            figure = None


def plain(value: object) -> Any:
    """Return a value as JSON has it.

    Dataclasses become dictionaries of their fields and public properties, arrays lists, complex
    numbers pairs (real, imaginary), and numbers that are not finite None.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {name: plain(getattr(value, name)) for name in _names(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(one) for one in value]
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float):
        return value if isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _names(value: Any) -> list[str]:
    properties = [
        name
        for kind in type(value).__mro__
        for name, member in vars(kind).items()
        if isinstance(member, property) and not name.startswith("_")
    ]
    return list(dict.fromkeys([*(field.name for field in fields(value)), *properties]))


def number(value: float | None, style: str) -> str:
    """Return a number for a table, or a dash."""
    return NOTHING if value is None else format(value, style)


def _cell(text: str) -> str:
    shown = escape(text)
    return f"[{text.style}]{shown}[/]" if isinstance(text, Marked) else shown
