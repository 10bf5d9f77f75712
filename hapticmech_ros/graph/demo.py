# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's experiment over the graph of nodes: start, record, stop, and write the results."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from hapticmech_ros.compilation.library import compile_ahead
from hapticmech_ros.errors import BagError, HapticMechError
from hapticmech_ros.experiment.from_bag import record_from_bag, shared_record_from_bag
from hapticmech_ros.experiment.from_session import run_session, run_shared_session
from hapticmech_ros.experiment.record import health_from_bag
from hapticmech_ros.experiment.run import write_results, write_shared_results
from hapticmech_ros.graph.lockstep import LockstepRun, run_lockstep
from hapticmech_ros.graph.processes import (
    MOST_MISSED,
    RATES,
    Graph,
    GraphLoad,
    LoadWatch,
    ending,
    events_of,
    private_environment,
    start_process,
    stop_process,
)
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import Scene
from hapticmech_ros.system.cpu_list import available_cores
from hapticmech_ros.system.readiness import Report

RECORDER = "hapticmech_ros.nodes.recorder"
# If topics are still missing this long after the nodes are up, s, check if the graph fits.
STARTS_WITHIN_S = 8.0
PATIENCE_S = 0.5

# Called with the stage and the share done, or None if unknown.
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
    control_rate: float = 0.0,
    notify: Callable[[str], None] = lambda sentence: None,
) -> dict[str, object]:
    """Run the experiment over ROS.

    Unless a rate is given, the experiment is repeated at lower ones, of :data:`.processes.RATES`,
    while the machine cannot keep the rate or rendering is interrupted; then in lockstep if the last
    run missed deadlines, was interrupted or had its gains reduced.

    Writes into ``out``: ``bag/``, ``fig5a.png``, ``fig5b.png``, ``fig5c.png``, ``summary.json``;
    for several users ``users.png``, ``coupling.png``, and the former ones in a folder for each.
    Files of the same names from an earlier run are replaced.

    Args:
        scene_name: shipped scene, or path.
        out: folder for the results.
        composed: whether all nodes are in one process.
        duration: s, from when the first hand starts; the scene's if left out.
        storage: of the bag, mcap or sqlite3.
        show: called with the progress.
        control_rate: Hz; 0: the scene's, or a lower one if the machine cannot keep that.
        notify: called with sentences on the load of the machine.

    Returns:
        Summary of the run.

    Raises:
        SceneError: the scene does not exist, or is not valid.
        DemoError: recording failed, or the hand never started.
        NodeDiedError: a node ended by itself.
        LockstepError: the graph stalled in lockstep.
        BagError: ``out/bag`` exists and is not a bag.
    """
    scene = load_scene(scene_name, control_rate)
    seconds = scene.experiment.duration if duration is None else duration
    bag = out / "bag"
    rate = 1.0 / scene.simulation.period
    lower = [] if control_rate else [one for one in RATES if one < 0.99 * rate]
    while True:
        _clear(bag)
        run = record_graph(
            scene_name, bag, composed, seconds, storage, show, rate, must_fit=bool(lower)
        )
        if run.load is not None:
            notify(run.load.sentence())
        if run.kept or not lower:
            break
        fitting = None if run.load is None or run.load.fits else run.load.fitting_rate_hz
        rate = fitting or lower[0]
        notify(f"{run.reason()}: the demo runs at {rate:g} Hz")
        lower = [one for one in lower if one < 0.99 * rate]
    if not run.undisturbed:
        if control_rate:
            notify(f"{run.reason()}: take the results with care")
        else:
            notify(f"{run.reason()}: the demo runs in lockstep, as fast as the machine can")
            _clear(bag)
            run = record_in_lockstep(scene_name, bag, composed, seconds, storage, show, rate)
    scene = load_scene(scene_name, rate)
    return _results(scene, bag, out, seconds, run, show)


