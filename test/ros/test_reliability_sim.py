# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The campaign's short form for /clock: a graph of its own, and no other one beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.reliability.clocks import try_step
from benchmarks.reliability.rig import Rig
from benchmarks.reliability.stepped_clock import SteppedClock
from ros.harness import next_domain
from ros.test_reliability import survived

pytestmark = [pytest.mark.ros, pytest.mark.alone]


def test_a_clock_of_simulated_time_that_goes_back(tmp_path: Path) -> None:
    with SteppedClock(tmp_path) as clock:
        domain, given = next_domain(), {"use_sim_time": True}
        with Rig(
            tmp_path,
            "sim",
            parameters=given,
            clock=clock,
            domain=domain,
            clean=False,
            composed=True,
        ) as rig:
            survived(try_step(rig, clock, -8.0, "/clock"))
