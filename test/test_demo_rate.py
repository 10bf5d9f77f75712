# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""At which rate the demo runs: the scene's, or a lower one that the machine carries."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from hapticmech_ros.graph import demo
from hapticmech_ros.graph.demo import GraphRun, record_graph, run_demo
from hapticmech_ros.graph.processes import GraphLoad, events_of, start_process, stop_process
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


@dataclass
class Machine:
    """Graphs on a machine that carries them up to a rate, and interrupts them up to another."""

    carries_hz: float = 1000.0
    calm_hz: float = 1e9
    period_us: float = 1000.0
    prompt_hz: float = 1e9
    rates: list[float] = field(default_factory=list)
    lockstep: int = 0
    said: list[str] = field(default_factory=list)

    def record(self, *arguments: Any, **options: Any) -> GraphRun:
        rate = arguments[-1]
        self.rates.append(rate)
        missed = 0.0 if rate <= self.carries_hz else 0.5
        used = 1e-6 * self.period_us * rate * (1.0 - missed)
        load = GraphLoad(rate, 2.0, used, missed)
        return GraphRun(load, 0 if rate <= self.calm_hz else 3, rate > self.prompt_hz)

    def record_in_lockstep(self, *arguments: Any) -> GraphRun:
        self.lockstep += 1
        return GraphRun(None, 0, lockstep=True)


RATES = [1000.0, 500.0, 250.0]
IN_LOCKSTEP = "the demo runs in lockstep"


@pytest.mark.parametrize(
    ("machine", "wanted", "rates", "lockstep", "said"),
    [
        # The scene's rate is carried.
        (Machine(), 0.0, RATES[:1], 0, "a period of 1 ms"),
        # A smaller machine runs a lower one, and says so.
        (Machine(carries_hz=600.0), 0.0, RATES[:2], 0, "the demo runs at 500 Hz"),
        # What a period costs tells the rate at once.
        (Machine(carries_hz=300.0, period_us=4000.0), 0.0, [1000.0, 250.0], 0, "at 250 Hz"),
        # An interrupted run is done again more slowly.
        (Machine(calm_hz=250.0), 0.0, RATES, 0, "interrupted 3 times: the demo runs at 250 Hz"),
        # One with other gains than the scene's is done again in lockstep, at the same rate.
        (
            Machine(prompt_hz=500.0),
            *(0.0, RATES[:1], 1),
            f"gains allow, which were reduced: {IN_LOCKSTEP}",
        ),
        # Where no rate is carried, it is the lowest in lockstep.
        (Machine(carries_hz=10.0, calm_hz=10.0), 0.0, RATES, 1, IN_LOCKSTEP),
        # The lowest rate may take more than half of the machine.
        (Machine(period_us=5000.0), 0.0, [1000.0, 250.0], 0, "at 250 Hz"),
        # A rate that is wanted is kept.
        (Machine(100.0, 100.0), 400.0, [400.0], 0, "take the results with care"),
    ],
)
def test_the_demo_runs_at_the_rate_that_the_machine_carries(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    machine: Machine,
    wanted: float,
    rates: list[float],
    lockstep: int,
    said: str,
) -> None:
    def results(scene: Any, *arguments: Any) -> dict[str, float]:
        assert arguments[-2].lockstep == bool(lockstep)
        return {"period": scene.simulation.period}

    monkeypatch.setattr(demo, "record_graph", machine.record)
    monkeypatch.setattr(demo, "record_in_lockstep", machine.record_in_lockstep)
    monkeypatch.setattr(demo, "_results", results)
    found = run_demo("five_bar", tmp_path, control_rate=wanted, notify=machine.said.append)
    assert 1.0 / float(found["period"]) == pytest.approx(rates[-1])  # type: ignore[arg-type]
    assert (machine.rates, machine.lockstep) == (rates, lockstep)
    assert any(said in sentence for sentence in machine.said)


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
    run = record_graph("five_bar", tmp_path / "bag", False, 1.0, must_fit=True)
    assert "did not keep the rate" in run.reason()
    assert run.load is not None
    assert run.load.missed == pytest.approx(0.5, abs=0.01)


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
