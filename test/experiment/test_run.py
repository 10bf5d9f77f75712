# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Results on disk and in the terminal."""

import dataclasses
import json
import time

from rich.console import Console

from hapticmech_ros.experiment import GraphHealth, NodeHealth, compare, record_from_bag
from hapticmech_ros.experiment.figure_style import titled
from hapticmech_ros.experiment.report import table
from hapticmech_ros.experiment.run import write_results
from hapticmech_ros.experiment.summary import summarise


def printed(summary):
    console = Console(width=120, record=True, quiet=False, file=None, force_terminal=False)
    with console.capture() as capture:
        console.print(table(summary))
    return capture.get()


def test_writes_summary_and_figures(session_record, scene, tmp_path):
    summary = write_results(session_record, scene, tmp_path / "deep" / "out")
    folder = tmp_path / "deep" / "out"
    assert sorted(path.name for path in folder.iterdir()) == [
        "fig5a.png",
        "fig5b.png",
        "fig5c.png",
        "summary.json",
    ]
    assert json.loads((folder / "summary.json").read_text(encoding="utf-8")) == summary
    text = printed(summary)
    assert "five_bar (session)" in text
    assert "1 → 2 at" in text
    assert "Hz" not in text
    assert "incomplete" not in text
    assert write_results(session_record, scene, folder) == summary


def test_graph_with_diagnostics_and_agreement(make_bag, session_record, scene, tmp_path):
    record = record_from_bag(make_bag(), scene)
    figures = {
        "missed_deadlines": 3,
        "loop_latency_p50_us": 512,
        "loop_latency_p99_us": 900,
        "loop_latency_max_us": 1500,
    }
    health = GraphHealth({"haptic_device": NodeHealth("ok", "rendering", figures)})
    begun = time.process_time()
    summary = write_results(record, scene, tmp_path, health, session_record)
    # A budget, not a measurement: 1 s is usual, 8 s is too long to wait for.
    assert time.process_time() - begun < 8.0
    assert summary["agreement"] == compare(record, session_record)
    text = printed(summary)
    assert "500.0 Hz" in text
    assert "0.51 / 0.90 / 1.50" in text
    assert "deviation from session" in text


def test_table_of_a_graph_that_says_nothing(handmade, scene):
    summary = summarise(handmade(source="graph"), scene, None)
    assert "1 throughout" in printed(summary)
    assert "–" in printed(summary)


def test_table_says_what_was_not_recorded(session_record, scene):
    late = session_record.wrench_times > 1.2
    record = dataclasses.replace(
        session_record,
        wrench_times=session_record.wrench_times[late],
        constraint_wrench=session_record.constraint_wrench[late],
    )
    text = " ".join(printed(summarise(record, scene, None)).split())
    assert "recording incomplete │ no constraint wrench for 1.20 s" in text


def test_figures_say_whether_the_graph_ran_in_lockstep(session_record, scene):
    in_lockstep = dataclasses.replace(session_record, lockstep=True)
    rate = f"Control rate {1.0 / scene.simulation.period:g} Hz"
    assert titled(scene, "Fig. 5a", "Text.", session_record).endswith(f"Text. {rate}.")
    assert titled(scene, "Fig. 5a", "Text.", in_lockstep).endswith(f"Text. {rate}, in lockstep.")
