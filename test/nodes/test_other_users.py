# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What corrects a device's commands for another hand: from one publisher each, and of now."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.reliability.fake_graph import ACTORS, FakeGraph
from benchmarks.reliability.outputs import applied_in
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes.haptic_device import HapticDevice
from hapticmech_ros.nodes.local_loop import FRESH_NS
from hapticmech_ros.wire.cdr import FlatArray, decode
from hapticmech_ros.wire.layouts import CouplingMatrices, CouplingWire
from hapticmech_ros.wire.messages import DeviceStateMessage, LocalFeedbackGain
from hapticmech_ros.wire.wrench import encode_wrench
from ros.harness import scene_like

SECOND_NS = 1_000_000_000
COMMANDS, FEEDBACK = "/left/device/servo_cf", "/left/device/local_feedback_gain"
OWN, OTHER, GAIN = "/left/device/state", "/right/device/state", "/left/device/coupling_gain"
# H along x; the other hand's force grows by so much in a period, N. A command answers the sample
# before the newest one, and is corrected from a period before that sample on, to the middle of its
# own. It rises by a line.
H, RISE = 2.0, 1e-3
CORRECTION = 2.5 * H * RISE
CLOSE = 1e-9


class Left:
    """Left's device, and all that it hears: commands of zero, their gains, and right's hand."""

    def __init__(self, scene: str, **parameters: object) -> None:
        given = {"operational_point": "left", "hand": "still"} | parameters
        self.graph = FakeGraph(
            scene, actors=[HapticDevice], parameters={"haptic_device": given}, namespace="/left"
        )
        self.host = self.graph.hosts["haptic_device"]
        self.wire = CouplingWire(["right"], load_scene(scene).limits)
        self.force = 0.0

    def other(self, stamp_ns: int, force: float) -> bytes:
        """Return right's sample in bytes."""
        at_rest = np.zeros(3), (0.0, 0.0, 0.0, 1.0), np.zeros(6)
        sample = np.concatenate((*at_rest, (force, 0.0, 0.0, 0.0, 0.0, 0.0)))
        told = DeviceStateMessage.of(stamp_ns, sample=sample)
        return bytes(FlatArray(DeviceStateMessage.layout).encode(told.values))

    def gain(self, stamp_ns: int, gain: float = H) -> bytes:
        """Return a ``coupling_gain`` in bytes."""
        told = CouplingMatrices(stamp_ns, {"right": np.diag([gain, 0.0, 0.0, 0.0, 0.0, 0.0])})
        return self.wire.encode(told)

    def tick(self, *silent: str) -> None:
        """Let a period go by, and all but some topics be spoken on."""
        self.graph.run(1e-3)
        self.speak(*silent)

    def speak(self, *silent: str) -> None:
        """Answer the sample of now, on all but some topics."""
        now = self.graph.now_ns
        self.force += RISE
        told = LocalFeedbackGain.answering(now, now, 0.0, np.zeros(108))
        for topic, message in (
            (COMMANDS, encode_wrench(np.zeros(6), now)),
            (FEEDBACK, bytes(FlatArray(LocalFeedbackGain.layout).encode(told.values))),
            (GAIN, self.gain(now)),
            (OTHER, self.other(now, self.force)),
        ):
            if topic not in silent:
                self.graph.put(topic, message)

    def run(self, ticks: int, *silent: str) -> np.ndarray:
        """Return what the actuators gave along x in so many periods, N."""
        found = []
        for _ in range(ticks):
            self.tick(*silent)
            found.append(self.applied[0])
        return np.array(found)

    def intrude(self, topic: str, message: bytes) -> None:
        """Bring a message of somebody who is in none of the graph's processes."""
        self.graph.put(topic, message, 7)

    @property
    def applied(self) -> np.ndarray:
        """What the actuators give (6,), N and N m."""
        return applied_in(self.graph.last[OWN])

    @property
    def figures(self) -> dict[str, str]:
        """Of diagnostics."""
        return self.host.actor.status()[2]

    def counts(self) -> tuple[int, int]:
        """Return how many commands were corrected, and how many not."""
        found = self.figures
        return int(found["corrected_for_others"]), int(found["uncorrected_for_others"])


@pytest.fixture
def scene(tmp_path: Path) -> str:
    """Without passivity control: the mechanism's account is made up here."""
    return scene_like(tmp_path, "two_users", "controller.passivity.control=false")


@pytest.fixture
def left(scene: str) -> Left:
    found = Left(scene)
    # Longer than limits take to come in.
    found.run(1500)
    assert found.applied[0] == pytest.approx(CORRECTION, rel=CLOSE)
    return found


def test_diagnostics_count_what_was_corrected_and_what_was_not(left: Left) -> None:
    corrected, not_corrected = left.counts()
    left.run(200)
    assert left.counts() == (corrected + 200, not_corrected)
    # From when what was said last is too old, which is a while after.
    left.run(200, OTHER)
    silent = left.counts()
    assert sum(silent) == corrected + not_corrected + 400
    assert silent[1] - not_corrected > 180
    left.run(200)
    fresh_ticks = FRESH_NS // 1_000_000
    before = left.counts()
    found = left.run(200 + fresh_ticks, GAIN)
    assert left.counts() == (before[0] + fresh_ticks, before[1] + 200)
    assert not found[-190:].any()
    # Where nobody holds, there is nothing to correct for.
    left.graph.put(GAIN, left.gain(left.graph.now_ns, 0.0))
    before = left.counts()
    left.run(50, GAIN)
    assert left.counts() == before


