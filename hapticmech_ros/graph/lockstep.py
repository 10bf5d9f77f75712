# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A graph that advances by messages and /clock instead of by time: repeatable to the bit.

It runs as fast as the machine can, or at a given rate, with results equal to those of
:class:`~hapticmech_ros.session.Session`.

Selective replay: inputs from a bag are fed into a live graph in lockstep. The outputs are recorded,
and can be compared with those in the bag.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

from hapticmech_ros.bag.reader import BagReader, refuse_former_topics
from hapticmech_ros.errors import BagError, HapticMechError, InvalidInputError
from hapticmech_ros.graph.processes import Graph, events_of, start_process, stop_process
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.system.readiness import Report
from hapticmech_ros.wire.topics import DEVICE_STATE, DIAGNOSTICS, check_feeds, users_of


def replay(
    run: LockstepRun,
    environment: Mapping[str, str],
    asked_to_stop: Callable[[], bool],
    progress: Callable[[int, int], None] = lambda ticks, every: None,
    ended: Callable[[Reports, Reports], object] = lambda reports, endings: None,
) -> int:
    """Run a replay; return the number of ticks.

    An empty scene stands for the recorded one, an empty namespace for that of the recorded device.
    Arguments as for :func:`run_lockstep`.

    Raises:
        BagError: there is no bag, it has no device or scene, or topics under former names, or its
            scene has several hands.
        LockstepError: the graph did not run to the end.
    """
    if run.feed_from is None:
        raise BagError("a replay needs a bag")
    with BagReader(run.feed_from) as bag:
        refuse_former_topics(bag)
        scene = run.scene or _scene(bag)
        held = load_scene(scene).held_points
        if len(held) > 1:
            rule = f"its scene has the hands {', '.join(held)}, and a replay feeds one alone"
            raise BagError(f"bag {bag.path}: {rule}")
        namespace = run.namespace or _namespace(bag)
    found = replace(run, scene=scene, namespace=namespace)
    return run_lockstep(found, environment, asked_to_stop, progress, ended)


def _namespace(bag: BagReader) -> str:
    """Return the namespace of the one device in a bag."""
    tail = f"/{DEVICE_STATE.name}"
    devices = [name.removesuffix(tail) for name in bag.topics if name.endswith(tail)]
    if len(devices) != 1:
        rule = f"a replay needs one device (found {len(devices)}); name it by --namespace"
        raise BagError(f"bag {bag.path}: {rule}")
    return devices[0].strip("/")


def _scene(bag: BagReader) -> str:
    """Return the scene recorded in the nodes' diagnostics."""
    if DIAGNOSTICS.name in bag.topics:
        for item in bag.messages(DIAGNOSTICS.name):
            for status in item.message.status:
                if status.hardware_id:
                    return _found(str(status.hardware_id), bag.path)
    raise BagError(f"bag {bag.path}: does not say which scene was run; name it by --scene")


def _found(scene: str, bag: Path) -> str:
    if scene.endswith((".yaml", ".yml")) and not Path(scene).is_file():
        raise BagError(f"bag {bag}: was recorded of {scene}, which is not here; give --scene")
    return scene


CLOCK = "hapticmech_ros.nodes.lockstep_clock"
Reports = Mapping[str, Report]


class LockstepError(HapticMechError):
    """A run in lockstep that did not come to its end."""


@dataclass(frozen=True, slots=True)
class LockstepRun:
    """Settings of a run in lockstep.

    Attributes:
        scene: shipped scene, or path of a file.
        control_rate: Hz; 0: the scene's.
        duration: simulated time, s; 0: until stopped, or until the end of the inputs fed.
        rate: at most this multiple of real time; 0: as fast as the machine can.
        out: bag to record, or None.
        storage: mcap or sqlite3.
        feed_from, feed: bag whose inputs are fed, and which of them: ``hand`` (wrenches on the
            device), ``device`` (samples of the device, whose node is then left out), ``external``
            (wrenches on the mechanism's operational points).
        stall_timeout: longest time without a message, s, the nodes' start and discovery included.
        composed, namespace, hold, parameters, arguments, shown: as for :class:`Graph`.
    """

    scene: str
    control_rate: float = 0.0
    duration: float = 0.0
    rate: float = 0.0
    out: Path | None = None
    storage: str = "mcap"
    feed_from: Path | None = None
    feed: tuple[str, ...] = ()
    stall_timeout: float = 30.0
    composed: bool = False
    namespace: str = ""
    hold: tuple[str, ...] = ()
    parameters: Mapping[str, object] = field(default_factory=dict)
    arguments: tuple[str, ...] = ()
    shown: bool = False


