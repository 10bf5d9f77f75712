# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from benchmarks.machine import MachineResults, machine
from hapticmech_ros.analysis.study import Sheet


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
