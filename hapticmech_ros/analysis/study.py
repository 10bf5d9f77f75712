# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Common protocol of studies and benchmarks: results, and their files, tables and figures.

A study defines its results, tables and figures. Writing, printing and the exit code are common to
the studies of this folder and the developers' benchmarks.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, JustifyMethod, RenderResult
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from hapticmech_ros.system.workers import Found, Given, Lost, Workers, in_order

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Called with one line of progress.
Show = Callable[[str], None]

# Text for a value that does not exist.
NOTHING = "-"
# Least width of a column of text, and gap between two columns, characters.
NAME_WIDTH, APART = 18, 2


def silent(line: str) -> None:
    """Show nothing."""


class Marked(str):
    """Text of a cell with a style of rich, for a terminal."""

    style: str

    def __new__(cls, text: str, style: str) -> Marked:
        """Return the text with a style."""
        made = super().__new__(cls, text)
        made.style = style
        return made


def judged(text: str, good: bool) -> Marked:
    """Return a cell that is highlighted if a result is not as required."""
    return Marked(text, "green" if good else "bold red")


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table, for a terminal and for a document.

    Attributes:
        title: above the table.
        headings: of the columns.
        rows: of texts, one for each heading; shorter rows are padded.
        words: headings of text columns besides the first; all others are aligned to the right.
        caption: below the table.
        kept: width up to which names in the first column are not folded, characters.
    """

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: tuple[str, ...] = ()
    caption: str = ""
    kept: int = NAME_WIDTH

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the sheet for a terminal: columns for which it is too narrow as further tables."""
        groups = self._groups(options.max_width)
        for number, columns in enumerate(groups):
            continued = " (continued)" * (number > 0)
            if self.title or continued:
                yield Text((self.title + continued).strip(), style="table.title")
            yield self._table(columns, options.max_width)
        if self.caption:
            yield Text(self.caption, style="table.caption")

    def _groups(self, width: int) -> list[list[int]]:
        """Return which columns stand in which table, the first one in each."""
        groups, used = [[0]], self._least(0)
        for index in range(1, len(self.headings)):
            needed = APART + self._least(index)
            if used + needed > width and len(groups[-1]) > 1:
                groups.append([0])
                used = self._least(0)
            groups[-1].append(index)
            used += needed
        return groups

    def _cells(self, index: int) -> list[str]:
        """Return the cells of a column."""
        return [row[index] for row in self.rows if index < len(row)]

    def _is_text(self, index: int) -> bool:
        return index == 0 or self.headings[index] in self.words

    def _least(self, index: int) -> int:
        """Return the least width of a column: numbers are not folded, headings between words."""
        cells = self._cells(index)
        heading = max(map(len, self.headings[index].split()), default=1)
        widest = max(map(len, cells), default=0)
        if index == 0:
            return max(min(self.kept, widest), 1)
        if self._is_text(index):
            longest = max((len(word) for cell in cells for word in cell.split()), default=0)
            return max(min(NAME_WIDTH, widest), min(self.kept, longest), heading)
        return max(widest, heading)

    def _widths(self, columns: Sequence[int], width: int) -> list[int]:
        """Return the width of each column of a table; free space widens the first ones."""
        found = [self._least(index) for index in columns]
        left = width - sum(found) - APART * (len(columns) - 1)
        for at, index in enumerate(columns):
            unfolded = max(map(len, (self.headings[index], *self._cells(index))))
            more = max(min(unfolded - found[at], left), 0)
            found[at] += more
            left -= more
        return found

    def _table(self, columns: Sequence[int], width: int) -> Table:
        """Return some of the columns as a table."""
        table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), show_edge=False, pad_edge=False)
        for index, wide in zip(columns, self._widths(columns, width), strict=True):
            justify: JustifyMethod = "left" if self._is_text(index) else "right"
            table.add_column(self.headings[index], justify=justify, overflow="fold", width=wide)
        for row in self.rows:
            table.add_row(*(_cell(row[index]) if index < len(row) else "" for index in columns))
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
    """Results of a study.

    A dataclass whose fields and public properties are written as JSON.

    Attributes:
        NAME: of the files: ``<NAME>.json``, ``<NAME>.md`` and, for one figure, ``<NAME>.png``.
        FAULT: message if the results are not sound.
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
        """Return the figures by file name."""
        return {}

    def markdown(self) -> str:
        """Return the tables for a document."""
        return "\n".join(sheet.markdown() for sheet in self.sheets())

    def write(self, out: Path, figure: Path | None = None) -> None:
        """Write JSON, tables and figures.

        Args:
            out: folder, created if needed.
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


@dataclass(frozen=True)
class SharedResults(Results):
    """Results of cases that were shared among workers.

    Attributes:
        lost: cases without a result, as their processes were ended.
    """

    FAULT: ClassVar[str] = "a case was lost with its process"

    lost: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def sound(self) -> bool:
        """Whether every case has a result."""
        return not self.lost

    def notes(self) -> Iterable[str]:
        """Return which cases were lost."""
        return self.lost


def shared(
    work: Callable[[Given], Found],
    cases: Sequence[Given],
    workers: Workers,
    show: Show,
    line: Callable[[Given, Found], str] = lambda case, found: str(case),
) -> tuple[list[Found], tuple[str, ...]]:
    """Return a function's results for the cases, in their order, and the lost cases.

    Args:
        work: a function of a module, and of nothing but its argument.
        cases: that processes can be given.
        workers: that share the cases; they do not affect the results.
        show: called after each case.
        line: returns the text for a case that was not lost.

    Raises:
        InvalidInputError: no process.
    """
    results, lost = list[Found](), list[str]()
    for case, found in zip(cases, in_order(work, cases, workers), strict=True):
        if isinstance(found, Lost):
            lost.append(str(found))
            show(lost[-1])
        else:
            results.append(found)
            show(line(case, found))
    return results, tuple(lost)


def plain(value: object) -> Any:
    """Return a value in terms of JSON's types.

    Dataclasses become dictionaries of their fields and public properties, arrays become lists,
    complex numbers pairs (real, imaginary), and non-finite numbers None.
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


def complex_parts(found: object, names: Sequence[str]) -> dict[str, list[float]]:
    """Return complex columns of a result as lists of numbers: real and imaginary part of each.

    Args:
        found: whose attributes (k,) they are.
        names: of the attributes.
    """
    return {
        f"{name}_{part}": getattr(getattr(found, name), short).tolist()
        for name in names
        for part, short in (("real", "real"), ("imaginary", "imag"))
    }


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