def _results(
    scene: Scene, bag: Path, out: Path, seconds: float, run: GraphRun, show: Show
) -> dict[str, object]:
    """Write figures and summary of a recorded run and of a session, and return the summary."""
    show("reading the bag", None)
    health = replace(
        health_from_bag(bag),
        interruptions=run.interruptions,
        reduced_gains=run.reduced_gains,
        lockstep=run.lockstep,
    )
    if len(scene.held_points) > 1:
        shared = shared_record_from_bag(bag, scene, duration=seconds)
        users = {name: replace(one, lockstep=run.lockstep) for name, one in shared.users.items()}
        shared = replace(shared, users=users)
        both = run_shared_session(scene, seconds, partial(show, "simulating the same without ROS"))
        show("drawing", None)
        return write_shared_results(shared, scene, out, health, both)
    record = replace(record_from_bag(bag, scene, duration=seconds), lockstep=run.lockstep)
    reference = run_session(scene, seconds, partial(show, "simulating the same without ROS"))
    show("drawing", None)
    return write_results(record, scene, out, health, reference)


@dataclass(frozen=True, slots=True)
class GraphRun:
    """How the run of a graph went.

    Attributes:
        load: of the graph; None if its nodes reported too little.
        interruptions: how often rendering was interrupted and resumed after the hands had started.
        reduced_gains: whether a controller reduced its gains in the run, as the round trip to its
            device took longer than the scene's gains allow.
        lockstep: whether the graph advanced by messages instead of by time.
    """

    load: GraphLoad | None
    interruptions: int
    reduced_gains: bool = False
    lockstep: bool = False

    @property
    def kept(self) -> bool:
        """Whether rendering was not interrupted, and the graph fits the machine at this rate."""
        return not self.interruptions and (self.load is None or self.load.fits)

    @property
    def undisturbed(self) -> bool:
        """Whether the hand felt the scene as modelled: deadlines kept, no break, full gains."""
        in_time = self.load is None or self.load.missed <= MOST_MISSED
        return in_time and not (self.interruptions or self.reduced_gains)

    def reason(self) -> str:
        """Return a clause on what disturbed the run."""
        if self.kept:
            return "the loop took longer than the gains allow, which were reduced"
        if not self.interruptions:
            if self.load is not None and self.load.missed <= MOST_MISSED:
                return "the graph took more than half of the machine"
            return "the machine did not keep the rate"
        times = "once" if self.interruptions == 1 else f"{self.interruptions} times"
        return f"rendering was interrupted {times}"


def _engagements(reports: Mapping[str, Report]) -> int:
    """Return how often controllers engaged in all, or devices were held, whichever is more."""
    counted = ("engagements", "times_held")
    return max(
        sum(int(report.figures.get(name, 0)) for report in reports.values()) for name in counted
    )


def _reduced_gains(reports: Mapping[str, Report], since: float) -> bool:
    """Return whether a controller's gains are those for a longer delay than declared.

    Reports up to ``since``, s of the monotonic clock, do not count: the hands had not started.
    """
    delays = (
        [float(report.figures.get(name, 0.0)) for name in ("softened_for_ms", "designed_delay_ms")]
        for report in reports.values()
        if _time_of(report) > since
    )
    return any(present > declared for present, declared in delays)


def _time_of(report: Report) -> float:
    return float(report.figures.get("monotonic_s", 0.0))


