# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One run of the accuracy benchmark: what is measured, and what is said of a run that fails."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.accuracy import cases, crossings, pushed
from benchmarks.accuracy.benchmark import AccuracyResults
from benchmarks.accuracy.crossings import app
from benchmarks.accuracy.endurance import LongRuns, hour_of, minute_of_windows
from benchmarks.accuracy.run import Run, Setting, measure, settings

from .conftest import G, falling

LIBRARY = {case.name: case for case in cases()}


@pytest.fixture(scope="module")
def stone_runs() -> tuple[Run, ...]:
    chosen = settings(multiples=(2.0, 1.0), known=[falling()])
    return tuple(measure(setting) for setting in chosen)


def of(runs: tuple[Run, ...], integrator: str) -> list[Run]:
    return [run for run in runs if run.integrator == integrator]


def test_errors_are_those_of_the_rule(stone_runs: tuple[Run, ...]) -> None:
    for run in of(stone_runs, "rk4") + of(stone_runs, "rk2"):
        assert not run.failure
        assert run.error is not None
        assert run.error < 1e-13
        assert run.energy_error is not None
        assert run.energy_error < 1e-12
    for run in of(stone_runs, "semi_implicit_euler"):
        # v first, then x with the new v: g h t / 2 too low at the end.
        low = 0.5 * G * run.step * 0.04
        assert run.errors == pytest.approx({"stone_point": low, "up": low}, rel=1e-9)
        # v is exact, so that the energy is off by the height only.
        assert run.energy_error == pytest.approx(2.0 * G * low, rel=1e-9)


def test_only_the_scene_s_own_setting_is_held_to_its_tolerance(
    stone_runs: tuple[Run, ...],
) -> None:
    assert [(run.integrator, run.step, run.kept) for run in stone_runs if run.own] == [
        ("rk4", 1e-3, True)
    ]
    assert all(run.kept is None for run in stone_runs if not run.own)
    results = AccuracyResults({}, stone_runs)
    assert results.sound
    missed = tuple(replace(run, kept=False) if run.own else run for run in stone_runs)
    assert not AccuracyResults({}, missed).sound
    broken = tuple(replace(run, kept=None, errors={}) if run.own else run for run in stone_runs)
    assert not AccuracyResults({}, broken).sound


def test_a_mechanism_that_does_not_close_is_a_line_with_its_error() -> None:
    case = LIBRARY["n_four_bar_2"]
    far = case.scene.initial_state.model_copy(update={"v": {"j_upright0": 1e200}})
    broken = replace(case, scene=case.scene.model_copy(update={"initial_state": far}))
    run = measure(Setting(broken, "rk4", 1e-3))
    assert "Error: " in run.failure


def test_long_runs_watch_energy_closures_and_branch() -> None:
    told: list[str] = []
    bricard = hour_of(LIBRARY["bricard"], 0.3, told.append)
    assert not bricard.failure
    assert bricard.reached == pytest.approx(0.3)
    assert bricard.ranks == (4,)
    assert bricard.off_branch is None
    assert bricard.closure_error < 1e-11
    assert told
    windows = minute_of_windows(2, 0.3)
    assert windows.off_branch is not None
    assert windows.off_branch < 1e-9
    assert max(windows.energy_rise, windows.energy_fall) < 1e-8
    (sheet,) = LongRuns({}, (windows,)).sheets()
    assert f"{windows.off_branch:.1e}" in sheet.rows[0]


def test_crossings_are_counted_and_the_worst_ones_written(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["--samples", "4", "--out", str(tmp_path)])
    assert result.exit_code == 0
    found = json.loads((tmp_path / "bench_crossings.json").read_text(encoding="utf-8"))["figures"]
    assert sum(figures["count"] for figures in found.values()) == 4
    for name, figures in found.items():
        assert f"| {name} | {figures['count']:.0f} |" in result.stdout
        assert not {"bad", "raised"} & set(figures)


def test_what_loses_energy_at_a_crossing_is_an_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(crossings, "ALLOWED", -1.0)
    result = CliRunner().invoke(app, ["--samples", "2", "--out", str(tmp_path)])
    assert result.exit_code == 1


@pytest.mark.parametrize("period", [crossings.PERIODS[0], crossings.PERIODS[-1]])
def test_a_motion_on_another_branch_is_bad_at_any_step(
    monkeypatch: pytest.MonkeyPatch, period: float
) -> None:
    """Off by a fifth of its way since the crossing, with a step that was not done with care."""
    case = crossings.Case("one parallelogram", "rk4", period)
    off = 0.2 * 5.0 * 6 * period
    monkeypatch.setattr(crossings, "beyond", lambda *_: (0.0, off, 0.0, False))
    tally = crossings.Tally()
    tally.see(case, 1e-3)
    assert tally.figures["one parallelogram"]["bad"] == 1
    assert not tally.sound


def test_scenes_are_pushed_and_what_is_silent_is_an_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["five_bar", "crane", "--duration", "0.3", "--out", str(tmp_path)]
    result = CliRunner().invoke(pushed.app, arguments)
    assert result.exit_code == 0, result.stdout
    found = json.loads((tmp_path / "bench_pushed.json").read_text(encoding="utf-8"))
    assert [one["scene"] for one in found] == ["five_bar", "crane"]
    for one in found:
        assert one["reached"] == pytest.approx(0.3)
        assert one["exchanged"] > 0.0
        assert f"| {one['scene']} |" in result.stdout
    monkeypatch.setattr(pushed, "ALLOWED", -1.0)
    assert CliRunner().invoke(pushed.app, arguments).exit_code == 1
