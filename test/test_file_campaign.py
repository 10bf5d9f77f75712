# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The campaign of mutated files, in a form of a few seconds."""

import sys
from pathlib import Path

import pytest

# What is not installed is found beside the tests.
sys.path.append(str(Path(__file__).resolve().parents[1]))

from benchmarks.reliability import files
from benchmarks.reliability.files import Tally

MUTANTS = 100


def test_mutants_are_read_or_refused(tmp_path):
    figures = files.measured(MUTANTS, tmp_path)
    report = (tmp_path / "files" / "report.json").read_text()
    assert len(figures) == 9
    assert [one for one in figures if not one.kept] == [], report


def test_who_does_not_come_to_an_end_is_ended_and_counted(tmp_path):
    """No file is read within a microsecond; where the process was then is kept."""
    tally = files.read_mutants(1, tmp_path, patience_s=1e-6)
    assert set(tally.hangs) == {0}
    assert not tally.crashes
    assert "most recent call first" in (tmp_path / "hang_0").read_text()


@pytest.mark.parametrize(
    ("outcome", "seconds", "counted"),
    [("read", 0.1, (0, 0)), ("foreign: ValueError: x", 0.1, (0, 1)), ("refused", 5.1, (1, 0))],
)
def test_what_a_worker_says_is_counted(outcome, seconds, counted):
    tally = Tally()
    tally.add(7, said(outcome=outcome, seconds=seconds))
    assert (len(tally.hangs), len(tally.foreign)) == counted


def said(**given):
    """Return what a worker says of a mutant that does no harm, but for what is given."""
    harmless = {
        "kind": "scene", "outcome": "read", "seconds": 0.1, "real_s": 0.1, "blocked_s": 0.0,
        "memory_mb": 1.0, "resident_mb": 200.0, "process": 1,
    }  # fmt: skip
    return {**harmless, **given}


def tallied(*answers):
    tally = Tally()
    for number, one in enumerate(answers):
        tally.add(number, one)
    return tally


def life(growth_mb, process=1, count=300):
    """Return answers of a worker that grows evenly, beside large files that it gives back."""
    return [
        said(
            process=process,
            outcome="read" if index % 3 else "refused",
            resident_mb=200.0 + growth_mb * index / count + 300.0 * (index % 10 == 0),
        )
        for index in range(count)
    ]


GROWTH = "growth of a worker's resident memory"
WAITS = ["mutants that hung", "slowest mutant, blocked"]
TALLIES = {
    "large files": (tallied(*life(0.0), *life(0.0, 2)), []),
    "growth": (tallied(*life(0.0), *life(40.0, 2)), [GROWTH]),
    "no worker lived long enough to show growth": (
        tallied(*(one for process in range(10) for one in life(0.0, process, 30))),
        [GROWTH],
    ),
    "much memory": (
        tallied(*life(0.0), said(memory_mb=1200.0)),
        ["memory taken by one mutant at most"],
    ),
    "blocked": (tallied(*life(0.0), said(real_s=20.0, blocked_s=19.0)), WAITS),
    "waits for the processor": (tallied(*life(0.0), said(real_s=20.0)), []),
}
SILENT = tallied(*life(0.0))
SILENT.silent(300)
TALLIES["silent"] = SILENT, WAITS


@pytest.mark.parametrize(("tally", "broken"), TALLIES.values(), ids=TALLIES)
def test_limits_are_broken_by_what_breaks_them(monkeypatch, tmp_path, tally, broken):
    monkeypatch.setattr(files, "read_mutants", lambda number, folder: tally)
    monkeypatch.setattr(files, "_keep", lambda *arguments: None)
    assert [one.name for one in files.measured(300, tmp_path) if not one.kept] == broken


def test_growth_is_that_of_the_worker_that_grows_most():
    grown = tallied(*life(0.0), *life(40.0, 2))
    assert grown.growth_mb == pytest.approx(30.0, rel=0.05)
