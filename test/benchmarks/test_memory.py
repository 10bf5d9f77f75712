# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The memory benchmark: what it reads, its slopes and verdicts, its files and its command."""

from __future__ import annotations

import json
import mmap
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app_of
from benchmarks.memory.benchmark import Settings, watch_session
from benchmarks.memory.growth import GROWTH_IN_AN_HOUR, LEAST_SAMPLES, Watch, grown, resident, trend
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene

PAGE, SIZE = 4096.0, 64_000_000
TIMES = np.arange(0.0, 3600.0, 5.0)


def test_this_process_is_as_large_as_the_kernel_says() -> None:
    grown = []
    # The system may take back other pages of this process meanwhile.
    for _ in range(5):
        before = resident(os.getpid())
        # Pages of its own: the heap may have so many that are free.
        block = mmap.mmap(-1, SIZE)
        block.write(b"1" * SIZE)
        after = resident(os.getpid())
        assert before is not None
        assert after is not None
        grown.append(after.resident - before.resident)
        assert not after.private <= 0.9 * SIZE
        block.close()
    assert max(grown) > 0.9 * SIZE


def test_a_process_that_is_no_more_has_no_size() -> None:
    process = subprocess.Popen([sys.executable, "-c", "pass"])
    process.wait()
    assert resident(process.pid) is None
    watch = Watch()
    assert not watch.look(0.0, {"gone": process.pid})
    assert watch.times == []


def test_the_slope_is_that_of_a_line() -> None:
    found = trend(TIMES, 5e7 + 1234.5 * TIMES)
    assert found.slope == pytest.approx(1234.5)
    assert found.slope_error == pytest.approx(0.0, abs=1e-3)
    assert found.per_hour == pytest.approx(1234.5 * 3600.0)
    assert not found.flat
    assert "MiB an hour" in found.verdict


@pytest.mark.parametrize("leaked", [8.0, 24.0])
def test_a_few_bytes_in_each_tick_are_growth(leaked: float) -> None:
    """At 1 kHz, in pages of 4 KiB, within ten minutes."""
    times = TIMES[TIMES < 600.0]
    sizes = 1e8 + PAGE * np.floor(1e3 * leaked * times / PAGE)
    assert not trend(times, sizes).flat


def test_what_fills_while_it_starts_is_no_growth() -> None:
    sizes = 1e8 + 3e7 * np.minimum(TIMES / 600.0, 1.0)
    assert trend(TIMES, sizes).flat
    assert not trend(TIMES, sizes, warm_up=0.0).flat


def test_noise_and_a_page_now_and_then_are_no_growth() -> None:
    noise = PAGE * np.random.default_rng(1).integers(-20, 20, TIMES.size)
    assert trend(TIMES, 1e8 + noise).flat
    assert trend(TIMES, 1e8 + np.zeros(TIMES.size)).verdict == "flat"
    slow = 0.5 * GROWTH_IN_AN_HOUR / 3600.0
    assert trend(TIMES, 1e8 + slow * TIMES).flat
    assert trend(TIMES, 1e8 - 1e3 * TIMES).flat


@pytest.mark.parametrize("count", [0, 1, LEAST_SAMPLES - 1])
def test_too_few_samples_say_nothing(count: int) -> None:
    with pytest.raises(InvalidInputError, match="must be 8 or more"):
        trend(np.arange(count), np.ones(count), warm_up=0.0)
    with pytest.raises(InvalidInputError, match="as many as"):
        trend(np.arange(9), np.ones(8))


@pytest.mark.parametrize(
    "bad",
    [
        {"hours": -1.0},
        {"hours": 0.0, "minutes": 0.0},
        {"minutes": float("nan")},
        {"period": 0.0},
        {"layout": "heap"},
        {"warm_up": 1.0},
    ],
    ids=str,
)
def test_settings_refuse_what_says_nothing(bad: dict[str, object]) -> None:
    with pytest.raises(InvalidInputError, match="must"):
        Settings(**bad)  # type: ignore[arg-type]


def test_a_session_is_watched_from_its_first_tick_to_its_last() -> None:
    watch = watch_session(load_scene("two_link"), 200, samples=20)
    assert watch.times == pytest.approx(np.linspace(0.0, 0.2, 21).tolist())
    (one,) = grown("session", watch, 200, 0.25)
    assert one.trend.samples == 16
    assert one.trend.first > 1e7


def test_the_command_writes_files_and_says_what_grows(tmp_path: Path) -> None:
    arguments = ["memory", "two_link", "--hours", "0.0002", "--minutes", "0"]
    run = CliRunner().invoke(app_of(), [*arguments, "--out", str(tmp_path), "--json"])
    document = json.loads(run.stdout)
    assert run.exit_code == (0 if document["flat"] else 1)
    assert document == json.loads((tmp_path / "bench_memory.json").read_text(encoding="utf-8"))
    (process,) = document["processes"]
    assert process["ticks"] == 720
    assert (process["trend"]["verdict"] == "flat") == document["flat"]
    assert len(document["watches"]["session"]["times"]) == 401
    assert (tmp_path / "bench_memory.png").stat().st_size > 5_000
