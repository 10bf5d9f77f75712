# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""At which rate the demo runs: the scene's, or a lower one that the machine carries."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from hapticmech_ros.experiment import demo
from hapticmech_ros.experiment.demo import DemoError, GraphRun, record_graph, run_demo
from hapticmech_ros.graph import GraphLoad, events_of, start_process, stop_process
from hapticmech_ros.system.readiness import Report

# Says that it is ready and waits, then gets no processor.
STARVED = """
import time
print('{"event": "ready"}', flush=True)
print('{"event": "waiting", "missing": ["/device/state"]}', flush=True)
time.sleep(600.0)
"""

# Pushes for a second, as it says.
RECORDING = """
for event in ('"ready"', '"waiting", "missing": []', '"progress", "elapsed_s": 0.5', '"done"'):
    print('{"event": %s}' % event, flush=True)
"""


class Machine:
    """Graphs on a machine that carries them up to a rate, and interrupts them up to another."""

    def __init__(
        self,
        carries_hz: float,
        calm_hz: float = 1e9,
        period_us: float = 1000.0,
        prompt_hz: float = 1e9,
    ) -> None:
        self.carries_hz, self.calm_hz, self.period_us = carries_hz, calm_hz, period_us
        self.prompt_hz = prompt_hz
        self.rates: list[float] = []
        self.lockstep = 0
        self.said: list[str] = []

    def record(self, *arguments: Any, must_fit: bool) -> GraphRun:
        rate = arguments[-1]
        self.rates.append(rate)
        missed = 0.0 if rate <= self.carries_hz else 0.5
        used = 1e-6 * self.period_us * rate * (1.0 - missed)
        load = GraphLoad(rate, 2.0, used, missed)
        run = GraphRun(load, 0 if rate <= self.calm_hz else 3, rate > self.prompt_hz)
        if must_fit and not run.kept:
            raise demo._DoesNotFitError(run)
        return run

    def record_in_lockstep(self, *arguments: Any) -> GraphRun:
        self.lockstep += 1
        return GraphRun(None, 0, lockstep=True)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    def begin(machine: Machine, control_rate: float = 0.0) -> float:
        def results(scene: Any, *arguments: Any) -> dict[str, float]:
            assert arguments[-2].lockstep == bool(machine.lockstep)
            return {"period": scene.simulation.period}

        monkeypatch.setattr(demo, "record_graph", machine.record)
        monkeypatch.setattr(demo, "record_in_lockstep", machine.record_in_lockstep)
        monkeypatch.setattr(demo, "_results", results)
        found = run_demo(
            "five_bar", tmp_path, control_rate=control_rate, notify=machine.said.append
        )
        return 1.0 / float(found["period"])  # type: ignore[arg-type]

    return begin


def test_a_machine_that_carries_the_scenes_rate_runs_it_once(run: Any) -> None:
    machine = Machine(carries_hz=1000.0)
    assert run(machine) == pytest.approx(1000.0)
    assert machine.rates == [1000.0]
    assert machine.lockstep == 0


def test_a_smaller_machine_runs_a_lower_rate_and_says_so(run: Any) -> None:
    machine = Machine(carries_hz=600.0)
    assert run(machine) == pytest.approx(500.0)
    assert machine.rates == [1000.0, 500.0]
    assert any("the demo runs at 500 Hz" in sentence for sentence in machine.said)


def test_what_a_period_costs_tells_the_rate_at_once(run: Any) -> None:
    machine = Machine(carries_hz=300.0, period_us=4000.0)
    assert run(machine) == pytest.approx(250.0)
    assert machine.rates == [1000.0, 250.0]


def test_an_interrupted_run_is_done_again_more_slowly(run: Any) -> None:
    machine = Machine(carries_hz=1000.0, calm_hz=250.0)
    assert run(machine) == pytest.approx(250.0)
    assert machine.rates == [1000.0, 500.0, 250.0]
    assert machine.lockstep == 0


def test_a_run_with_other_gains_than_the_scenes_is_done_again_in_lockstep(run: Any) -> None:
    machine = Machine(carries_hz=1000.0, prompt_hz=500.0)
    assert run(machine) == pytest.approx(1000.0)
    assert (machine.rates, machine.lockstep) == ([1000.0], 1)
    assert "gains allow, which were reduced: the demo runs in lockstep" in machine.said[-1]