def record_graph(
    scene_name: str,
    bag: Path,
    composed: bool,
    seconds: float,
    storage: str = "mcap",
    show: Show = lambda stage, done: None,
    control_rate: float = 0.0,
    must_fit: bool = False,
) -> GraphRun:
    """Record a graph whose hands start once the recorder receives all topics.

    Args:
        scene_name: shipped scene, or path.
        bag: folder to make.
        composed: whether all nodes are in one process.
        seconds: s, from when the first hand starts.
        storage: mcap or sqlite3.
        show: called with the progress.
        control_rate: Hz; 0: the scene's.
        must_fit: whether to stop once the graph does not fit the machine or is interrupted.

    Returns:
        How the run went; if stopped early, until then, with an incomplete bag.

    Raises:
        DemoError: recording failed: a topic had no messages, or the hand never started.
        NodeDiedError: a node ended by itself.
    """
    # Before the recorder waits for the graph: the first compilation takes longer than its timeout.
    compile_ahead()
    environment = private_environment()
    scene = load_scene(scene_name, control_rate)
    hold = scene.held_points if scene.hands else ()
    command = [sys.executable, "-m", RECORDER, "--out", str(bag), "--scene", scene_name]
    command += ["--duration", str(seconds), "--storage", storage]
    recorder = start_process(command, environment, pipe_output=True)
    parameters: dict[str, object] = {"haptic_device.wait_for_start": True}
    if control_rate:
        parameters["control_rate"] = control_rate
    size = 1.0 / scene.simulation.period, available_cores(), composed, len(hold) or 1
    # The load of starting does not count, unless that takes longer than STARTS_WITHIN_S.
    watch, starting = LoadWatch(*size), LoadWatch(*size, least_span_s=STARTS_WITHIN_S)
    load: GraphLoad | None = None
    engaged, reduced = 0, False
    try:
        # A recorder that gets no processor time sends no events: go on after PATIENCE_S.
        events = events_of(recorder, PATIENCE_S)
        show("starting the recorder", None)
        _expect(events, "ready")
        show("starting the graph", None)
        with Graph(
            scene_name, composed, "", parameters, environment, hold=hold, shown=True
        ) as graph:
            missing, pushing, since = ["the recorder"], False, 0.0
            for event in events:
                graph.check()
                match event["event"]:
                    case "waiting":
                        missing = event["missing"]
                        show(_waiting(missing), None)
                    case "progress":
                        if not pushing:
                            since = max(map(_time_of, graph.reports().values()), default=0.0)
                        pushing = True
                        show("pushing and recording", event["elapsed_s"] / seconds)
                    case "failed":
                        raise DemoError(f"recording failed: {event['reason']}")
                    case "done":
                        broken = _engagements(graph.reports()) - engaged
                        return GraphRun(load, broken, reduced)
                reports = graph.reports()
                if pushing or not missing:
                    load = watch.look(reports)
                    engaged = engaged if pushing else _engagements(reports)
                    broken = _engagements(reports) - engaged
                    reduced = reduced or (pushing and _reduced_gains(reports, since))
                    run = GraphRun(load, broken, reduced)
                else:
                    run = GraphRun(starting.look(reports), 0)
                if must_fit and not run.kept:
                    return run
        raise DemoError(f"{ending('the recorder', recorder)}: {bag} is incomplete")
    finally:
        stop_process(recorder)


def record_in_lockstep(
    scene_name: str,
    bag: Path,
    composed: bool,
    seconds: float,
    storage: str = "mcap",
    show: Show = lambda stage, done: None,
    control_rate: float = 0.0,
) -> GraphRun:
    """Record the experiment in lockstep; return how the run went.

    Arguments as for :func:`record_graph`.

    Raises:
        NodeDiedError: a node ended by itself.
        LockstepError: the graph stalled.
    """
    scene = load_scene(scene_name, control_rate)
    start = min(scene.held_at(point).hand.start_delay for point in scene.held_points)
    run = LockstepRun(
        scene_name,
        control_rate=control_rate,
        duration=start + seconds,
        out=bag,
        storage=storage,
        composed=composed,
        hold=scene.held_points if scene.hands else (),
        shown=True,
    )

    def progress(ticks: int, every: int) -> None:
        show("pushing and recording in lockstep", min(1.0, ticks / every))

    show("starting the graph in lockstep", None)
    run_lockstep(run, private_environment(), lambda: False, progress)
    return GraphRun(None, 0, lockstep=True)


def _waiting(missing: Sequence[str]) -> str:
    """Return the stage to show while topics are missing, or the load is being measured."""
    if not missing:
        return "testing whether this machine keeps up"
    more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
    return f"waiting for {missing[0]}{more}"


def _expect(events: Iterator[dict[str, Any]], name: str) -> None:
    some = (event for event in events if event["event"] != "nothing")
    event = next(some, {"event": "failed", "reason": "the recorder ended at once"})
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
