# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that handle plain messages: the same as Python does, and nothing that is not plain."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.reliability.fake_graph import Host
from hapticmech_ros.mechanism.grasp import flat_grasps
from hapticmech_ros.nodes import analysis_kernels
from hapticmech_ros.nodes import exchange as exchange_module
from hapticmech_ros.nodes import lane as lane_module
from hapticmech_ros.nodes.exchange import Exchange
from hapticmech_ros.nodes.lane import Lane
from hapticmech_ros.nodes.mechanism_simulator import MechanismSimulator
from hapticmech_ros.nodes.nullspace_analyser import NullspaceAnalyser
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.wire import kernels
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import OPERATIONAL_MODEL_FIELDS
from hapticmech_ros.wire.state import StateLayout, WireState
from hapticmech_ros.wire.wrench import encode_wrench

STATES, MODELS = "/mechanism/state Float64MultiArray", "/analysis/handle/operational_model {}"
MODELS = MODELS.format("Float64MultiArray")
COMMANDS = "/mechanism/handle/servo_cf WrenchStamped"
MS = 1_000_000


class LaneHost(Host):
    """Hosts one actor by the machine's clock, on a lane; outside nobody listens."""

    def lane_kind(self, message_type: Any) -> str:
        return message_type.__name__

    def now_ns(self) -> int:
        return time.time_ns()

    def create_publisher(self, kind: Any, name: str, qos: Any) -> Any:
        topic = self.resolve_topic_name(name)
        heard = topic in (STATES.split()[0], MODELS.split()[0])
        return SimpleNamespace(
            topic_name=topic,
            publish=lambda message: None,
            get_subscription_count=lambda: int(heard),
        )


class Process:
    """An actor's process, and a peer who speaks to it and hears it.

    Args:
        kind: of the actor.
        scene: its scene.
        folder: of the lane.
        heard: topic that the peer hears.
        spoken: topic that it speaks on.
    """

    def __init__(self, kind: Any, scene: str, folder: Path, heard: str, spoken: str) -> None:
        self.exchange = Exchange()
        self.exchange.lane = Lane(folder)
        graph = SimpleNamespace(
            exchange=self.exchange, namespace="", now_ns=0, pushing=(), within={}
        )
        self.host = host = LaneHost(graph, kind.name)
        host.hand_over = (  # type: ignore[method-assign]
            lambda topic, kind, listener: self.exchange.listen(topic, listener, kind.__name__)
        )
        self.exchange.nodes.append(host)
        self.subscriptions: list[Any] = []
        host.create_subscription = (  # type: ignore[method-assign]
            lambda kind, name, callback, qos, raw=False: SimpleNamespace(
                get_publisher_count=lambda: 0
            )
        )
        host.actor = self.actor = kind(host, kind.parameters_type(scene=scene))
        self.peer, self.got, self._spoken = Lane(folder), [], spoken
        self.peer.listen(heard, lambda message, origin: self.got.append(message))
        host.begin()
        self.wait = self.exchange.lane.wait
        self.meet()

    def meet(self) -> None:
        """Let both find each other."""
        end = time.monotonic() + 5.0
        lane = self.exchange.lane
        while not (lane.readers(self.heard) and self.peer.readers(self._spoken)):
            assert time.monotonic() < end
            for one in (lane, self.peer):
                one._looked_ns = -lane_module.LOOK_NS
                one.look()
                one.collect()

    @property
    def heard(self) -> str:
        """The topic that the peer hears."""
        return next(iter(self.peer._heard))

    def settle(self, send: Callable[[], None]) -> None:
        """Send until a kernel does the work: both ways are used for a while at first."""
        lane, end = self.exchange.lane, time.monotonic() + 20.0
        while not lane.worked:
            assert time.monotonic() < end
            send()
            self.go(2 * MS)

    def until(self, happened: Callable[[], bool]) -> list[bytes]:
        """Go on until something has happened, and return what the peer has got by then."""
        end, got = time.monotonic() + 20.0, self.answers()
        while not happened():
            assert time.monotonic() < end
            self.go(MS)
            got += self.answers()
        return got

    def speak(self, message: bytes, outlet: int = 1) -> None:
        """Send a message."""
        self.peer.send(self._spoken, outlet, 0, message, False)

    def go(self, ns: int) -> None:
        """Let the process wait for some time, ns, and do what it is to do."""
        end = time.monotonic_ns() + ns
        while (left := end - time.monotonic_ns()) > 0:
            self.exchange.collect(1e-9 * left)
            self.exchange.deliver()
            self.host.act(self.host.now_ns())

    def answers(self) -> list[bytes]:
        """Return what the peer has got by now."""
        for one in self.peer.collect(whole=False):
            one.listener(one.message, one.origin)
        found, self.got[:] = list(self.got), []
        return found

    def close(self) -> None:
        """Leave the lane."""
        self.exchange.close()
        self.peer.close()