def test_a_machine_that_carries_no_rate_runs_the_lowest_in_lockstep(run: Any) -> None:
    machine = Machine(carries_hz=10.0, calm_hz=10.0)
    assert run(machine) == pytest.approx(250.0)
    assert (machine.rates[-1], machine.lockstep) == (250.0, 1)
    assert "the demo runs in lockstep" in machine.said[-1]


def test_the_lowest_rate_may_take_more_than_half_of_the_machine(run: Any) -> None:
    machine = Machine(carries_hz=1000.0, period_us=5000.0)
    assert run(machine) == pytest.approx(250.0)
    assert (machine.rates, machine.lockstep) == ([1000.0, 250.0], 0)


def test_a_rate_that_is_wanted_is_kept(run: Any) -> None:
    machine = Machine(carries_hz=100.0, calm_hz=100.0)
    assert run(machine, 400.0) == pytest.approx(400.0)
    assert (machine.rates, machine.lockstep) == ([400.0], 0)
    assert machine.said[-1].endswith("take the results with care")


class Saturated:
    """A graph that misses half of its deadlines."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self.begun = time.monotonic()

    def __enter__(self) -> Saturated:
        return self

    def __exit__(self, *error: object) -> None:
        """Nothing runs."""

    def check(self) -> None:
        """All is well."""

    def reports(self) -> dict[str, Report]:
        now = time.monotonic()
        periods = int(500.0 * (now - self.begun))
        figures = {
            "pid": "1",
            "cpu_s": f"{2.0 * now}",
            "monotonic_s": f"{now}",
            "periods": f"{periods}",
            "missed_deadlines": f"{periods // 2}",
        }
        return {"/haptic_device": Report("/haptic_device", True, "", figures)}


class Slow(Saturated):
    """A graph whose controller has reduced its gains for a longer delay than declared."""

    declared_ms = 3.0

    def reports(self) -> dict[str, Report]:
        figures = {"softened_for_ms": "6.0", "designed_delay_ms": f"{self.declared_ms:.1f}"}
        figures["monotonic_s"] = f"{self.reported():.6f}"
        return {"/controller": Report("/controller", True, "", figures)}

    def reported(self) -> float:
        """Return when the controller has reported last, s of the monotonic clock."""
        return time.monotonic()


class Declared(Slow):
    """A graph over a network, whose gains are those for the delay that is declared."""

    declared_ms = 6.0


class SlowBefore(Slow):
    """A graph whose gains were reduced while it started, as its last report says."""

    def reported(self) -> float:
        return self.begun


@pytest.mark.parametrize(
    ("graph", "reduced"), [(Slow, True), (Declared, False), (SlowBefore, False)]
)
def test_reduced_gains_are_found_in_the_diagnostics(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, graph: type[Slow], reduced: bool
) -> None:
    def recording(*arguments: Any, **options: Any) -> Any:
        return start_process([sys.executable, "-c", RECORDING], {}, pipe_output=True)

    monkeypatch.setattr(demo, "start_process", recording)
    monkeypatch.setattr(demo, "Graph", graph)
    run = record_graph("five_bar", tmp_path / "bag", False, 1.0)
    assert run.reduced_gains is reduced


def starved(command: Sequence[str], *arguments: Any, **options: Any) -> Any:
    return start_process([sys.executable, "-c", STARVED], {}, pipe_output=True)


def test_a_graph_that_starves_its_recorder_is_given_up(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(demo, "start_process", starved)
    monkeypatch.setattr(demo, "Graph", Saturated)
    monkeypatch.setattr(demo, "STARTS_WITHIN_S", 0.3)
    monkeypatch.setattr(demo, "PATIENCE_S", 0.1)
    with pytest.raises(DemoError, match="did not keep the rate") as given:
        record_graph("five_bar", tmp_path / "bag", False, 1.0, must_fit=True)
    assert given.value.run.load.missed == pytest.approx(0.5, abs=0.01)  # type: ignore[attr-defined]


def test_a_process_that_tells_nothing_is_noticed() -> None:
    process = starved([])
    try:
        events = events_of(process, 0.2)
        told = [next(one["event"] for one in events if one["event"] != "nothing") for _ in "12"]
        assert told == ["ready", "waiting"]
        assert next(events) == {"event": "nothing"}
    finally:
        stop_process(process)
    assert all(one == {"event": "nothing"} for one in events)
