# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a tick costs: compared first, told with its goals."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.__main__ import app_of
from benchmarks.session import benchmark
from benchmarks.session.benchmark import SessionResults, TickCost, check_agreement
from hapticmech_ros import load_scene
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.session import Session


def test_ticks_that_differ_from_their_run_are_not_timed(monkeypatch):
    class Off(Session):
        def run(self, ticks):
            found = super().run(ticks)
            found["q"][7] += 1e-12
            return found

    check_agreement(load_scene("two_link"))
    monkeypatch.setattr(benchmark, "Session", Off)
    with pytest.raises(HapticMechError, match="two_link: tick 7 differs"):
        check_agreement(load_scene("two_link"))


def test_goals_are_of_the_five_bar_and_of_the_slowest():
    costs = [
        TickCost(name, tick, tick, 20.0, {}, None)
        for name, tick in (("five_bar", 24.0), ("x", 90.0))
    ]
    outcomes = [goal.outcome for goal in SessionResults({}, 200, 3, tuple(costs)).goals]
    assert outcomes == ["pass", "pass", "pass", "FAIL"]
    outcomes = [goal.outcome for goal in SessionResults({}, 200, 3, tuple(costs[1:])).goals]
    assert outcomes == ["not measured"] * 3 + ["FAIL"]


def test_the_command_tells_every_part(tmp_path):
    arguments = ["session", "two_link", "--rounds", "2", "--out", str(tmp_path), "--json"]
    found = CliRunner().invoke(app_of(["session"]), arguments)
    assert found.exit_code == 0, found.output
    (cost,) = json.loads((tmp_path / "bench_session.json").read_text())["costs"]
    assert cost["scene"] == "two_link"
    assert all(np.isfinite(value) and value > 0.0 for value in cost["parts"].values())
    assert cost["ratio"] == pytest.approx(cost["tick"] / cost["run"])
