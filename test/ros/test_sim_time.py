# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that live by /clock: time is what it says, stands when it stands, and goes back with it."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from hapticmech_ros import Mechanism, load_scene
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.state import StateLayout
from ros.harness import RELIABLE, Peer, Statuses, figures, running, scene_like, six, unstamped

# s, after which the hand pushes: each millisecond is a message and its answers.
START_DELAY = 0.1
MS = 1_000_000
STEP_NS = 10 * MS
PERIODS = 10


class TestClock:
    """Publishes /clock step by step, each once the device has answered the one before."""

    __test__ = False

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.now_ns = 0
        self.devices = peer.listen("device/state", Float64MultiArray)
        self.mechanisms = peer.listen("mechanism/state", Float64MultiArray)
        self._publisher = peer.node.create_publisher(Clock, "/clock", RELIABLE)

    def begin(self, time_ns: int, *received: list) -> None:
        """Go on from a time until all that listen say so."""
        self.now_ns = time_ns

        def going() -> bool:
            self.tell(self.now_ns + STEP_NS)
            self.peer.run(0.05)
            return all(received)

        self.peer.until(going, "samples")

    def tell(self, time_ns: int) -> None:
        """Say what time it is."""
        self.now_ns = time_ns
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(time_ns, 1000 * MS)
        self._publisher.publish(message)

    def publish(self, message: Clock | bytes) -> None:
        """Say something else."""
        self._publisher.publish(message)

    def step(self) -> None:
        """Go on by a step and wait for the device's sample."""
        seen = len(self.devices)
        self.tell(self.now_ns + STEP_NS)
        self.peer.until(lambda: len(self.devices) > seen, f"a sample at {self.now_ns}")

    def samples(self, since: int) -> list:
        """Return the device's samples from a number on."""
        return [read(DeviceStateMessage, message.data) for message in self.devices[since:]]


def test_simulated_time_is_the_clocks(domain: int, peer: Peer, statuses: Statuses) -> None:
    clock = TestClock(peer)
    given = {"use_sim_time": True, "hand": "commanded", "diagnostics_period": 0.05}
    given["realtime"] = "on"
    given["control_rate"] = 0.0
    with running("haptic_device,mechanism_simulator", domain, **given):
        push = peer.publisher("device/hand_cf", WrenchStamped)
        clock.begin(1000 * MS, clock.devices, clock.mechanisms)
        started = len(clock.devices)
        for _ in range(30):
            push.publish(unstamped(0.03, *[0.0] * 5))
            clock.step()
        # Nothing is asked for: it has what this process has.
        nice = os.getpriority(os.PRIO_PROCESS, 0)
        told = "SCHED_OTHER" + (f", nice {nice}" if nice else "")
        assert figures(statuses["haptic_device"])["scheduling"] == told
        # The push has run out, by the clock: the device coasts.
        for _ in range(40):
            clock.step()
        coasting = clock.samples(-10)
        stamps = [sample.stamp_ns for sample in clock.samples(started)]
        assert stamps == list(range(stamps[0], clock.now_ns + 1, STEP_NS))
        assert coasting[0].sample.twist[0] > 0.005
        for before, after in itertools.pairwise(coasting):
            way = after.sample.position - before.sample.position
            expected = before.sample.twist[:3] * STEP_NS / (1000 * MS)
            # Sums of ten steps of floating point.
            assert np.abs(way - expected).max() < 1e-12
        # The mechanism's grid is half a period later, so that its last deadline is half before.
        layout = StateLayout(Mechanism(load_scene("five_bar")))
        peer.until(
            lambda: layout.unpack(clock.mechanisms[-1].data).stamp_ns == clock.now_ns - MS // 2,
            "the mechanism's sample",
        )
        # All of a step's periods count, from the first sample (which had one or more) on.
        whole = (clock.now_ns - read(DeviceStateMessage, clock.devices[0].data).stamp_ns) // MS
        peer.until(
            lambda: 0 < int(figures(statuses["haptic_device"])["periods"]) - whole <= PERIODS,
            f"{whole} periods",
        )
        assert figures(statuses["haptic_device"])["dropped_periods"] == "0"

        # A standing clock: nothing moves, whether it is silent or says the same again.
        seen = len(clock.devices), len(clock.mechanisms)
        for _ in range(10):
            clock.tell(clock.now_ns)
            peer.run(0.03)
        assert (len(clock.devices), len(clock.mechanisms)) == seen