@pytest.fixture
def folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    # A machine that is busy makes every message of these tests late.
    monkeypatch.setattr(exchange_module, "SETTLES_NS", 50 * MS)
    made = tmp_path_factory.mktemp("l")
    made.chmod(0o700)
    return made


class States:
    """States of a scene's mechanism, one after another, as messages."""

    def __init__(self, simulator: Simulator) -> None:
        mechanism = simulator.mechanism
        self._layout, self._simulator = StateLayout(mechanism), simulator
        self._encoder = FlatArray(self._layout.fields)
        self._state = simulator.initial_state()
        self._grasps = flat_grasps(simulator.scene)
        self._pushes = np.random.default_rng(1)
        self.stamp_ns = 0

    def next(self, spoil: Callable[[Any], None] | None = None) -> bytes:
        """Return the next one, stamped now; ``spoil`` changes its numbers."""
        wrench = self._pushes.normal(size=(1, 6))
        self._state = state = self._simulator.step(self._state, wrench)
        self.stamp_ns = time.time_ns()
        told = WireState(
            self.stamp_ns, state.active, state.q, state.v, wrench, self._grasps, (True,)
        )
        values = self._layout.pack(told)
        if spoil is not None:
            spoil(values)
            return self._encoder.prefix + values.tobytes()
        return self._encoder.encode(values)


@pytest.fixture
def analysed(folder: Path) -> Iterator[tuple[Process, States]]:
    process = Process(NullspaceAnalyser, "five_bar", folder, MODELS, STATES)
    states = States(Simulator(process.actor.scene))
    process.settle(lambda: process.speak(states.next()))
    process.answers()
    yield process, states
    process.close()


