# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages that nobody should send, at every topic that a node hears: in process, and on the wire.

In process all actors share a thread and a made-up time, so that a million messages take minutes and
every message that leaves is looked at. On the wire the same messages go through the middleware to
real processes, as bytes.
"""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from benchmarks.reliability.fake_graph import FakeGraph
from benchmarks.reliability.figure import Figure, figures_of
from benchmarks.reliability.hostile import Hostile
from benchmarks.reliability.memory_growth import MemoryGrowth, worst_growth
from benchmarks.reliability.usage import resident
from benchmarks.reliability.wire_messages import run_wire
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import Scene
from hapticmech_ros.wire.topics import OPERATIONAL_POINT, SET_OPERATIONAL_POINT

# Scenes by turns: plane with a loop, and in space with contacts.
SCENES = ("five_bar", "peg_in_hole", "spatial_arm")
# In process; on the wire on all topics; and on those without an owner.
COUNTS, QUICK_COUNTS = (1_000_000, 100_000, 20_000), (20_000, 2_000, 1_000)
# Between two halves of a period; and in a row before the graph is looked at again.
AT_ONCE, BURST = 8, 5_000
SETTLED_S, LOOK_S = 3.0, 0.5
HANG_S = 5.0
SEED = 20260


def run(quick: bool, out: Path) -> list[Figure]:
    """Send them all; examples of what went wrong are written to ``out``."""
    count, wire, free = QUICK_COUNTS if quick else COUNTS
    out.mkdir(parents=True, exist_ok=True)
    return [*run_in_process(count, out), *run_wire(wire, out), *run_wire(free, out, free=True)]


def run_in_process(count: int, out: Path, scenes: Sequence[str] = SCENES) -> list[Figure]:
    """Send so many messages to actors in this process, a share for each scene."""
    trials = [Trial(scene, seed) for seed, scene in enumerate(scenes, SEED)]
    for trial in trials:
        trial.send(-(-count // len(trials)))
    told = "\n".join(line for trial in trials for line in trial.lines())
    (out / "messages_in_process.txt").write_text(told, "utf-8")
    sent = sum(trial.sent for trial in trials)

    figure = figures_of("in process", sent)
    return [
        figure("messages", sent, least=count),
        figure("exceptions that escaped", sum(trial.escaped for trial in trials), most=0.0),
        figure("defects that were survived", sum(trial.defects() for trial in trials), most=0.0),
        figure("outputs not finite", sum(one.graph.seen.not_finite for one in trials), most=0.0),
        figure(
            "samples beyond the force limit", sum(t.graph.seen.beyond for t in trials), most=0.0
        ),
        figure("longest callback or tick", max(t.longest_s for t in trials), "s", most=HANG_S),
        figure("looks at a graph that had not come back", sum(t.lost for t in trials), most=0.0),
        figure("looks", sum(trial.looks for trial in trials)),
        worst_growth("in process", [trial.memory for trial in trials], sent),
    ]


class Trial:
    """One scene's graph under fire.

    Attributes:
        sent: hostile messages.
        escaped: exceptions that would have ended a process.
        looks, lost: how often the graph was looked at after a burst, and had not come back.
        longest_s: the longest that a message, or half a period of all actors, took.
        memory: of this process.
    """

    def __init__(self, scene: str, seed: int) -> None:
        self.scene = load_scene(scene)
        self._held, self._expiring = pushing(self.scene)
        self.graph = FakeGraph(scene, [*self._held, *self._expiring])
        points = [point.name for point in self.scene.operational_points]
        links = (link.name for link in self.scene.links)
        worlds = (f"{name}_world" for name in (*points, "device"))
        frames = [*points, *links, *worlds, "device"]
        self._hostile = Hostile(seed, frames)
        self.sent = self.escaped = self.looks = self.lost = 0
        self.longest_s = 0.0
        self.memory = MemoryGrowth()
        self._examples: list[str] = []
        self.graph.run(SETTLED_S)
        # Where points are at the start, by the topics that move them.
        self._homes = {
            f"/{SET_OPERATIONAL_POINT.of(point.name)}": serialize_message(
                self.graph.last[f"/{OPERATIONAL_POINT.of(point.name)}"]
            )
            for point in self.scene.operational_points
        }
        self._samples = self._wholes()

    def send(self, count: int) -> None:
        """Send so many, with the graph's own messages between them."""
        topics = self.graph.listened()
        while self.sent < count:
            for _ in range(min(BURST, count - self.sent) // AT_ONCE + 1):
                for _ in range(AT_ONCE):
                    self._put(*topics[self._hostile.index(len(topics))])
                self._timed(self.graph.tick)
                if self.memory.due(self.sent, count):
                    gc.collect()
                    self.memory.add(self.sent, resident(os.getpid()))
            self._look()

    def defects(self) -> int:
        """Return how many errors nobody had predicted."""
        return sum(host.actor.failures.defects for host in self.graph.hosts.values())

    def lines(self) -> list[str]:
        """Return what there is to read."""
        seen = self.graph.seen
        told = [f"{self.scene.name}: {self.sent} sent, {seen.messages} outputs", *seen.examples]
        for host in self.graph.hosts.values():
            failures = host.actor.failures
            told.append(
                f"  {host.name}: refused {host.refused} (last: {host.last_refusal[:200]}), "
                f"failures {failures.count}, defects {failures.defects}, last {failures.last}"
            )
            told += [f"    {level}: {text}" for level, text in host.log.lines if level == "fatal"]
            faults = sorted({text for level, text in host.log.lines if level == "error"})
            told += [f"    {text[:300]}" for text in faults[:40]]
        return told + [f"  {example}" for example in self._examples[:20]]

    def _put(self, topic: str, kind: Any) -> None:
        message = self._hostile.message(kind, self._samples.get(topic, b""), self.graph.now_ns)
        self._timed(lambda: self.graph.put(topic, message))
        self.sent += 1

    def _timed(self, call: Callable[[], object]) -> None:
        before = time.monotonic()
        try:
            call()
        except Exception as error:  # noqa: BLE001 - counted: in a node it would end the process
            self.escaped += 1
            self._examples.append(f"escaped: {error!r}")
        self.longest_s = max(self.longest_s, time.monotonic() - before)

    def _run(self, seconds: float) -> None:
        """Let time go on, as the graph's ``run`` does."""
        for _ in range(round(2e9 * seconds / self.graph.period_ns)):
            self._timed(self.graph.tick)

    def _look(self) -> None:
        """Let everyone else be silent, put the world back, and see whether the graph renders."""
        graph = self.graph
        zero = serialize_message(WrenchStamped(header=Header(frame_id="world")))
        for topic in (*self._held, *self._expiring):
            self._timed(partial(graph.put, topic, zero))
        for topic, message in self._homes.items():
            self._timed(partial(graph.put, topic, message))
        self._run(SETTLED_S)
        answers = []
        controller, device = graph.actor("teleoperation_controller"), graph.actor("haptic_device")
        for _ in range(5):
            self._run(LOOK_S / 5)
            answers.append(controller.status()[0] and device.status()[0])
        self.looks += 1
        if not all(answers) or not all(host.active for host in graph.hosts.values()):
            self.lost += 1
            told = {name: host.actor.status()[1] for name, host in graph.hosts.items()}
            self._examples.append(f"not back after {self.sent}: {told}")

    def _wholes(self) -> dict[str, bytes]:
        """Return a whole message for every topic that is heard."""
        found: dict[str, bytes] = {}
        for topic, kind in self.graph.listened():
            last = self._homes.get(topic) or self.graph.last.get(topic)
            last = kind() if last is None else last
            found[topic] = last if isinstance(last, bytes) else serialize_message(last)
        return found


def pushing(scene: Scene) -> tuple[list[str], list[str]]:
    """Return the topics of wrenches: persistent ones first, those that expire second."""
    points = (point.name for point in scene.operational_points)
    bodies = (*points, *(link.name for link in scene.links))
    names = ["/device/hand_cf", *(f"/mechanism/{body}/external_cf" for body in bodies)]
    return [f"{name}/persistent" for name in names], [f"{name}/somebody" for name in names]