class Loop:
    """The whole graph by /clock, in one process, with the force that leaves its device."""

    def __init__(self, peer: Peer) -> None:
        self.peer = peer
        self.clock = TestClock(peer)
        self.statuses = peer.statuses()

    def run(self, steps: int) -> float:
        """Go on so many periods, each once the device has answered; return the largest force, N."""
        first = len(self.clock.devices)
        for _ in range(steps):
            seen = len(self.clock.devices)
            self.clock.tell(self.clock.now_ns + MS)
            self.peer.until(lambda before=seen: len(self.clock.devices) > before, "a sample")
            # Controller and mechanism answer in between.
            self.peer.run(0.0005)
        return max(self._forces(first), default=0.0)

    def pushing(self) -> bool:
        """Go on a period, and return whether the actuators push by now."""
        self.run(1)
        return self._forces(-1)[0] > 0.0

    def _forces(self, since: int) -> list[float]:
        samples = self.clock.samples(since)
        return [float(np.linalg.norm(sample.applied[:3])) for sample in samples]


@pytest.fixture
def soon(tmp_path: Path) -> str:
    """A scene whose hand does not wait for long."""
    return scene_like(tmp_path, "five_bar", f"hand.start_delay={START_DELAY}")


@contextmanager
def pushing(domain: int, peer: Peer, scene: str) -> Iterator[tuple[Loop, Popen[str]]]:
    """Run the graph until it pushes; yield it, and its process."""
    given = {"use_sim_time": True, "diagnostics_period": 0.05, "control_rate": 0.0}
    with running(",".join(NODES), domain, scene, **given) as process:
        loop = Loop(peer)
        loop.clock.begin(100_000 * MS, loop.clock.devices, loop.clock.mechanisms)
        peer.until(loop.pushing, "the push")
        yield loop, process


@pytest.mark.parametrize("step_s", [-8.0, 8.0])
def test_a_clock_that_is_set_puts_the_hand_at_zero_and_the_loop_begins_anew(
    domain: int, peer: Peer, soon: str, step_s: float
) -> None:
    with pushing(domain, peer, soon) as (loop, _):
        usual = loop.run(300)
        assert usual > 0.1
        seen = len(loop.clock.devices)
        loop.clock.tell(loop.clock.now_ns + round(step_s * 1000) * MS)
        peer.until(lambda: len(loop.clock.devices) > seen, "what the device says of it")
        # From where it was noticed, without waiting for a sample.
        assert not loop.clock.samples(seen)[0].applied.any()
        begun_ns = loop.clock.now_ns
        for name in ("haptic_device", "teleoperation_controller", "nullspace_analyser"):
            peer.until(
                lambda node=name: "clock set" in figures(loop.statuses[node])["last_clock_step"],
                f"what {name} says of it",
            )
        peer.until(loop.pushing, "the push after it")
        assert loop.run(300) <= 1.2 * usual
        stamps = [sample.stamp_ns for sample in loop.clock.samples(seen)]
        assert stamps == sorted(stamps)
        # What goes back leaves nothing that is ahead of it.
        assert step_s > 0.0 or begun_ns <= stamps[0] < stamps[-1] == loop.clock.now_ns


@pytest.mark.parametrize(("seconds", "nanoseconds"), [(-1, 0), (2**31 - 1, 2**32 - 1)])
def test_time_that_no_stamp_can_hold_ends_nobody(
    domain: int, peer: Peer, soon: str, seconds: int, nanoseconds: int
) -> None:
    """The last is a time, though one that no stamp can tell."""
    with pushing(domain, peer, soon) as (loop, process):
        before = loop.clock.now_ns
        wrong = Clock()
        wrong.clock.sec, wrong.clock.nanosec = seconds, nanoseconds
        for _ in range(20):
            loop.clock.publish(wrong)
            peer.run(0.02)
        assert process.poll() is None
        if seconds < 0:
            # As if nothing had been said.
            peer.until(
                lambda: all(
                    "/clock" in figures(loop.statuses[node])["last_refusal"] for node in NODES
                ),
                "that it was refused",
            )
            assert loop.run(100) > 0.1
        else:
            assert not loop.clock.samples(-1)[0].applied.any()
        # What it says now is taken, and the graph renders.
        loop.clock.begin(before + STEP_NS, loop.clock.devices)
        peer.until(loop.pushing, "the push after it")
        assert process.poll() is None


def test_an_emergency_stop_needs_no_clock_that_goes_on(domain: int, peer: Peer) -> None:
    setpoints = peer.listen("device/setpoint_cf", WrenchStamped)
    with running("haptic_device", domain, use_sim_time=True, hand="commanded", control_rate=0.0):
        clock = TestClock(peer)
        push = peer.publisher("device/servo_cf", WrenchStamped)
        clock.begin(1000 * MS, clock.devices)

        def pushed() -> bool:
            push.publish(unstamped(0.0, 0.02, *[0.0] * 4))
            peer.run(0.01)
            clock.step()
            return bool(clock.samples(-1)[0].applied.any())

        peer.until(pushed, "the push")
        setpoints.clear()
        assert peer.call(SetBool, "device/emergency_stop", SetBool.Request(data=True)).success
        peer.until(lambda: setpoints, "the zero, while the clock stands still")
        assert not any(six(setpoints[-1]))
        assert not clock.samples(-1)[0].applied.any()
