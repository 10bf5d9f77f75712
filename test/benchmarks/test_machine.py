# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import pytest

from benchmarks.machine import MachineResults, Usage, cpu_ticks, load_between, machine, usage
from hapticmech_ros.analysis.study import Sheet


def test_the_name_of_a_process_does_not_confuse() -> None:
    rest = "S 1 1 1 0 -1 4194560 100 0 0 0 70 30 9 9 20 0 4 0 100 0 0"
    for name in ("python", "a (b) c", ") 1 2 3"):
        assert cpu_ticks(f"123 ({name}) {rest}") == 100


def test_load_is_counters_per_time() -> None:
    before = Usage(10.0, {"node": 1.0, "gone": 5.0}, 100.0, 40.0, 1.0)
    after = Usage(20.0, {"node": 4.0, "new": 2.0}, 120.0, 45.0, 2.0)
    load = load_between(before, after)
    assert load.cpu == pytest.approx({"node": 0.3})
    assert load.busy == pytest.approx(0.75)
    assert load.stolen == pytest.approx(0.05)


def test_own_time_is_seen_and_never_runs_back() -> None:
    before = usage({"self": os.getpid(), "nobody": 2**22 + 1})
    sum(range(200_000))
    after = usage({"self": os.getpid()})
    assert set(before.cpu_s) == {"self"}
    assert after.cpu_s["self"] >= before.cpu_s["self"] > 0.0
    assert after.all_s >= before.all_s >= before.idle_s + before.steal_s > 0.0
    load = load_between(before, after)
    assert load.cpu["self"] >= 0.0


def test_the_machine_is_described() -> None:
    described = machine()
    assert {"cores", "kernel", "python"} <= set(described)
    assert all(described.values())


@dataclass(frozen=True)
class Timed(MachineResults):
    NAME: ClassVar[str] = "timed"

    def sheets(self) -> Iterator[Sheet]:
        yield Sheet("times", ("what", "µs"), (("nothing", "0"),))


def test_the_speed_of_the_machine_stands_beside_every_table() -> None:
    results = Timed(machine())
    about, line = results.notes()
    assert "python" in about
    assert "_us" not in about
    assert results.markdown().splitlines()[-1] == line
    times = re.fullmatch(r".*: (\S+) µs for one analysis .*, (\d+) µs for sum\(.*\)", line)
    assert times
    assert all(float(time) > 0.0 for time in times.groups())
    assert {"analysis_us", "python_loop_us"} <= set(results.document()["machine"])