def by_the_kernel(process: Process, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list to which the kernel adds why it returned, each time it does."""
    codes: list[int] = []
    run = process.wait.run

    def noted() -> int:
        codes.append(run())
        return codes[-1]

    monkeypatch.setattr(process.wait, "run", noted)
    return codes


def test_states_are_answered_as_python_answers_them(
    analysed: tuple[Process, States], monkeypatch: pytest.MonkeyPatch
) -> None:
    process, states = analysed
    process.actor.age_limit_ns = 1 << 62
    plain, lane = [states.next() for _ in range(40)], process.exchange.lane
    before = process.actor.past.arrays, process.actor.counter.numbers.copy()
    kept = [one.copy() for one in before[0]]
    count, first, last = process.actor._count, process.actor.first_ns, process.actor.last_ns
    found = []
    for by_kernel in (True, False):
        for array, old in zip(process.actor.past.arrays, kept, strict=True):
            array[:] = old
        process.actor.counter.numbers[:] = before[1]
        process.actor._count, process.actor.first_ns = count, first
        process.actor.last_ns = last
        lane.wait = process.wait if by_kernel else None
        codes = by_the_kernel(process, monkeypatch)
        analyses, got = process.actor.analyses, []
        for done, message in enumerate(plain, analyses + 1):
            process.speak(message)
            got += process.until(lambda done=done: process.actor.analyses == done)
        got += process.answers()
        assert bool(codes) == by_kernel
        monkeypatch.undo()
        found.append(got)
    assert len(found[0]) == len(plain)
    assert found[0] == found[1]


def nan(values: Any) -> None:
    values[5] = np.nan


def old(values: Any) -> None:
    values[0] -= 60.0


def nobody_holds(values: Any) -> None:
    values[-1] = 0.5


@pytest.mark.parametrize("spoil", [nan, old, nobody_holds])
def test_what_breaks_a_rule_is_refused_once_and_named(
    analysed: tuple[Process, States], spoil: Callable[[Any], None]
) -> None:
    process, states = analysed
    refused, analyses = process.host.refused, process.actor.analyses
    process.speak(states.next(spoil))
    process.until(lambda: process.host.refused > refused)
    process.go(2 * MS)
    assert process.host.refused == refused + 1
    assert process.host.last_refusal.startswith("mechanism/state: ")
    assert process.answers() == []
    # And what comes then is answered again.
    process.speak(states.next())
    got = process.until(lambda: process.actor.analyses > analyses)
    assert process.actor.analyses == analyses + 1
    assert len(got + process.answers()) == 1


def test_a_second_mechanism_is_noticed_and_nobody_answered(
    analysed: tuple[Process, States],
) -> None:
    process, states = analysed
    process.speak(states.next(), outlet=2)
    process.speak(states.next())
    process.until(lambda: bool(process.actor.status()[2]["fault"]))
    well, sentence, _ = process.actor.status()
    assert not well
    assert "more than one publisher of /mechanism/state" in sentence


def test_a_point_that_is_held_elsewhere_is_followed(analysed: tuple[Process, States]) -> None:
    process, states = analysed

    def moved(values: Any) -> None:
        values[-8 + 1] += 0.01

    held = process.actor.grasp
    process.speak(states.next(moved))
    got = process.until(lambda: process.actor.grasp is not held)
    grasp = OPERATIONAL_MODEL_FIELDS.slice("grasp")
    (answer,) = got + process.answers()
    told = FlatArray(OPERATIONAL_MODEL_FIELDS).decode(answer)[grasp]
    assert told[1] == pytest.approx(flat_grasps(process.actor.scene)[0][1] + 0.01)


def test_where_the_answers_numbers_are_is_one_table() -> None:
    starts = OPERATIONAL_MODEL_FIELDS.starts("count", "s", "commanded", "grasp", "quaternion")
    assert starts == (
        kernels.COUNT,
        kernels.MODEL,
        kernels.COMMANDED,
        kernels.GRASP,
        analysis_kernels._QUATERNION,
    )


@pytest.fixture
def moving(folder: Path) -> Iterator[Process]:
    process = Process(MechanismSimulator, "five_bar", folder, STATES, COMMANDS)
    yield process
    process.close()


def test_the_mechanism_moves_as_the_simulator_does(
    moving: Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    actor, wrench = moving.actor, np.array((0.3, -0.2, 0.0, 0.0, 0.0, 0.01))
    actor.port.set_timeout(10_000 * MS)
    moving.settle(lambda: moving.speak(encode_wrench(wrench, time.time_ns() // 1000 * 1000)))
    codes, start = by_the_kernel(moving, monkeypatch), actor.state
    moving.answers()
    got = []
    for wanted_s in np.linspace(0.0, 0.1, 26):
        moving.speak(encode_wrench(wrench, time.time_ns() // 1000 * 1000))
        got += moving.until(lambda wanted_s=wanted_s: actor.state.time - start.time >= wanted_s)
    got += moving.answers()
    assert codes
    # Of those that were missed several are done in one tick.
    steps = round((actor.state.time - start.time) / actor.period_s)
    simulator = Simulator(actor.scene)
    expected = start
    for _ in range(steps):
        expected = simulator.step(expected, wrench[None])
    assert steps >= 100
    assert actor.state.q == pytest.approx(expected.q, abs=1e-12)
    assert actor.state.account.work_in == pytest.approx(expected.account.work_in, rel=1e-9)
    layout = StateLayout(simulator.mechanism)
    last = layout.unpack(FlatArray(layout.fields).decode(got[-1]))
    assert last.commanded == (True,)
    assert last.stamp_ns % MS == MS // 2


def test_a_command_that_is_not_renewed_ends(moving: Process) -> None:
    actor, wrench = moving.actor, np.array((0.3, -0.2, 0.0, 0.0, 0.0, 0.01))
    moving.settle(lambda: moving.speak(encode_wrench(wrench, time.time_ns() // 1000 * 1000)))
    moving.until(lambda: not actor.port.command.stands(time.time_ns()))
    # A step is under what stood when it began.
    ended = actor._ticks
    moving.until(lambda: actor._ticks > ended + 5)
    work, ticks = actor.state.account.work_in, actor._ticks
    assert work > 0.0
    moving.until(lambda: actor._ticks > ticks + 50)
    assert actor.state.account.work_in == work


def test_a_loop_that_is_opened_is_announced(moving: Process) -> None:
    actor = moving.actor
    moving.settle(lambda: moving.speak(encode_wrench(np.zeros(6), time.time_ns() // 1000 * 1000)))
    moving.until(lambda: actor.steps_plainly)
    actor._switch("ground_pin", False)
    # By Python: nothing else says so.
    assert not actor.steps_plainly
    moving.until(lambda: actor.steps_plainly)
    assert actor._announced == actor.state.active == (False,)