def test_there_is_nothing_to_count_where_there_are_no_other_users() -> None:
    graph = FakeGraph("five_bar", actors=ACTORS[:4])
    graph.run(0.2)
    for name in ("haptic_device", "teleoperation_controller"):
        figures = graph.hosts[name].actor.status()[2]
        assert not [key for key in figures if "others" in key or "coupling" in key]


@pytest.mark.parametrize("topic", [GAIN, OTHER])
def test_of_two_publishers_neither_corrects_and_rendering_goes_on(left: Left, topic: str) -> None:
    held, before = left.figures["times_held"], left.counts()

    def said() -> bytes:
        now = left.graph.now_ns
        return left.gain(now, 50.0) if topic == GAIN else left.other(now, 30.0)

    left.intrude(topic, said())
    # What acts in this period was commanded already.
    for number in range(100):
        left.tick()
        assert left.applied[0] == 0.0, number
        if number % 7 == 0:
            left.intrude(topic, said())
    well, sentence, figures = left.host.actor.status()
    assert not well
    assert figures["coupling_fault"].startswith(f"more than one publisher of {topic}: ")
    assert sentence == f"rendering, not corrected for other hands: {figures['coupling_fault']}"
    assert (figures["fault"], figures["times_held"]) == ("", held)
    assert left.counts() == (before[0], before[1] + 100)
    warnings = [text for level, text in left.host.log.lines if level == "warning"]
    assert [text for text in warnings if topic in text] == [
        f"{figures['coupling_fault']}: no correction for other hands"
    ]
    # Once the second has been silent for a second.
    assert not left.run(900).any()
    left.run(200)
    assert left.applied[0] == pytest.approx(CORRECTION, rel=CLOSE)
    assert left.host.actor.status()[0]
    assert left.figures["coupling_fault"] == ""
    assert left.figures["times_held"] == held


@pytest.mark.parametrize("topic", [GAIN, OTHER])
@pytest.mark.parametrize("apart_s", [-10, 10])
def test_what_is_of_another_time_is_refused(left: Left, topic: str, apart_s: int) -> None:
    host, stamp_ns = left.host, left.graph.now_ns + apart_s * SECOND_NS
    refused, counts = host.refused, left.counts()
    message = left.gain(stamp_ns, 50.0) if topic == GAIN else left.other(stamp_ns, 30.0)
    left.graph.put(topic, message)
    assert host.refused == refused + 1
    assert topic.removeprefix("/left/") in host.last_refusal
    assert "age of stamp, s: must be within 0.25 s of this node's clock" in host.last_refusal
    # It takes no part, and holds up nothing that comes after it.
    assert left.run(50) == pytest.approx(CORRECTION, rel=CLOSE)
    assert left.counts() == (counts[0] + 50, counts[1])


def test_a_device_that_begins_anew_knows_nothing_of_others_nor_who_spoke(left: Left) -> None:
    left.intrude(OTHER, left.other(left.graph.now_ns, 30.0))
    left.intrude(GAIN, left.gain(left.graph.now_ns))
    assert left.figures["coupling_fault"]
    left.host.begin_anew()
    assert left.figures["coupling_fault"] == ""
    assert left.counts() == (0, 0)
    left.run(50, GAIN)
    assert left.counts()[0] == 0


def test_in_lockstep_none_of_it_holds(scene: str) -> None:
    """What is waited for there is taken as it comes, whoever says it and whatever its stamp."""
    left = Left(scene, lockstep=True)
    ticks = 300
    left.speak()
    for _ in range(2):
        for _ in range(ticks):
            left.tick()
        left.intrude(OTHER, left.other(left.graph.now_ns, left.force))
        left.intrude(GAIN, left.gain(left.graph.now_ns + 10 * SECOND_NS))
    assert left.host.refused == 0
    assert left.figures["coupling_fault"] == ""
    corrected, not_corrected = left.counts()
    assert corrected > 2 * ticks - 5
    assert not_corrected == 0


def test_of_two_analysers_nothing_is_told_of_others_and_rendering_goes_on() -> None:
    points = {"operational_point": "left"}
    given = {kind.name: points for kind in ACTORS[:4]}
    graph = FakeGraph("two_users", actors=ACTORS[:4], parameters=given, namespace="/left")
    controller = graph.hosts["teleoperation_controller"]
    topic = "/left/analysis/left/transmission"

    def coupled(seconds: float, second: bool = False) -> np.ndarray:
        """Return H of each message in a while in which right's controller commands zero."""
        found: list[np.ndarray] = []
        last = graph.last.get(GAIN)
        for number in range(round(1000 * seconds)):
            if second and number % 7 == 0:
                graph.put(topic, graph.last[topic], 7)
            graph.run(1e-3)
            command = encode_wrench(np.zeros(6), graph.now_ns)
            graph.put("/left/mechanism/right/servo_cf", command)
            if graph.last.get(GAIN) is not last:
                last = graph.last[GAIN]
                found.append(decode(last)[2:])
        return np.array(found)

    coupled(0.5)
    assert coupled(0.1).any(axis=1).all()
    assert controller.actor.status()[:2] == (True, "engaged")
    engagements = controller.actor.engagements
    assert not coupled(0.3, second=True).any()
    well, sentence, figures = controller.actor.status()
    assert not well
    assert figures["coupling_fault"].startswith(f"more than one publisher of {topic}: ")
    assert sentence == f"engaged, publishes no coupling gain: {figures['coupling_fault']}"
    assert figures["fault"] == ""
    coupled(1.1)
    assert coupled(0.1).any(axis=1).all()
    assert controller.actor.status()[:2] == (True, "engaged")
    assert controller.actor.engagements == engagements