def run_lockstep(
    run: LockstepRun,
    environment: Mapping[str, str],
    asked_to_stop: Callable[[], bool],
    progress: Callable[[int, int], None] = lambda ticks, every: None,
    ended: Callable[[Reports, Reports], object] = lambda reports, endings: None,
) -> int:
    """Run to the end, or until stopped; return the number of ticks.

    Args:
        run: the settings.
        environment: of the processes.
        asked_to_stop: returns whether to stop; called with each event of the clock.
        progress: called with the number of ticks so far, and of all; 0 if it runs until stopped.
        ended: called with the nodes' last reports and their final ones, by name.

    Raises:
        SceneError: the scene does not exist, or is not valid.
        InvalidInputError: an unknown feed, feeds that exclude each other, a feed without a bag or
            with several hands, or a control rate among the nodes' parameters.
        NodeDiedError: a node ended by itself.
        LockstepError: the graph stalled, or the clock ended without a result.
    """
    load_scene(run.scene, run.control_rate)
    _check(run)
    nodes = [name for name in NODES if "device" not in run.feed or name != "haptic_device"]
    graph = Graph(
        run.scene,
        run.composed,
        run.namespace,
        {**run.parameters, **_parameters(run)},
        environment,
        nodes,
        run.hold,
        run.arguments,
        shown=run.shown,
    )
    with ExitStack() as ends:
        ends.callback(lambda: ended(graph.reports(), graph.endings()))
        ends.enter_context(graph)
        clock = start_process(_clock_command(run), environment, pipe_output=True)
        try:
            for event in events_of(clock):
                if event["event"] == "done":
                    return int(event["ticks"])
                graph.check()
                graph.reports()  # makes room for those that follow
                if event["event"] == "progress":
                    progress(int(event["ticks"]), int(event["every"]))
                if event["event"] == "failed":
                    raise LockstepError(f"lockstep: {event['reason']}")
                if asked_to_stop():
                    clock.terminate()
            raise LockstepError("lockstep: the clock's process ended without a result")
        finally:
            stop_process(clock)


def _check(run: LockstepRun) -> None:
    if "control_rate" in run.parameters:
        rule = "is the run's, not a parameter of nodes: the clock needs it too (--control-rate)"
        raise InvalidInputError("control_rate", run.parameters["control_rate"], rule)
    check_feeds(run.feed)
    if {"hand", "device"} <= set(run.feed):
        rule = "feed hand or device, not both: samples of a device contain its hand"
        raise InvalidInputError("feed", run.feed, rule)
    if bool(run.feed) != (run.feed_from is not None):
        raise InvalidInputError(
            "feed", run.feed, "a bag and inputs to feed from it must both be given"
        )
    if run.feed and len(run.hold) > 1:
        raise InvalidInputError("hold", run.hold, "only one point can be held while inputs are fed")


def _parameters(run: LockstepRun) -> dict[str, object]:
    parameters: dict[str, object] = {"use_sim_time": True, "lockstep": True}
    if run.control_rate:
        parameters["control_rate"] = run.control_rate
    if "hand" in run.feed:
        parameters["haptic_device.hand"] = "commanded"
    if "external" in run.feed:
        parameters["mechanism_simulator.require_external_wrench"] = True
    return parameters


def _clock_command(run: LockstepRun) -> Sequence[str]:
    command = [sys.executable, "-m", CLOCK, "--scene", run.scene]
    command += ["--control-rate", str(run.control_rate)]
    command += ["--duration", str(run.duration), "--rate", str(run.rate)]
    command += ["--stall-timeout", str(run.stall_timeout)]
    if run.out is not None:
        command += ["--out", str(run.out), "--storage", run.storage]
    for namespace, point in users_of(run.hold):
        command += ["--hold", f"{namespace}/{point}" if namespace else point]
    if run.feed_from is not None:
        command += ["--feed-from", str(run.feed_from)]
        command += [option for kind in run.feed for option in ("--feed", kind)]
    if run.namespace:
        command += ["--ros-args", "-r", f"__ns:=/{run.namespace.strip('/')}"]
    return command
