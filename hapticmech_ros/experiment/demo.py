# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's experiment over the graph of nodes: start, record, stop, and write the results."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from hapticmech_ros.compilation.library import compile_ahead
from hapticmech_ros.errors import BagError, HapticMechError
from hapticmech_ros.experiment.agreement import compare
from hapticmech_ros.experiment.from_bag import record_from_bag
from hapticmech_ros.experiment.from_session import run_session
from hapticmech_ros.experiment.health import health_from_bag
from hapticmech_ros.experiment.run import write_results, write_shared_results
from hapticmech_ros.experiment.shared_from_bag import shared_record_from_bag
from hapticmech_ros.experiment.shared_from_session import run_shared_session
from hapticmech_ros.graph import (
    Graph,
    ending,
    private_environment,
    start_process,
    stop_process,
    told_by,
)
from hapticmech_ros.loading import load_scene

RECORDER = "hapticmech_ros.nodes.recorder"

# (stage, share done, or None if unknown)
Show = Callable[[str, float | None], None]


class DemoError(HapticMechError):
    """The demo could not be completed."""


def run_demo(
    scene_name: str,
    out: Path,
    composed: bool = False,
    duration: float | None = None,
    storage: str = "mcap",
    show: Show = lambda stage, done: None,
) -> dict[str, object]:
    """Run the experiment over ROS.

    Writes into ``out``: ``bag/``, ``fig5a.png``, ``fig5b.png``, ``fig5c.png``, ``summary.json``; of
    several users ``users.png``, ``coupling.png``, and the former ones in a folder for each. Files
    of the same names from an earlier run are replaced.

    Returns:
        Summary of the run.

    Raises:
        SceneError: no such scene, or a bad one.
        DemoError: a node ended, or the hand never started.
        BagError: ``out/bag`` exists and is not a bag.
    """
    scene = load_scene(scene_name)
    seconds = scene.experiment.duration if duration is None else duration
    bag = out / "bag"
    _clear(bag)
    record_graph(scene_name, bag, composed, seconds, storage, show)
    show("reading the bag", None)
    if len(scene.held_points) > 1:
        shared = shared_record_from_bag(bag, scene, duration=seconds)
        show("simulating the same without ROS", None)
        both = run_shared_session(scene, seconds)
        show("drawing", None)
        return write_shared_results(shared, scene, out, health_from_bag(bag), both)
    record = record_from_bag(bag, scene, duration=seconds)
    show("simulating the same without ROS", None)
    reference = run_session(scene, seconds)
    show("drawing", None)
    return write_results(
        record,
        scene,
        out,
        graph=health_from_bag(bag),
        agreement=compare(record, reference),
        reference=reference,
    )


def record_graph(
    scene_name: str,
    bag: Path,
    composed: bool,
    seconds: float,
    storage: str = "mcap",
    show: Show = lambda stage, done: None,
) -> None:
    """Record a graph whose hands start once the recorder receives all topics.

    Args:
        scene_name: shipped scene, or path.
        bag: folder to make.
        composed: whether all nodes are in one process.
        seconds: s, from when the first hand starts.
        storage: mcap or sqlite3.
        show: called with the progress.

    Raises:
        DemoError: a node ended, or the hand never started.
    """
    # Before the recorder waits for the graph: the first compilation takes longer than its timeout.
    compile_ahead()
    environment = private_environment()
    command = [sys.executable, "-m", RECORDER, "--out", str(bag), "--scene", scene_name]
    command += ["--duration", str(seconds), "--storage", storage]
    recorder = start_process(command, environment, pipe_output=True)
    parameters: dict[str, object] = {"haptic_device.wait_for_start": True}
    try:
        events = told_by(recorder)
        _expect(events, "ready")
        show("starting the graph", None)
        scene = load_scene(scene_name)
        hold = scene.held_points if scene.hands else ()
        with Graph(
            scene_name, composed, "", parameters, environment, hold=hold, shown=True
        ) as graph:
            for event in events:
                if event["event"] == "progress":
                    graph.check()
                    show("pushing and recording", event["elapsed_s"] / seconds)
                elif event["event"] == "failed":
                    graph.check()
                    raise DemoError(f"recording failed: {event['reason']}")
                elif event["event"] == "done":
                    return
        raise DemoError(f"{ending('the recorder', recorder)}: {bag} is incomplete")
    finally:
        stop_process(recorder)


def _expect(events: Iterator[dict[str, Any]], name: str) -> None:
    event = next(events, {"event": "failed", "reason": "the recorder ended at once"})
    if event["event"] != name:
        raise DemoError(f"recording failed: {event.get('reason', event)}")


def _clear(bag: Path) -> None:
    """Remove an earlier bag.

    Raises:
        BagError: ``bag`` exists and is not a bag.
    """
    if not bag.exists():
        bag.parent.mkdir(parents=True, exist_ok=True)
        return
    if not (bag / "metadata.yaml").is_file():
        raise BagError(f"{bag} exists and is not a rosbag2 bag: remove it, or choose another --out")
    shutil.rmtree(bag)
