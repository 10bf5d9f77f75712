# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech demo`` on two processors that two other programs use as well."""

from pathlib import Path

import pytest

from benchmarks.small_machine.benchmark import Settings, run_small_machine

pytestmark = pytest.mark.alone

# The second joint constraint is felt after 2.3 s.
DURATION_S = 3.0


def test_the_demo_works_beside_busy_programs(in_domain: int, tmp_path: Path) -> None:
    settings = Settings(1, duration=DURATION_S, loads=("busy",), readers=1)
    results = run_small_machine(settings, tmp_path)
    (busy,) = results.loads
    (run,) = busy.runs
    assert run.failures == (), run.last_line
    assert len(busy.reads_s) == 1
    assert results.sound
