# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command that runs the campaign, and what it does with parts that cannot be measured."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest
from typer.testing import CliRunner

from benchmarks.children import BenchError
from benchmarks.reliability import __main__ as campaign
from benchmarks.reliability import disk, emulated_network, stepped_clock
from benchmarks.reliability.document import BEGIN, DOCUMENT, END, RESULTS, with_table
from benchmarks.reliability.figure import MACHINE, Figure, load, save, table
from benchmarks.reliability.full_disk import NoDiskError
from benchmarks.reliability.stepped_clock import NoCompilerError
from benchmarks.reliability.usage import grown
from hapticmech_ros.errors import HapticMechError

GOOD = Figure("zero", 12.0, "ms", most=20.0, trials=4, part="kills")
BAD = Figure("zero", 21.0, "ms", most=20.0, trials=4, part="kills")
PLAIN = Figure("clean", 0.5, "N", part="kills")

Part = Callable[[bool, Path], list[Figure]]


def run(*words: str | Path) -> int:
    """Run the command, and return its exit code."""
    return CliRunner().invoke(campaign.app, [str(word) for word in words]).exit_code


@pytest.fixture
def part(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, Part], None]:
    """Return what puts another part in a part's place."""

    def put(name: str, run: Part) -> None:
        module = ModuleType(f"benchmarks.reliability.{name}")
        module.run = run  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)

    return put


def test_the_exit_code_says_whether_all_limits_are_kept(
    part: Callable[[str, Part], None], tmp_path: Path
) -> None:
    out = ["--out", tmp_path / "new"]
    part("kills", lambda quick, out: [GOOD, PLAIN])
    assert run("kills", *out) == 0
    *measured, speed = load(tmp_path / "new" / campaign.JSON_NAME)
    assert measured == [GOOD, PLAIN]
    assert (speed.part, speed.name) == ("kills", MACHINE)
    assert speed.value > 0.0
    part("kills", lambda quick, out: [GOOD, BAD])
    assert run("kills", *out) == 1


def test_quick_is_told_and_a_part_run_again_replaces_its_own_figures(
    part: Callable[[str, Part], None], tmp_path: Path
) -> None:
    told: list[bool] = []

    def of_kills(quick: bool, out: Path) -> list[Figure]:
        told.append(quick)
        return [GOOD]

    other = Figure("zero", 1.0, part="clocks")
    save([BAD, other], tmp_path / campaign.JSON_NAME)
    part("kills", of_kills)
    assert run("kills", "--quick", "--out", tmp_path) == 0
    assert told == [True]
    found = [figure for figure in load(tmp_path / campaign.JSON_NAME) if figure.name != MACHINE]
    assert found == [GOOD, other]


def test_a_part_that_breaks_off_keeps_no_limit_and_says_why(
    part: Callable[[str, Part], None], tmp_path: Path
) -> None:
    def of_kills(quick: bool, out: Path) -> list[Figure]:
        raise BenchError("waited 20 s in vain for the device to render")

    part("kills", of_kills)
    assert run("kills", "--out", tmp_path) == 1
    (found,) = load(tmp_path / campaign.JSON_NAME)
    assert "in vain for the device" in found.note
    assert math.isnan(found.value)


def test_what_a_machine_cannot_measure_is_not_kept_and_the_exit_code_says_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(error: Exception) -> Callable[..., None]:
        def refused(*arguments: object) -> None:
            raise error

        return refused

    monkeypatch.setattr(stepped_clock, "compiler", refuse(NoCompilerError("no C compiler")))
    monkeypatch.setattr(disk, "FullDisk", refuse(NoDiskError("no mount")))
    monkeypatch.setattr(emulated_network, "not_permitted", lambda: "no namespaces")
    for name in ("clocks", "disk", "network", "users", "exposure"):
        assert run(name, "--quick", "--out", tmp_path) == 1
    found = load(tmp_path / campaign.JSON_NAME)
    assert [one.part for one in found] == ["clocks", "network", "users", "exposure", "disk"]
    assert all(math.isnan(one.value) and one.note.startswith("no ") for one in found)
    assert table(found).count("| **no** |") == 5


def test_the_document_has_one_place_for_the_table_which_holds_what_was_measured() -> None:
    text = DOCUMENT.read_text("utf-8")
    changed = with_table(text, [GOOD])
    assert table([GOOD]) in changed
    assert with_table(changed, [GOOD]) == changed
    assert changed.partition(BEGIN)[0] == text.partition(BEGIN)[0]
    assert changed.partition(END)[2] == text.partition(END)[2]
    if RESULTS.exists():
        assert with_table(text, load(RESULTS)) == text
    with pytest.raises(HapticMechError, match="once each"):
        with_table("no place", [GOOD])


def test_growth_is_seen_through_single_samples_that_are_far_off() -> None:
    times = [float(second) for second in range(100)]
    leak = [1000.0 + 8.0 * second for second in times]
    # The last three quarters, of which a fifth is wild.
    wild = [value + 1e6 * (index % 5 == 0) for index, value in enumerate(leak)]
    assert grown(times, leak) == pytest.approx(8.0 * 74)
    assert grown(times, wild) == pytest.approx(8.0 * 74, rel=0.05)
    assert grown(times, [5.0] * 100) == 0.0
    # What the start takes does not count.
    assert grown(times, [min(value, 20.0) for value in times]) == 0.0
    with pytest.raises(BenchError, match="8 or more"):
        grown(times[:9], leak[:9])
