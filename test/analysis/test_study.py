# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The protocol of a study: what is written, what is printed, and the exit code."""

import io
import json
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import typer
from rich.console import Console

from commands import ran
from hapticmech_ros.analysis.study import Marked, Results, Sheet, judged, number, plain
from hapticmech_ros.cli.study import carry_out, numbers
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.experiment.figure_style import new_figure
from hapticmech_ros.system.workers import in_order


@dataclass(frozen=True)
class Weighed(Results):
    """A study of two things."""

    NAME: ClassVar[str] = "weighed"
    FAULT: ClassVar[str] = "too heavy"

    masses: dict
    most: float = 3.0

    @property
    def sound(self):
        return all(mass <= self.most for mass in self.masses.values())

    def sheets(self):
        rows = tuple(
            (name, judged(f"{mass:g}", mass <= self.most)) for name, mass in self.masses.items()
        )
        yield Sheet("masses [kg]", ("thing", "mass"), rows, caption="[not] markup")

    def notes(self):
        return ["weighed twice"]

    def figures(self):
        return {"weighed.png": new_figure(2.0, 2.0, "nothing"), "other.png": new_figure(2, 2, "")}


GOOD, BAD = Weighed({"stone": 1.0, "rod": 2.5}), Weighed({"stone": 9.0})


def shown(sheet, width=80):
    text = io.StringIO()
    Console(width=width, file=text).print(sheet)
    return text.getvalue()


def test_fields_and_properties_are_plain():
    @dataclass(frozen=True, slots=True)
    class Pair:
        values: object
        _hidden: int = 1

        @property
        def twice(self):
            return 2

    values = (np.arange(2.0), 1 + 2j, float("nan"), np.float64("inf"), {3: {None}})
    assert plain(Pair(values)) == {
        "values": [[0.0, 1.0], [1.0, 2.0], None, None, {"3": [None]}],
        "_hidden": 1,
        "twice": 2,
    }
    assert plain(GOOD) == {"masses": {"stone": 1.0, "rod": 2.5}, "most": 3.0, "sound": True}


def test_results_are_written_as_json_tables_and_figures(tmp_path):
    out, elsewhere = tmp_path / "new" / "folder", tmp_path / "figure.png"
    GOOD.write(out, elsewhere)
    assert json.loads((out / "weighed.json").read_text(encoding="utf-8")) == GOOD.document()
    table = (out / "weighed.md").read_text(encoding="utf-8")
    assert "| thing | mass |" in table
    assert "| rod | 2.5 |" in table
    # The first figure goes where it is wanted, the others into the folder.
    assert sorted(path.name for path in out.iterdir()) == [
        "other.png",
        "weighed.json",
        "weighed.md",
    ]
    assert elsewhere.read_bytes().startswith(b"\x89PNG")


def test_brackets_are_no_markup_and_names_are_kept_together():
    (sheet,) = GOOD.sheets()
    text = shown(sheet)
    assert "masses [kg]" in text
    assert "[not] markup" in text
    wide = Sheet("", ("name", *map(str, range(12))), (("a_long_name", *["1234567"] * 12),))
    assert "a_long_name" in shown(wide, 60)


@pytest.mark.parametrize("width", [60, 80, 100, 200])
def test_numbers_are_not_folded_whatever_the_width(width):
    """What a terminal is too narrow for follows in further tables, the first column in each."""
    headings = ("scene", *(f"delay margin {n}" for n in range(9)), "what it says")
    values = tuple(f"{10.0**n:.3e}" for n in range(9))
    rows = tuple((name, *values, "a sentence of several words") for name in ("one", "another"))
    sheet = Sheet("margins", headings, rows, words=("what it says",), caption="seen once")
    text = shown(sheet, width)
    assert max(map(len, text.splitlines())) <= width
    for value in values:
        assert text.count(value) == 2
    tables = text.count("(continued)") + 1
    assert text.count("another") == tables
    assert (tables == 1) == (width == 200)
    assert text.count("seen once") == 1


@pytest.mark.parametrize("width", range(40, 90))
def test_a_sheet_that_just_fits_is_not_cut_off(width):
    """Each column is told to its last character, however near the width is to what is needed."""
    cells = tuple(f"{n}234567{n}" for n in range(5))
    rows = ((("a_name"), *cells, "end"),)
    text = shown(Sheet("", ("scene", *"vwxyz", "words"), rows, words=("words",)), width)
    assert max(map(len, text.splitlines())) <= width
    for cell in (*cells, "end", "words"):
        assert cell in text


def test_a_cell_is_its_text_whatever_its_style():
    assert Marked("2", "green") == "2" == judged("2", True)
    assert judged("2", False).style == "bold red"
    assert (number(None, ".1f"), number(2.0, ".1f")) == ("-", "2.0")


def test_the_command_line_prints_tables_or_json_and_fails_with_what_is_not_sound(tmp_path, capsys):
    def run(results):
        def measure(show):
            show("weighing")
            return results

        return measure

    carry_out(run(GOOD), tmp_path, False)
    printed = capsys.readouterr()
    for words in ("weighing", "stone", "weighed twice", "results:"):
        assert words in printed.out
    with pytest.raises(typer.Exit) as ended:
        carry_out(run(BAD), tmp_path, True)
    assert ended.value.exit_code == 1
    printed = capsys.readouterr()
    assert json.loads(printed.out) == BAD.document()
    assert "weighing" in printed.err
    assert "too heavy" in printed.err


def test_numbers_of_an_option():
    assert numbers("--rates", "1, 2.5,", float) == [1.0, 2.5]
    with pytest.raises(InvalidInputError, match=r"--delays.*whole numbers with commas.*'1,x'"):
        numbers("--delays", "1,x", int)


@pytest.mark.parametrize("command", ["impedance", "limits", "compare", "passivity"])
def test_each_command_refuses_delays_that_are_no_numbers(command):
    with pytest.raises(InvalidInputError, match="--delays"):
        ran("feel", command, "two_link", "--delays", "1,x")


def test_work_is_shared_in_order():
    assert list(in_order(abs, [-3, 2, -1], 1)) == [3, 2, 1]
    assert list(in_order(abs, [-3, 2, -1], 2)) == [3, 2, 1]
    with pytest.raises(InvalidInputError, match=r"processes.*1 or more.*got 0"):
        list(in_order(abs, [], 0))
