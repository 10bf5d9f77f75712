# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that handle plain messages: the same as Python does, and nothing that is not plain."""

from __future__ import annotations

import ctypes
import os
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from copy import deepcopy
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.reliability.fake_graph import Host
from hapticmech_ros.compilation.records import Record
from hapticmech_ros.compilation.structures import Structure
from hapticmech_ros.control.other_hands import REMEMBERED
from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.nodes import exchange as exchange_module
from hapticmech_ros.nodes import lane as lane_module
from hapticmech_ros.nodes import lane_kernels, plain_messages
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.nodes.exchange import Exchange, Outlet
from hapticmech_ros.nodes.haptic_device import HapticDevice
from hapticmech_ros.nodes.lane import Lane
from hapticmech_ros.nodes.local_loop import FRESH_NS
from hapticmech_ros.nodes.mechanism_simulator import MechanismSimulator
from hapticmech_ros.nodes.nullspace_analyser import NullspaceAnalyser
from hapticmech_ros.nodes.sources import Origin, first_fault
from hapticmech_ros.nodes.teleoperation_controller import TeleoperationController
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.analysis import (
    ContactWrenches,
    coupling,
    transmission,
)
from hapticmech_ros.operational.observation import PastRates
from hapticmech_ros.simulation import MechanismState, Simulator
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.layouts import CouplingMatrices, CouplingWire, OperationalModelWriter
from hapticmech_ros.wire.messages import (
    DeviceStateMessage,
    LocalFeedbackGain,
    OperationalModelMessage,
)
from hapticmech_ros.wire.stamped import encode_pose
from hapticmech_ros.wire.state import StateLayout, WireState
from hapticmech_ros.wire.topics import DEVICE_COMMAND
from hapticmech_ros.wire.wrench import encode_wrench
from nodes.stand_ins import MS, at_last

STATES, MODELS = "/mechanism/state Float64MultiArray", "/analysis/handle/operational_model {}"
MODELS = MODELS.format("Float64MultiArray")
COMMANDS = "/mechanism/handle/servo_cf WrenchStamped"
DEVICE_STATES = "/device/state Float64MultiArray"
DEVICE_COMMANDS = "/device/servo_cf WrenchStamped"
GAINS = "/device/local_feedback_gain Float64MultiArray"
TRANSMISSIONS = "/analysis/left/transmission Float64MultiArray"
LEFT_STATES, LEFT_COMMANDS, LEFT_GAINS = (
    f"/left{topic}" for topic in (DEVICE_STATES, DEVICE_COMMANDS, GAINS)
)
COUPLINGS = "/left/device/coupling_gain Float64MultiArray"
RIGHT_STATES = f"/right{DEVICE_STATES}"
RECEIVED = STATES, MODELS, COMMANDS, DEVICE_COMMANDS, DEVICE_STATES, GAINS, TRANSMISSIONS
RECEIVED = *RECEIVED, LEFT_STATES
RCL_PUBLISHERS: list[Callable[[bytes], int]] = []


# As rcl declares it; a serialized message is eight words.
@ctypes.CFUNCTYPE(
    ctypes.c_int32, ctypes.c_size_t, ctypes.POINTER(ctypes.c_size_t * 8), ctypes.c_void_p
)
def rcl_publish(publisher: int, message: Any, _allocation: int) -> int:
    """Stand for ``rcl_publish_serialized_message``."""
    address, length, capacity, *allocator = message.contents
    assert length == capacity
    assert not any(allocator)
    return RCL_PUBLISHERS[publisher - 1](ctypes.string_at(address, length))


@pytest.fixture(autouse=True)
def _messages_are_published_by_rcl() -> Iterator[None]:
    address = ctypes.cast(rcl_publish, ctypes.c_void_p).value
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(exchange_module, "_rcl_publishes", lambda: address)
        yield


class LaneHost(Host):
    """Hosts one actor by the machine's clock, on a lane.

    Attributes:
        outside: how many listen that are not on the lane.
        carried: what the middleware was given, by topic.
        rcl_fails: whether rcl refuses to publish.
        by_rcl: how many messages a kernel had rcl publish.
    """

    def __init__(self, graph: Any, name: str) -> None:
        super().__init__(graph, name)
        self.outside = 0
        self.carried: dict[str, list[bytes]] = defaultdict(list)
        self.rcl_fails = False
        self.by_rcl = 0

    def publish(self, topic: str, message: bytes) -> int:
        """Publish as rcl does; return what it returns."""
        if not self.rcl_fails:
            self.carried[topic].append(message)
            self.by_rcl += 1
        return int(self.rcl_fails)

    def lane_kind(self, message_type: Any) -> str:
        return message_type.__name__

    def now_ns(self) -> int:
        return time.time_ns()

    def create_publisher(self, kind: Any, name: str, qos: Any) -> Any:
        topic = self.resolve_topic_name(name)
        received = topic in [name.split()[0] for name in RECEIVED]
        RCL_PUBLISHERS.append(lambda message: self.publish(topic, message))
        return SimpleNamespace(
            topic_name=topic,
            handle=SimpleNamespace(pointer=len(RCL_PUBLISHERS)),
            publish=self.carried[topic].append,
            get_subscription_count=lambda: received * (1 + self.outside),
        )


class Peer:
    """A process that an actor speaks to and hears.

    Args:
        folder: of the lane.
        heard: topic that it hears; empty for none.
        spoken: topic that it speaks on; empty for none.
    """

    def __init__(self, folder: Path, received: str, spoken: str) -> None:
        self.lane, self.got = Lane(folder), list[bytes]()
        self.received, self.spoken = received, spoken
        self.number = 0
        if received:
            self.lane.listen(received, self._get)

    def _get(self, message: bytes, _: Origin) -> None:
        self.got.append(message)

    def speak(self, message: bytes, outlet: int = 1, both: bool = False) -> None:
        """Send a message; ``both`` as if through the middleware too."""
        self.number += both
        self.lane.send(self.spoken, outlet, self.number, message, both)

    def has_met(self, lane: Lane) -> bool:
        """Return whether both have found each other."""
        is_heard = not self.spoken or bool(self.lane.readers(self.spoken))
        return is_heard and (not self.received or bool(lane.readers(self.received)))

    def answers(self) -> list[bytes]:
        """Return what it has got by now."""
        for one in self.lane.collect(whole=False):
            one.listener(one.message, one.origin)
        found, self.got[:] = list(self.got), []
        return found


class Process:
    """An actor's process, and peers who speak to it and hear it.

    Args:
        folder: of the lane.
        kind: of the actor.
        peers: what each hears and speaks on.
        scene: of the actor.
        namespace: likewise.
        settings: its other parameters.
    """

    def __init__(
        self,
        folder: Path,
        kind: Any,
        *peers: tuple[str, str],
        scene: str = "five_bar",
        namespace: str = "",
        **settings: str,
    ) -> None:
        self.exchange = Exchange()
        self.exchange.lane = Lane(folder)
        graph = SimpleNamespace(
            exchange=self.exchange,
            deliver=self.exchange.deliver,
            namespace=namespace,
            now_ns=0,
            pushing=(),
        )
        self.host = host = LaneHost(graph, kind.name)
        host.hand_over = (  # type: ignore[method-assign]
            lambda topic, kind, listener: self.exchange.listen(topic, listener, kind.__name__)
        )
        self.subscriptions: list[Any] = []
        host.create_subscription = (  # type: ignore[method-assign]
            lambda kind, name, callback, qos, raw=False: SimpleNamespace(
                get_publisher_count=lambda: 0
            )
        )
        host.actor = self.actor = kind(host, kind.parameters_type(scene=scene, **settings))
        self.peers = [Peer(folder, *one) for one in peers]
        host.begin()
        self.wait = self.exchange.lane.wait
        self.meet()

    def meet(self) -> None:
        """Let both find each other."""
        lane = self.exchange.lane

        def look() -> None:
            for one in (lane, *(peer.lane for peer in self.peers)):
                one._looked_ns = -lane_module.LOOK_NS
                one.look()
                one.collect()

        at_last(lambda: all(peer.has_met(lane) for peer in self.peers), look, 5.0)

    def settle(self, send: Callable[[], None]) -> None:
        """Send until a kernel does the work: both ways are used for a while at first."""

        def go_on() -> None:
            send()
            self.go(2 * MS)

        at_last(lambda: self.exchange.lane.worked, go_on)

    def until(self, happened: Callable[[], bool]) -> list[bytes]:
        """Go on until something has happened, and return what the peer has got by then."""
        got = self.answers()

        def go_on() -> None:
            self.go(MS)
            got.extend(self.answers())

        at_last(happened, go_on)
        return got

    def speak(self, message: bytes, outlet: int = 1, both: bool = False) -> None:
        """Send a message, as the first peer."""
        self.peers[0].speak(message, outlet, both)

    def go(self, ns: int) -> None:
        """Let the process wait for some time, ns, and do what it is to do."""
        end = time.monotonic_ns() + ns
        while (left := end - time.monotonic_ns()) > 0:
            self.exchange.collect(1e-9 * left)
            self.exchange.deliver()
            clock = getattr(self.actor, "clock", None)
            if clock is not None and clock.next_ns <= self.host.now_ns():
                # A kernel takes what has come when it acts; so that Python does, too:
                worked = self.exchange.lane.worked
                self.exchange.collect(whole=True)
                self.exchange.deliver()
                self.exchange.lane.worked = worked
            self.host.act(self.host.now_ns())

    def answers(self) -> list[bytes]:
        """Return what the first peer has got by now."""
        return self.peers[0].answers()

    def close(self) -> None:
        """Leave the lane."""
        self.exchange.close()
        for peer in self.peers:
            peer.lane.close()


@pytest.fixture
def folder(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    # A machine that is busy makes every message of these tests late.
    monkeypatch.setattr(exchange_module, "SETTLES_NS", 50 * MS)
    made = tmp_path_factory.mktemp("l")
    made.chmod(0o700)
    return made


@pytest.fixture
def begun(folder: Path) -> Iterator[Callable[..., Process]]:
    """Begin an actor's process, which ends with the test."""
    with ExitStack() as ends:

        def begin(*given: Any, place: Path = folder, **scene: str) -> Process:
            process = Process(place, *given, **scene)
            ends.callback(process.close)
            return process

        yield begin


class States:
    """States of a scene's mechanism, one after another, as messages."""

    def __init__(self, simulator: Simulator) -> None:
        mechanism = simulator.mechanism
        self._layout, self._simulator = StateLayout(mechanism), simulator
        self._encoder = FlatArray(self._layout.fields)
        self._state = simulator.initial_state()
        self._grasps = flat_grasps(simulator.scene)
        self._pushes = np.random.default_rng(1)
        self.commanded = (True,) * len(simulator.mechanism.point_names)
        self.last: WireState | None = None
        self.stamp_ns = 0

    def next(self, spoil: Callable[[Any], None] | None = None) -> bytes:
        """Return the next one, stamped now; ``spoil`` changes its numbers."""
        wrench = self._pushes.normal(size=(len(self.commanded), 6))
        self._state = state = self._simulator.step(self._state, wrench)
        self.stamp_ns = time.time_ns()
        self.last = WireState(
            self.stamp_ns, state.active, state.q, state.v, wrench, self._grasps, self.commanded
        )
        values = self._layout.pack(self.last)
        if spoil is not None:
            spoil(values)
            return self._encoder.prefix + values.tobytes()
        return self._encoder.encode(values)


@pytest.fixture
def analyser(begun: Callable[..., Process]) -> Process:
    return begun(NullspaceAnalyser, (MODELS, STATES))


@pytest.fixture
def states(analyser: Process) -> States:
    """What the analyser answers by a kernel from now on."""
    made = States(Simulator(analyser.actor.scene))
    analyser.settle(lambda: analyser.speak(made.next()))
    analyser.answers()
    return made


def instead_of_the_kernel(
    process: Process, monkeypatch: pytest.MonkeyPatch, run: Callable[[Callable[[], int]], int]
) -> None:
    """Let something run the kernel, each time that it is to run."""
    kernel = process.wait.kernel
    monkeypatch.setattr(process.wait, "kernel", lambda: partial(run, kernel()))


def by_the_kernel(process: Process, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list to which the kernel adds why it returned, each time it does."""
    codes: list[int] = []

    def noting(kernel: Callable[[], int]) -> int:
        codes.append(kernel())
        return codes[-1]

    instead_of_the_kernel(process, monkeypatch, noting)
    return codes


def news_of_listeners(
    process: Process,
    monkeypatch: pytest.MonkeyPatch,
    set_count: Callable[[int], object],
    has_news: Callable[[], bool],
) -> list[bool]:
    """Return whether there is news where nobody and where somebody listens, as a kernel begins."""
    seen: list[bool] = []

    def noting(kernel: Callable[[], int]) -> int:
        for count in (0, 1):
            set_count(count)
            time.sleep(2e-9 * exchange_module.CENSUS_NS)
            seen.append(has_news())
        return kernel()

    instead_of_the_kernel(process, monkeypatch, noting)
    process.until(lambda: seen)
    return seen[:2]


def by_kernel_and_by_python(
    process: Process,
    monkeypatch: pytest.MonkeyPatch,
    values: list[tuple[Any, str, Any]],
    arrays: Callable[[], list[Any]],
) -> Iterator[tuple[bool, list[int]]]:
    """Let a kernel work, and then Python, from the same values and numbers in arrays.

    Yields:
        Whether it is the kernel, and a list to which it adds why it returned.
    """
    kept = [one.copy() for one in arrays()]
    for by_kernel in (True, False):
        for one, name, value in values:
            setattr(one, name, value)
        for array, old in zip(arrays(), kept, strict=True):
            array[:] = old
        process.exchange.lane.wait = process.wait if by_kernel else None
        codes = by_the_kernel(process, monkeypatch)
        yield by_kernel, codes
        assert bool(codes) == by_kernel
        monkeypatch.undo()


@pytest.mark.parametrize(("both", "rcl_fails"), [(False, False), (True, False), (True, True)])
def test_states_are_answered_as_python_answers_them(
    analyser: Process, states: States, monkeypatch: pytest.MonkeyPatch, both: bool, rcl_fails: bool
) -> None:
    analyser.host.rcl_fails = rcl_fails
    # Whether the middleware carries all as well: somebody listens there.
    analyser.host.outside = int(both)
    analyser.until(lambda: analyser.actor._publish_model.way == both)
    state, model = STATES.split()[0], MODELS.split()[0]
    actor = analyser.actor
    actor.age_limit_ns = 1 << 62
    plain, found = [states.next() for _ in range(40)], []
    values = [(actor, name, getattr(actor, name)) for name in ("_count", "first_ns", "last_ns")]
    arrays = lambda: [*actor.past.arrays, actor.counter.numbers.values]  # noqa: E731
    for by_kernel, codes in by_kernel_and_by_python(analyser, monkeypatch, values, arrays):
        analyses, got = actor.analyses, []
        analyser.host.carried[model].clear()
        analyser.host.by_rcl = 0
        for done, message in enumerate(plain, analyses + 1):
            analyser.speak(message, both=both)
            got += analyser.until(lambda done=done: actor.analyses == done)
        got += analyser.answers()
        assert analyser.host.carried[model] == (got if both else [])
        assert bool(analyser.host.by_rcl) == (by_kernel and both and not rcl_fails)
        assert (lane_kernels.TO_SEND in codes) == (by_kernel and rcl_fails)
        # What the middleware brings of it is known.
        assert all(analyser.exchange._copies[state].had(message) == both for message in plain)
        analyser.exchange._copies[state].underway.clear()
        assert actor._mechanisms.latest.number == analyser.peers[0].number
        found.append(got)
    assert analyser.exchange.lane.sent[actor._publish_model.number] > 2 * len(plain)
    assert len(found[0]) == len(plain)
    assert found[0] == found[1]


def test_other_hands_that_hold_the_mechanism_need_no_python(
    begun: Callable[..., Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    models = MODELS.replace("handle", "left")
    peers = [(models, STATES), (TRANSMISSIONS, "")]
    process = begun(NullspaceAnalyser, *peers, scene="two_users", operational_point="left")
    actor, simulator = process.actor, Simulator(process.actor.shared_scene)
    states, sent = States(simulator), dict[int, WireState]()

    def speak() -> None:
        process.speak(states.next())
        sent[states.stamp_ns] = states.last

    process.settle(speak)
    wire, mechanism = CouplingWire(["right"], actor.limits), simulator.mechanism
    analyser = Analyser(mechanism, "left")
    for held in (True, False, True):
        states.commanded = (True, held)
        process.until(lambda held=held: (speak(), actor.commanded[1] == held)[1])
        process.peers[1].answers()
        codes, heard = by_the_kernel(process, monkeypatch), list[bytes]()

        def enough(codes: list[int] = codes, heard: list[bytes] = heard) -> bool:
            speak()
            heard += process.peers[1].answers()
            return len(heard) > 4 and lane_kernels.TO_LOOK_AT in codes

        process.until(enough)
        monkeypatch.undo()
        for message in heard:
            found = wire.unpack(FlatArray(wire.fields).decode(message))
            assert list(found.by_point) == ["right"] * held
            if held:
                state = sent[found.stamp_ns]
                terms = mechanism.evaluate(state.q, state.v, state.active)
                expected = transmission(analyser.analyse(terms), coupling(terms)[0, 1])
                np.testing.assert_allclose(found.by_point["right"], expected, atol=1e-9)


@pytest.fixture
def shared(analyser: Process, states: States) -> Iterator[None]:
    """Let the thread of the analyser's process share its turn with others."""
    turn = analyser.exchange.lane.turn
    turn.share()
    yield
    if turn.is_shared:
        turn.end()


def test_copies_of_what_a_kernel_has_read_are_dropped_while_it_goes_on(
    shared: None,
    analyser: Process,
    states: States,
) -> None:
    """And one of which no copy came is still known as the kernel's when it ends."""
    exchange, called, done = analyser.exchange, [], []

    def send(message: bytes) -> None:
        analyser.speak(message, both=True)
        at_last(analyser.answers)

    def work() -> None:
        missing, copied, early, foreign = (states.next() for _ in range(4))
        send(missing)
        send(copied)
        assert exchange.defer(lambda: called.append("copied"), STATES, copied)
        assert not exchange.has_deferred
        # The middleware may be faster than the kernel.
        assert exchange.defer(lambda: called.append("early"), STATES, early)
        assert 0.0 < exchange.until_called_s < 0.01
        send(early)
        assert exchange.defer(lambda: called.append("foreign"), STATES, foreign)
        exchange.drop_copies()
        assert exchange.has_deferred
        assert exchange.lane.turn.kernel_runs
        with exchange.taken():
            copies = exchange._copies[STATES.split()[0]]
            done.append([copies.had(one) for one in (missing, copied, early, foreign)])

    def ring_afterwards() -> None:
        try:
            work()
        finally:
            ended.set()
            exchange.ring()

    ended = threading.Event()
    thread = threading.Thread(target=ring_afterwards)
    thread.start()
    while not ended.is_set():
        exchange.collect(20.0)
        exchange.deliver()
    thread.join()
    assert done == [[True, False, False, False]]
    assert called == ["foreign"]
    assert not exchange.defer(lambda: called.append("stopped"), STATES, b"")


def test_a_callback_in_another_thread_stops_the_kernel_and_knows_what_it_has_done(
    shared: None,
    analyser: Process,
    states: States,
) -> None:
    exchange, before = analyser.exchange, analyser.actor.analyses
    known: list[tuple[int, bool, int]] = []

    def callback() -> None:
        sent = states.next()
        analyser.speak(sent, both=True)
        at_last(analyser.answers)
        asked = time.monotonic_ns()
        with exchange.taken():
            had = exchange._copies[STATES.split()[0]].had(sent)
            known.append((analyser.actor.analyses, had, time.monotonic_ns() - asked))
            # What others would have to wait for.
            assert exchange.settled

    thread = threading.Thread(target=callback)
    thread.start()
    while not known:
        exchange.collect(0.5)
        exchange.deliver()
    thread.join()
    assert analyser.exchange.lane.worked
    analyses, had, waited_ns = known[0]
    assert (analyses, had) == (before + 1, True)
    # It was not waited for until the kernel's time was up.
    assert waited_ns < 250 * MS


def test_views_are_published_by_another_thread_while_the_kernel_goes_on(
    shared: None, analyser: Process, states: States, monkeypatch: pytest.MonkeyPatch
) -> None:
    exchange, actor = analyser.exchange, analyser.actor
    turn, seen = exchange.lane.turn, list[int]()
    # Also where this test has no processor for a while.
    monkeypatch.setattr(plain_messages, "GIVE_WAY_NS", 0)
    until_view = property(lambda actor: 1 + -actor.analyses % actor.view_every)
    monkeypatch.setattr(type(actor), "until_view", until_view)
    actor.view_every = 3
    monkeypatch.setattr(actor, "publish_view", lambda found, count: seen.append(count))
    codes = by_the_kernel(analyser, monkeypatch)
    before, done = actor.analyses, list[int]()

    def publish() -> None:
        while turn.wait_for_view():
            turn.publish_views()

    def speak() -> None:
        for number in range(before, before + 9):
            analyser.speak(states.next())
            at_last(analyser.answers)
            # Who is not seen yet is not followed by another one.
            views = number // 3 - (before - 1) // 3
            at_last(lambda views=views: len(seen) >= views)
        with exchange.taken():
            done.append(actor.analyses)

    threads = [threading.Thread(target=body) for body in (publish, speak)]
    for thread in threads:
        thread.start()
    while threads[1].is_alive():
        exchange.collect(1.0)
        exchange.deliver()
    assert done == [before + 9]
    assert len(seen) == 3
    # A kernel went on after each of them.
    assert codes.count(lane_kernels.TO_LOOK_AT) == 3
    assert codes.index(lane_kernels.TO_LOOK_AT) < len(codes) - 1


def test_views_at_the_control_rate_are_all_published_also_after_a_pause(
    shared: None, analyser: Process, states: States, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A controller may have CRTK's topics alone: they are its samples."""
    actor, seen = analyser.actor, list[int]()
    until_view = property(lambda actor: 1 + -actor.analyses % actor.view_every)
    monkeypatch.setattr(type(actor), "until_view", until_view)
    actor.view_every = 1
    monkeypatch.setattr(actor, "publish_view", lambda found, count: seen.append(count))
    codes, before = by_the_kernel(analyser, monkeypatch), actor.analyses
    for done in range(before + 1, before + 9):
        analyser.wait._late_ns = time.monotonic_ns()
        analyser.speak(states.next())
        analyser.until(lambda done=done: actor.analyses == done)
    assert len(seen) == 8
    assert lane_kernels.TO_LOOK_AT in codes


def nan(values: Any) -> None:
    values[5] = np.nan


def old(values: Any) -> None:
    values[0] -= 60.0


def nobody_holds(values: Any) -> None:
    values[-1] = 0.5


@pytest.mark.parametrize("spoil", [nan, old, nobody_holds])
def test_what_breaks_a_rule_is_refused_once_and_named(
    analyser: Process, states: States, spoil: Callable[[Any], None]
) -> None:
    refused, analyses = analyser.host.refused, analyser.actor.analyses
    analyser.speak(states.next(spoil))
    analyser.until(lambda: analyser.host.refused > refused)
    analyser.go(2 * MS)
    assert analyser.host.refused == refused + 1
    assert analyser.host.last_refusal.startswith("mechanism/state: ")
    assert analyser.answers() == []
    # And what comes then is answered again.
    analyser.speak(states.next())
    got = analyser.until(lambda: analyser.actor.analyses > analyses)
    assert analyser.actor.analyses == analyses + 1
    assert len(got + analyser.answers()) == 1


def test_a_second_mechanism_is_noticed_and_nobody_answered(
    analyser: Process,
    states: States,
) -> None:
    analyser.speak(states.next(), outlet=2)
    analyser.speak(states.next())
    analyser.until(lambda: bool(analyser.actor.status()[2]["fault"]))
    well, sentence, _ = analyser.actor.status()
    assert not well
    assert "more than one publisher of /mechanism/state" in sentence


def test_a_point_that_is_held_elsewhere_is_followed(analyser: Process, states: States) -> None:

    def moved(values: Any) -> None:
        values[-8 + 1] += 0.01

    held = analyser.actor.grasp
    analyser.speak(states.next(moved))
    got = analyser.until(lambda: analyser.actor.grasp is not held)
    grasp = OperationalModelMessage.layout.slice("grasp")
    (answer,) = got + analyser.answers()
    told = FlatArray(OperationalModelMessage.layout).decode(answer)[grasp]
    assert told[1] == pytest.approx(flat_grasps(analyser.actor.scene)[0][1] + 0.01)


def test_a_kernel_is_left_for_subscribers_outside_that_come_or_go(
    analyser: Process, states: States, monkeypatch: pytest.MonkeyPatch
) -> None:
    exchange, host = analyser.exchange, analyser.host
    analyser.until(lambda: analyser.actor._publish_model.way is False)
    # Looked at now, after a last change long ago: of the lane there are no news.
    os.utime(exchange.lane._folder, (0, 0))
    exchange.lane._looked_ns = -lane_module.LOOK_NS
    exchange.lane.look()
    assert not exchange.has_news
    analyser.speak(states.next())
    listen = partial(setattr, host, "outside")
    seen = news_of_listeners(analyser, monkeypatch, listen, lambda: exchange.has_news)
    assert seen == [False, True]


def test_a_publication_that_fails_is_counted_and_ends_nobody(
    analyser: Process, states: States, monkeypatch: pytest.MonkeyPatch
) -> None:
    actor = analyser.actor
    outlet, codes = actor._publish_model, by_the_kernel(analyser, monkeypatch)
    analyser.host.outside, analyser.host.rcl_fails = 1, True
    analyser.until(lambda: outlet.way is True)
    # By the kernel from here on: Python's own messages would fail too, and end the actor first.
    analyser.exchange.lane.worked = False
    analyser.settle(lambda: analyser.speak(states.next()))
    codes.clear()

    def fails(message: bytes) -> None:
        raise RuntimeError("no context")

    monkeypatch.setattr(outlet, "publish_outside", fails)

    def spoken() -> bool:
        analyser.speak(states.next())
        return bool(actor.failures.count and lane_kernels.TO_SEND in codes)

    analyser.until(spoken)
    assert "no context" in actor.failures.last


@pytest.fixture
def moving(begun: Callable[..., Process]) -> Process:
    return begun(MechanismSimulator, (STATES, COMMANDS))


WRENCH = np.array((0.3, -0.2, 0.0, 0.0, 0.0, 0.01))


def command(process: Process, wrench: Any = WRENCH) -> None:
    """Command a wrench, stamped now as messages are."""
    process.speak(encode_wrench(wrench, time.time_ns() // 1000 * 1000))


def made_up_by_the_kernel(actor: Any, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list to which the kernel adds how many missed deadlines it has made up for."""
    missed, moved = list[int](), actor.moved

    def noted(*given: Any) -> None:
        (link,) = [one for one in given if isinstance(one, lane_kernels.DeadlineLink)]
        missed.append(link.missed)
        moved(*given)

    monkeypatch.setattr(actor, "moved", noted)
    return missed


@pytest.mark.parametrize("grasp", ["", "link1 0.02 0.01 0"], ids=["handle", "held_elsewhere"])
def test_the_mechanism_moves_as_the_simulator_does(
    moving: Process, monkeypatch: pytest.MonkeyPatch, grasp: str
) -> None:
    actor = moving.actor
    moving.settle(lambda: command(moving))
    place = actor.places
    actor.apply_parameters(actor.parameters.model_copy(update={"grasp": grasp}))
    actor.held[0].set_timeout(10_000 * MS)
    codes = by_the_kernel(moving, monkeypatch)

    def received() -> bool:
        command(moving)
        return bool(actor.held[0].command.stands(time.time_ns()) and codes)

    moving.until(received)
    begun = actor._ticks
    moving.until(lambda: actor._ticks > begun + 10)
    moving.answers()
    start, missed = actor.state, made_up_by_the_kernel(actor, monkeypatch)
    got = []
    for wanted_s in np.linspace(0.0, 0.1, 26):
        command(moving)
        # Late by some periods, as after something else that took so long.
        time.sleep(0.0035 if round(1e3 * wanted_s) % 20 == 0 else 0.0)
        got += moving.until(lambda wanted_s=wanted_s: actor.state.time - start.time >= wanted_s)
    got += moving.answers()
    assert (np.abs(actor.places - place).max() > 0.005) == bool(grasp)
    # Of those that were missed several are done in one tick.
    steps = round((actor.state.time - start.time) / actor.period_s)
    simulator, expected = Simulator(actor.simulator.scene), start
    for _ in range(steps):
        expected = simulator.step(expected, WRENCH[None])
    assert steps >= 100
    assert sum(missed) >= 5
    assert actor.clock.missed >= sum(missed)
    assert actor.state.q == pytest.approx(expected.q, abs=1e-12)
    assert np.abs(actor.state.q - start.q).max() > 1e-6
    assert actor.state.account.work_in == pytest.approx(expected.account.work_in, rel=1e-9)
    layout = StateLayout(simulator.mechanism)
    last = layout.unpack(FlatArray(layout.fields).decode(got[-1]))
    assert last.commanded == (True,)
    assert last.stamp_ns % MS == MS // 2


BALL = """
format: hapticmech-scene/1
name: ball
task_space: planar
gravity: [0.0, 0.0, 0.0]
links:
  - name: ball
    parent: world
    joint: {name: slide, type: planar}
    inertial: {mass: 0.5, inertia: {ixx: 2.0e-4, iyy: 2.0e-4, izz: 2.0e-4}}
shapes:
  - {name: round, link: ball, geometry: {kind: sphere, radius: 0.02}}
  - {name: ground, link: world, origin: {rpy: [-1.5707963, 0, 0]}, geometry: {kind: half_space}}
contacts:
  - {name: on_ground, a: round, b: ground, stiffness: 5.0e+3, damping: 20.0, friction: 0.3}
operational_points:
  - {name: handle, link: ball, origin: {xyz: [0.0, 0.03, 0.0]}, metric: {mass: 0.3, length: 0.03}}
  - {name: side, link: ball, origin: {xyz: [0.02, 0.0, 0.0]}, metric: {mass: 0.3, length: 0.03}}
initial_state:
  q: {slide: [0.0, 0.021, 1.0, 0.0]}
simulation: {period: 0.001}
hand: {kind: spring_damper, stiffness: 300.0, damping: 5.0, waypoints: [{time: 0.0}]}
"""
# A planar joint with a contact and two operational points, and free bodies in loops.
PUSHES = {
    # It latches after half a second.
    "door": (0.0, -0.3, 0.0, 0.0, 0.0, 0.0),
    "ball": (0.4, -3.0, 0.0, 0.0, 0.0, 0.0),
    "shared_payload": (2.0, 1.0, 3.0, 0.0, 0.0, 0.0),
    "stewart_platform": (2.0, 1.0, 3.0, 0.0, 0.0, 0.1),
}


@pytest.mark.parametrize("scene", PUSHES)
def test_joints_that_are_poses_and_contacts_move_as_the_simulator_does(
    begun: Callable[..., Process], folder: Path, monkeypatch: pytest.MonkeyPatch, scene: str
) -> None:
    if scene == "ball":
        (folder / "ball.yaml").write_text(BALL)
    file = str(folder / "ball.yaml") if scene == "ball" else scene
    commands = COMMANDS.replace("handle", load_scene(file).held_points[0])
    process = begun(MechanismSimulator, (STATES, commands), scene=file)
    actor, push = process.actor, np.array(PUSHES[scene])
    actor.held[0].set_timeout(10_000 * MS)
    process.settle(lambda: command(process, 0.0 * push))
    command(process, push)
    codes, moved, by_kernel = by_the_kernel(process, monkeypatch), actor.moved, []

    def noted(state: MechanismState, *given: Any) -> None:
        by_kernel.append(state)
        moved(state, *given)

    monkeypatch.setattr(actor, "moved", noted)
    ticks = actor._ticks
    process.until(lambda: codes and actor._ticks > ticks + 5)
    process.answers()
    by_kernel.clear()
    start = actor.state
    assert not any(start.active) or scene != "door"
    got = process.until(
        lambda: len(by_kernel) > 40 and (scene != "door" or actor.state.active == (True,))
    )
    got += process.answers()
    steps = round((actor.state.time - start.time) / actor.period_s)
    simulator = Simulator(actor.scene)
    mechanism = simulator.mechanism
    layout, felt = StateLayout(mechanism), ContactWrenches(mechanism)
    states, nobody = [start], np.zeros((len(mechanism.point_names), 6))
    wrenches = nobody.copy()
    wrenches[0] = push
    for _ in range(steps):
        states.append(simulator.step(states[-1], wrenches))
    assert actor.state.q == pytest.approx(states[-1].q, abs=1e-9)
    assert actor.state.account.work_in == pytest.approx(states[-1].account.work_in, rel=1e-6)
    touching = [state for state in by_kernel if state.touching and state.touching.pairs.size]
    assert (len(touching) > 5) == bool(actor.scene.contacts)
    numbers = np.array([[*mechanism.coordinates(state.q), *state.v] for state in states])
    touched = 0
    for message in got:
        values = FlatArray(layout.fields).decode(message)
        found = np.array([*values[layout.at["position"]], *values[layout.at["velocity"]]])
        nearest = int(np.abs(numbers - found).max(axis=1).argmin())
        assert found == pytest.approx(numbers[nearest], abs=1e-8)
        state, force = states[nearest], nobody
        if state.touching is not None and state.touching.joint_force.any():
            joint_forces = np.tile(state.touching.joint_force, (len(nobody), 1))
            force = felt.at(simulator.evaluate(state), joint_forces)
            touched += 1
        assert layout.unpack(values).contacts == pytest.approx(force, rel=1e-6, abs=1e-6)
    assert (touched > 20) == bool(actor.scene.contacts)


TWO = {"left": (0.4, -0.2, 0.0, 0.0, 0.0, 0.004), "right": (-0.1, 0.5, 0.0, 0.0, 0.0, -0.002)}


def test_two_hands_move_a_mechanism_and_feel_each_other_without_python(
    begun: Callable[..., Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    topics = [COMMANDS.replace("handle", point) for point in TWO]
    peers = [(STATES, topics[0]), ("", topics[1])]
    process = begun(MechanismSimulator, *peers, scene="two_users", held_points=",".join(TWO))
    actor = process.actor
    for port in actor.held:
        port.set_timeout(10_000 * MS)

    def push() -> None:
        for peer, wrench in zip(process.peers, TWO.values(), strict=True):
            peer.speak(encode_wrench(np.array(wrench), time.time_ns() // 1000 * 1000))

    process.settle(push)
    done, moved = list[int](), actor.moved

    def noted(state: MechanismState, link: Any, published: bool) -> None:
        done.append(link.done)
        moved(state, link, published)

    monkeypatch.setattr(actor, "moved", noted)
    ticks = actor._ticks
    process.until(lambda: len(done) > 2 and actor._ticks > ticks + 10)
    process.answers()
    start, got = actor.state, []
    done.clear()
    for wanted_s in np.linspace(0.0, 0.1, 21):
        push()
        got += process.until(lambda wanted_s=wanted_s: actor.state.time - start.time >= wanted_s)
    got += process.answers()
    simulator = Simulator(actor.scene)
    mechanism, wrenches = simulator.mechanism, np.array([*TWO.values()])
    states = [start]
    for _ in range(round((actor.state.time - start.time) / actor.period_s)):
        states.append(simulator.step(states[-1], wrenches))
    assert sum(done) > 90
    assert len(got) > 20
    assert actor.state.q == pytest.approx(states[-1].q, abs=1e-11)
    layout, felt = StateLayout(mechanism), ContactWrenches(mechanism)
    numbers = np.array([[*mechanism.coordinates(state.q), *state.v] for state in states])
    for message in got:
        found = layout.unpack(FlatArray(layout.fields).decode(message))
        assert found.commanded == (True, True)
        moved = np.array([*mechanism.coordinates(found.q), *found.v])
        nearest = int(np.abs(numbers - moved).max(axis=1).argmin())
        terms = simulator.evaluate(states[nearest])
        # Each point feels what accelerates it as the other hand's wrench does, and not its own.
        left, right = (
            p.jacobian.T @ wrench for p, wrench in zip(terms.points, wrenches, strict=True)
        )
        assert found.contacts == pytest.approx(felt.at(terms, np.array([right, left])), abs=1e-9)
        assert np.abs(found.contacts).max() > 0.05


def test_a_hand_that_is_gone_is_felt_no_more_and_python_is_not_needed(
    begun: Callable[..., Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    topics = [COMMANDS.replace("handle", point) for point in TWO]
    peers = [(STATES, topics[0]), ("", topics[1])]
    process = begun(MechanismSimulator, *peers, scene="two_users", held_points=",".join(TWO))
    actor, layout = process.actor, StateLayout(process.actor.simulator.mechanism)
    left, right = (np.array(wrench) for wrench in TWO.values())

    def until(happened: Callable[[], bool]) -> list[WireState]:
        def renewed() -> bool:
            command(process, left)
            return happened()

        got = process.until(renewed)
        return [layout.unpack(FlatArray(layout.fields).decode(one)) for one in got]

    # Nobody has ever held the other point.
    process.settle(lambda: command(process, left))
    codes = by_the_kernel(process, monkeypatch)
    alone = until(lambda: len(codes) > 3)[-1]
    process.peers[1].speak(encode_wrench(right, time.time_ns() // 1000 * 1000))
    port = actor.held[1]
    both = until(lambda: port.order.last[0] > 0 and not port.command.stands(time.time_ns()))
    assert any(one.commanded == (True, True) and one.contacts[0].any() for one in both)
    codes.clear()
    for state in (alone, until(lambda: len(codes) > 3)[-1]):
        assert state.commanded == (True, False)
        assert not state.contacts.any()


@pytest.mark.parametrize("scene", ["peg_in_hole", "shared_payload"])
def test_joints_that_are_poses_are_analysed_as_python_does(
    begun: Callable[..., Process], monkeypatch: pytest.MonkeyPatch, scene: str
) -> None:
    (point,) = load_scene(scene).operational_points
    models = MODELS.replace("handle", point.name)
    process = begun(NullspaceAnalyser, (models, STATES), scene=scene)
    actor, states = process.actor, States(Simulator(process.actor.scene))
    process.settle(lambda: process.speak(states.next()))
    actor.age_limit_ns = 1 << 62
    codes, past = by_the_kernel(process, monkeypatch), deepcopy(actor.past)
    process.answers()
    writer = OperationalModelWriter(actor.analyser, past)
    layout, expected, got = StateLayout(actor.mechanism), [], []
    for done in range(actor.analyses + 1, actor.analyses + 21):
        message = states.next()
        process.speak(message)
        got += process.until(lambda done=done: actor.analyses == done)
        writer.evaluate(layout.unpack(FlatArray(layout.fields).decode(message)))
        expected.append(writer.message.values.copy())
    got += process.answers()
    assert len(codes) > 10
    found = [FlatArray(OperationalModelMessage.layout).decode(message) for message in got]
    for one, other in zip(found, expected, strict=True):
        other[OperationalModelMessage.layout.start("count")] = OperationalModelMessage(one).count
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_a_command_that_is_not_renewed_ends(moving: Process) -> None:
    actor = moving.actor
    moving.settle(lambda: command(moving))
    moving.until(lambda: not actor.held[0].command.stands(time.time_ns()))
    # A step is under what stood when it began.
    ended = actor._ticks
    moving.until(lambda: actor._ticks > ended + 5)
    work, ticks = actor.state.account.work_in, actor._ticks
    assert work > 0.0
    moving.until(lambda: actor._ticks > ticks + 50)
    assert actor.state.account.work_in == work


def test_whoever_wants_python_gets_it_after_a_step(
    moving: Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    actor, link, turn = moving.actor, moving.wait.link, moving.exchange.lane.turn
    moving.settle(lambda: command(moving))
    left_ns = []

    def noting(kernel: Callable[[], int]) -> int:
        code = kernel()
        if link.asked:
            left_ns.append(link.next - link.ahead - time.monotonic_ns())
        return code

    instead_of_the_kernel(moving, monkeypatch, noting)

    def ring() -> None:
        for _ in range(60):
            time.sleep(0.0037)
            turn.ring()

    thread = threading.Thread(target=ring)
    thread.start()
    while thread.is_alive():
        command(moving)
        moving.go(10 * MS)
    assert len(left_ns) >= 10
    # In the midst of a wait it would be half a period in the mean, and less than a tenth at times.
    assert np.median(left_ns) > 0.7 * actor.period_ns


def test_a_kernel_that_has_done_steps_is_to_do_the_next_unless_it_left_one(
    moving: Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    exchange = moving.exchange
    moving.settle(lambda: command(moving))
    moving.until(lambda: exchange.lane.worked and moving.wait.link.done)
    assert exchange.has_stepped
    for code in (lane_kernels.TO_ACT, lane_kernels.TO_SAY):
        with monkeypatch.context() as patch:
            patch.setattr(moving.wait, "_code", code)
            assert not exchange.has_stepped
    # A look at what has come is no run.
    exchange.collect()
    assert not exchange.has_stepped
    exchange.lane.worked = True
    moving.wait.link.done = 0
    assert not exchange.has_stepped


def test_a_mechanism_that_nobody_listens_to_moves_without_python_until_somebody_does(
    begun: Callable[..., Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    process = begun(MechanismSimulator, ("", COMMANDS))
    outlet = process.actor._plain._published[0].outlet
    monkeypatch.setattr(outlet.publisher, "get_subscription_count", lambda: 0)
    process.settle(lambda: command(process))
    first = process.actor._ticks
    process.until(lambda: process.actor._ticks > first + 20 and process.exchange.lane.worked)
    assert outlet.ways() == "nobody"
    sent = len(process.host.carried[STATES.split()[0]])

    def listen(count: int) -> None:
        outlet.publisher.get_subscription_count = lambda: count

    seen = news_of_listeners(process, monkeypatch, listen, lambda: process.wait.has_news)
    assert seen == [False, True]
    monkeypatch.undo()
    listen(1)
    process.until(lambda: process.host.by_rcl > 5)
    assert len(process.host.carried[STATES.split()[0]]) >= sent + process.host.by_rcl


class Inputs:
    """What a device and an analyser tell, one sample and one model after another.

    Args:
        scene: whose.
    """

    def __init__(self, scene: Any) -> None:
        simulator = Simulator(scene)
        self._analyser = Analyser(simulator.mechanism, scene.operational_points[0].name)
        state = simulator.initial_state()
        self._writer = OperationalModelWriter(self._analyser, PastRates(0, MS, state.v.size))
        self._state, self._grasps = state, flat_grasps(scene)
        self._device = FlatArray(DeviceStateMessage.layout)
        self._model = FlatArray(OperationalModelMessage.layout)
        self._rng, self._tick = np.random.default_rng(2), 0
        self.stamp_ns, self.round_trip = time.time_ns(), 0.0

    def next(self, late: int = 0) -> tuple[bytes, bytes]:
        """Return a sample and a model that is ``late`` periods older."""
        self._tick += 1
        self.stamp_ns += MS
        # Slowly to and fro, and pushed.
        phase = 0.01 * self._tick
        position, quaternion = (0.001 * np.sin(phase), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
        twist, push = (0.01 * np.cos(phase), *[0.0] * 5), 0.1 * self._rng.normal(size=6)
        sample = np.concatenate((position, quaternion, twist, push))
        device = DeviceStateMessage.of(self.stamp_ns, sample=sample, obeys=True)
        device.round_trip = self.round_trip
        state = self._state
        told = WireState(
            self.stamp_ns - late * MS,
            *(state.active, state.q, 0.01 * self._rng.normal(size=state.v.size)),
            *(np.zeros((1, 6)), self._grasps, (True,)),
        )
        self._writer.evaluate(told)
        return self._device.encode(device.values), self._model.encode(self._writer.message.values)


def begin_rendering(begun: Callable[..., Process], gains: str) -> Process:
    peers = (DEVICE_COMMANDS, DEVICE_STATES), ("", MODELS), (COMMANDS, ""), (gains, "")
    process = begun(TeleoperationController, *peers)
    # Samples are a millisecond apart by their stamps, whenever they come.
    process.actor.age_limit_ns = process.actor.timeout_ns = 1 << 62
    return process


def begin_inputs(process: Process) -> Inputs:
    """Return what a controller answers by a kernel from now on."""
    inputs = Inputs(process.actor.scene)
    process.settle(lambda: render(process, inputs))
    process.go(20 * MS)
    return inputs


def render(process: Process, inputs: Inputs) -> None:
    """Send the next sample, and the model for it before."""
    device, analyser, *_ = process.peers
    sample, model = inputs.next()
    analyser.speak(model)
    device.speak(sample)


def render_one(process: Process, inputs: Inputs) -> None:
    """Send the next sample, and wait until it is answered."""
    answers = process.actor._outputs.answers
    render(process, inputs)
    process.until(lambda: process.actor._outputs.answers > answers)


@pytest.fixture(params=[GAINS, ""], ids=["gains are read", "gains are not read"])
def controller(begun: Callable[..., Process], request: pytest.FixtureRequest) -> Process:
    return begin_rendering(begun, request.param)


@pytest.fixture
def inputs(controller: Process) -> Inputs:
    return begin_inputs(controller)


def remembered(actor: Any) -> list[tuple[Any, str, Any]]:
    """Return what a controller remembers from one sample to the next: whose, its name, and it."""
    whose = (
        (actor, "_last_ns", "_state_ns", "_rendered_ns", "_command_stamps"),
        (actor._outputs, "answers", "gain_from_ns"),
        (actor.path, "last", "round_trip"),
        (actor.motion, "stamp_ns"),
        (actor._device_pauses, "_via", "_count", "_stamp_ns"),
        (actor._model_pauses, "_via", "_count", "_stamp_ns"),
        (actor._model, "value", "stamp_ns"),
        (actor.side, "last"),
    )
    return [(one, name, getattr(one, name)) for one, *names in whose for name in names]


def arrays_of(actor: Any) -> list[Any]:
    """Return the arrays in which it remembers the rest."""
    side = actor.side
    return [side.account.values, side.queue, side.past, actor.motion.numbers.values]


@pytest.mark.parametrize("late", [0, 1, 3])
def test_samples_are_answered_as_python_answers_them(
    controller: Process, inputs: Inputs, monkeypatch: pytest.MonkeyPatch, late: int
) -> None:
    actor, (device, analyser, mechanism, local) = controller.actor, controller.peers
    plain, kept = [inputs.next(late) for _ in range(40)], remembered(actor)
    for peer in controller.peers:
        peer.answers()
    found, ended, outside = [], [], controller.host.carried[GAINS.split()[0]]
    arrays = partial(arrays_of, actor)
    for by_kernel, _ in by_kernel_and_by_python(controller, monkeypatch, kept, arrays):
        outside.clear()
        to_device, to_mechanism, gains, done = [], [], [], actor._outputs.answers
        for sample, model in plain:
            received = actor._model_pauses.looked_ns
            analyser.speak(model)
            if not by_kernel:
                controller.until(
                    lambda received=received: actor._model_pauses.looked_ns != received
                )
            device.speak(sample)
            done += 1
            to_device += controller.until(lambda done=done: actor._outputs.answers == done)
            to_mechanism += mechanism.answers()
            gains += local.answers()
        to_device += device.answers()
        to_mechanism += mechanism.answers()
        # Who is not on the lane reads them as well.
        gains += local.answers() if local.received else outside
        found.append((to_device, to_mechanism, gains))
        ended.append([one.copy() for one in arrays_of(actor)])
    assert len(found[0][0]) == len(found[0][1]) == len(plain)
    # At 100 Hz.
    assert len(found[0][2]) == 4
    assert found[0] == found[1]
    for by_kernel, by_python in zip(*ended, strict=True):
        assert by_kernel.tobytes() == by_python.tobytes()


def test_after_a_senders_pause_each_message_is_answered_and_the_pause_is_known(
    controller: Process, inputs: Inputs, monkeypatch: pytest.MonkeyPatch
) -> None:
    actor = controller.actor
    answered, noted, link = actor.answered, list[tuple[Any, Any]](), controller.wait.link

    def note(*given: Any) -> None:
        noted.append((link.of_device.pauses.each(), link.of_analyser.pauses.each()))
        answered(*given)

    def has_just_told_gains() -> bool:
        render_one(controller, inputs)
        return bool(actor._outputs.gain_from_ns >= inputs.stamp_ns + 8 * MS)

    controller.until(has_just_told_gains)
    monkeypatch.setattr(actor, "answered", note)
    answers = actor._outputs.answers
    inputs.stamp_ns += 5 * MS
    for _ in range(2):
        render(controller, inputs)
    controller.until(lambda: actor._outputs.answers == answers + 2)
    after = [[inputs.stamp_ns - MS, 5 * MS]]
    assert (after, after) in noted
    for sender in (actor._device_pauses, actor._model_pauses):
        assert sender.within(1000 * MS) == (5 * MS, 5 * MS)


def test_a_round_trip_that_changes_no_gains_needs_no_python(
    controller: Process, inputs: Inputs, monkeypatch: pytest.MonkeyPatch
) -> None:
    actor = controller.actor
    codes, tolerated = by_the_kernel(controller, monkeypatch), 2e-3

    def answer(round_trip: float) -> None:
        inputs.round_trip = round_trip
        render_one(controller, inputs)

    answer(1e-4)
    codes.clear()
    for number in range(20):
        answer(tolerated * (number % 10 + 1) / 11)
        assert actor.path.round_trip == inputs.round_trip
    # Now and then for the lane itself.
    assert codes.count(lane_kernels.TO_READ) < 10
    codes.clear()
    answer(0.1)
    assert lane_kernels.TO_READ in codes
    assert actor.path.round_trip == 0.1
    assert actor._control.aim[1] == pytest.approx(0.05)


POSES, AT_ORIGIN = "/device/measured_cp PoseStamped", (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def test_what_a_device_says_beside_its_samples_needs_no_python(
    controller: Process, inputs: Inputs, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The controller reads CRTK's topics of drivers that have no samples; others publish both."""
    actor, (device, analyser, *_) = controller.actor, controller.peers
    (sources,) = (who for topic, who in actor._crtk.streams if topic == POSES)
    # Python looks for a device that is silent.
    actor.timeout_ns = 10_000 * MS
    numbers = iter(range(1, 1000))

    def speak(both: bool = False) -> None:
        """Send a sample, and a pose before it, which the middleware may bring too."""
        done, (sample, model) = actor._outputs.answers, inputs.next()
        analyser.speak(model)
        pose = encode_pose(AT_ORIGIN, next(numbers))
        device.lane.send(POSES, 7, int(both), pose, both)
        device.speak(sample)
        controller.until(lambda: actor._outputs.answers > done)

    # Python has to know the publisher first.
    speak()
    sent = sources.latest.sent
    codes = by_the_kernel(controller, monkeypatch)
    for _ in range(20):
        speak()
    # Now and then for the lane itself.
    assert codes.count(lane_kernels.TO_READ) < 10
    codes.clear()
    assert sources.latest.sent == sent + 20
    assert sources.latest.number == 0
    assert not first_fault(actor._single, controller.host.now_ns())
    # The copy is known by the message's bytes.
    speak(both=True)
    assert lane_kernels.TO_READ in codes
    assert sources.latest.number == 1
    # Somebody else who says where the device is.
    analyser.lane.send(POSES, 7, 0, encode_pose(AT_ORIGIN, next(numbers)), False)

    def noticed() -> bool:
        # At the latest before a sample is answered.
        device.speak(inputs.next()[0])
        return bool(first_fault(actor._single, controller.host.now_ns()))

    controller.until(noticed)


def begin_driving(begun: Callable[..., Process], *peers: tuple[str, str], **given: Any) -> Process:
    process = begun(HapticDevice, *(peers or [(DEVICE_STATES, DEVICE_COMMANDS)]), **given)
    # Whatever else runs here.
    process.actor.timeout_ns = 10_000 * MS
    # As many as a kernel makes up for at once.
    process.actor.backlog.per_tick = lane_kernels.MOST_MISSED + 1
    return process


@pytest.fixture
def driven(begun: Callable[..., Process]) -> Process:
    return begin_driving(begun)


class Logged:
    """What happens to a driver, in order: names, arguments, and the time, ns."""

    def __init__(self, process: Process) -> None:
        self.events: list[tuple[str, tuple[Any, ...], int]] = []
        self._taken: list[tuple[str, tuple[Any, ...], int]] = []
        self.by_kernel = self.gains_by_kernel = 0
        # Samples of another hand, and H.
        self.hands_by_kernel = self.couplings_by_kernel = 0
        self._process = process
        self._note_others()
        actor, note = process.actor, self.events.append
        tick, obey, take, moved = actor.tick, actor._obey, actor.loop.take, actor.moved
        took = actor.loop.took
        couple, measured = actor.loop.take_coupling, actor.loop.others.measured

        def ticked(periods: int, deadline_ns: int) -> None:
            self._note_others()
            note(("tick", (periods, deadline_ns), process.host.now_ns()))
            tick(periods, deadline_ns)

        def obeyed(form: Any, wrench: Any, stamp_ns: int, now_ns: int) -> None:
            note(("_obey", (form, wrench.copy(), stamp_ns, now_ns), now_ns))
            obey(form, wrench, stamp_ns, now_ns)

        def taken(values: Any, now_ns: int, *rest: Any) -> None:
            note(("take", (values.copy(), now_ns, *rest), now_ns))
            take(values, now_ns, *rest)

        def coupled(found: Any, now_ns: int, *rest: Any) -> None:
            note(("take_coupling", (found, now_ns, *rest), now_ns))
            couple(found, now_ns, *rest)
            self._seen = self._others()

        def told(name: str, wrench: Any, stamp_ns: int) -> None:
            note(("measured", (name, wrench.copy(), stamp_ns), process.host.now_ns()))
            measured(name, wrench, stamp_ns)
            self._seen = self._others()

        def kernel_moved(link: Any, commands: Any, *rest: Any) -> None:
            # They come with a command, before which they are sent.
            self._note_others()
            # A command ends the run, with the step before which it was read.
            steps, received = link.done, link.port.received
            last = link.next - actor.period_ns
            self.by_kernel += steps
            taken, self._taken = self._taken, []
            published, periods = set(actor.loop.stamps.tolist()), 1
            for deadline in range(last - (steps - 1) * actor.period_ns, last, actor.period_ns):
                # What was late is made up for in one with the next.
                if deadline // 1000 in published:
                    note(("tick", (periods, deadline), deadline))
                    periods = 0
                periods += 1
            if received != actor._command.stamp_ns:
                given = DEVICE_COMMAND, commands[0].copy(), link.answered, received
                taken.append(("_obey", given, received))
            self.events += taken
            if steps:
                note(("tick", (periods, last), last))
            moved(link, commands, *rest)

        def kernel_took(model: Any, taken_ns: int, newest: tuple[int, int]) -> None:
            self.gains_by_kernel += 1
            energy = float(actor.loop.energies[0])
            gain = LocalFeedbackGain.answering(newest[0], newest[0], energy, model)
            given = gain.values, newest[1], False, actor.age_limit_ns
            self._taken.append(("take", given, newest[1]))
            took(model, taken_ns, newest)

        actor.tick, actor._obey, actor.loop.take = ticked, obeyed, taken
        actor.moved, actor.loop.took = kernel_moved, kernel_took
        actor.loop.take_coupling, actor.loop.others.measured = coupled, told
        process.wait.ages = np.zeros(1, dtype=np.int64)

    def _others(self) -> tuple[int, int]:
        """Return when H came, and how many samples of the other hand did."""
        data = self._process.actor.loop.others.data
        return data.notes.coupled, int(data.counts.sum())

    def _note_others(self) -> None:
        """Note what the kernel has received of the other hand."""
        before, self._seen = getattr(self, "_seen", self._others()), self._others()
        others, now_ns = self._process.actor.loop.others, self._process.host.now_ns()
        for number in range(before[1], self._seen[1]):
            row = number % REMEMBERED
            sample = others.data.wrenches[row].copy(), int(others.data.stamps[0, row])
            self.events.append(("measured", (others.names[0], *sample), now_ns))
            self.hands_by_kernel += 1
        if self._seen[0] > before[0]:
            came = self._seen[0]
            gains = {others.names[0]: others.data.gains[0].reshape(6, 6).copy()}
            found = CouplingMatrices(came, gains if others.data.holding[0] else {})
            self.events.append(("take_coupling", (found, came, False), came))
            self.couplings_by_kernel += 1

    def replayed(self, scene: str, **given: str) -> dict[int, bytes]:
        """Return what a driver publishes by Python alone, to which the same happens; by stamp."""
        found: dict[int, bytes] = {}
        graph = SimpleNamespace(
            exchange=Exchange(),
            deliver=lambda: None,
            namespace=self._process.host.graph.namespace,
            now_ns=0,
            pushing=(),
        )
        graph.subscriptions = defaultdict(list)
        graph.sent = lambda topic, kind, message: (
            found.update({stamp_in(message): message})
            if topic.endswith(DEVICE_STATES.split()[0])
            else 0
        )
        host = Host(graph, HapticDevice.name)
        graph.now_ns = self.events[0][2]
        parameters = HapticDevice.parameters_type(scene=scene, **given)
        self.replaying = host.actor = actor = HapticDevice(host, parameters)
        actor.timeout_ns = 10_000 * MS
        actor.backlog.per_tick = lane_kernels.MOST_MISSED + 1
        host.begin()
        loop = actor.loop
        whose = {"take": loop, "take_coupling": loop, "measured": loop.others}
        for name, arguments, graph.now_ns in self.events:
            getattr(whose.get(name, actor), name)(*arguments)
        return found


def place_of(field: str) -> slice:
    """Return where a number is in the bytes of a device's sample."""
    at = len(FlatArray(DeviceStateMessage.layout).prefix) + 8 * DeviceStateMessage.layout.start(
        field
    )
    return slice(at, at + 8)


ROUND_TRIP = place_of("round_trip")


def stamp_in(message: bytes) -> int:
    return read(DeviceStateMessage, FlatArray(DeviceStateMessage.layout).decode(message)).stamp_ns


def check_as_pythons(got: list[bytes], expected: dict[int, bytes]) -> None:
    """Check a device's samples against Python's, by stamp."""
    # A round trip that has changed is reported from the next sample on.
    order = sorted(expected)
    for one in got:
        at = order.index(stamp_in(one))
        assert one[ROUND_TRIP] in {
            expected[stamp][ROUND_TRIP] for stamp in order[max(at - 1, 0) : at + 1]
        }
        as_python = bytearray(expected[stamp_in(one)])
        as_python[ROUND_TRIP] = one[ROUND_TRIP]
        assert as_python == one


def test_the_device_moves_as_pythons_does(driven: Process, monkeypatch: pytest.MonkeyPatch) -> None:
    actor, (peer,), rng = driven.actor, driven.peers, np.random.default_rng(3)
    log, got, newest = Logged(driven), [], 0
    missed = made_up_by_the_kernel(actor, monkeypatch)
    encoder, told = FlatArray(LocalFeedbackGain.layout), 0
    end = time.monotonic() + 20.0
    while log.by_kernel < 300:
        assert time.monotonic() < end
        driven.go(MS // 2)
        got += driven.answers()
        if got and (stamp := stamp_in(got[-1])) != newest:
            newest, told = stamp, told + 1
            # Of two commands that the kernel reads at once only one is logged: one by one.
            if any(one.bytes_waiting() for one in driven.exchange.lane._incoming.values()):
                driven.exchange.collect(whole=True)
                driven.exchange.deliver()
            if told % 25 == 0:
                # Late by some periods, as after something else that took so long.
                time.sleep(0.0035)
            if told % 20 == 0:
                model = np.repeat((0.05, 2.0, 0.2), 36) * rng.normal(size=108)
                gain = LocalFeedbackGain.answering(stamp, stamp, 1e-6 * told, model)
                peer.lane.send(GAINS, 2, 0, encoder.encode(gain.values), False)
            wrench = np.array((0.5, 0.5, 0.0, 0.0, 0.0, 0.02)) * rng.normal(size=6)
            peer.speak(encode_wrench(wrench, stamp))
    expected = log.replayed("five_bar")
    assert log.by_kernel >= 300
    assert log.gains_by_kernel >= 5
    assert sum(missed) >= 5
    check_as_pythons(got, expected)
    sample = read(DeviceStateMessage, FlatArray(DeviceStateMessage.layout).decode(got[-1]))
    assert sample.round_trip > 0.0
    assert np.linalg.norm(sample.sample.twist) > 1e-4
    assert actor.ages.count > 100


@pytest.mark.parametrize("spoil", [nan, old])
def test_a_gain_that_breaks_a_rule_is_refused_once_and_named(
    driven: Process, spoil: Callable[[Any], None]
) -> None:
    (peer,), log, encoder = driven.peers, Logged(driven), FlatArray(LocalFeedbackGain.layout)

    def answer(spoil: Callable[[Any], None] | None = None) -> None:
        driven.go(MS // 2)
        for stamp in [stamp_in(message) for message in driven.answers()[-1:]]:
            gain = LocalFeedbackGain.answering(stamp, stamp, 0.0, np.zeros(108)).values
            if spoil is not None:
                spoil(gain)
            peer.lane.send(GAINS, 2, 0, encoder.prefix + gain.tobytes(), False)
            peer.speak(encode_wrench(np.zeros(6), stamp))

    at_last(lambda: log.gains_by_kernel > 5, answer)
    refused, taken = driven.host.refused, driven.actor.loop.energies.copy()
    at_last(lambda: driven.host.refused > refused, partial(answer, spoil))
    assert driven.host.last_refusal.startswith("device/local_feedback_gain: ")
    assert driven.actor.loop.energies.tolist() == taken.tolist()
    before = log.gains_by_kernel
    at_last(lambda: log.gains_by_kernel > before, answer)


class Beside:
    """What left's device hears of its controller and of right's, whose hand holds on too.

    Args:
        begun: begins its process.
    """

    def __init__(self, begun: Callable[..., Process]) -> None:
        place = {"namespace": "/left", "operational_point": "left"}
        peers = (LEFT_STATES, LEFT_COMMANDS), ("", RIGHT_STATES)
        self.process = begin_driving(begun, *peers, scene="two_users", **place)
        self.log, self._rng = Logged(self.process), np.random.default_rng(4)
        self._wire = CouplingWire(["right"], self.process.actor.limits)
        self._gain = FlatArray(LocalFeedbackGain.layout)
        self.got: list[bytes] = []
        self.told = 0

    def sample(self, stamp_ns: int, spoil: Callable[[Any], None] | None = None) -> bytes:
        """Return right's sample with another wrench of its hand; ``spoil`` changes its numbers."""
        at_rest = np.zeros(3), (0.0, 0.0, 0.0, 1.0), np.zeros(6)
        sample = np.concatenate((*at_rest, self._rng.normal(size=6)))
        values = DeviceStateMessage.of(stamp_ns, sample=sample).values
        if spoil is not None:
            spoil(values)
        return FlatArray(DeviceStateMessage.layout).prefix + values.tobytes()

    def answer(
        self, coupled: bool = True, samples: Callable[[int], list[bytes]] | None = None
    ) -> None:
        """Let the device go on for a while, and answer its newest sample, if that is new.

        Args:
            coupled: whether it is told H, from time to time.
            samples: returns right's of a stamp, ns; one if left out.
        """
        process, newest = self.process, stamp_in(self.got[-1]) if self.got else 0
        process.go(MS // 2)
        self.got += process.answers()
        stamp = stamp_in(self.got[-1]) if self.got else 0
        if stamp == newest:
            return
        if any(one.bytes_waiting() for one in process.exchange.lane._incoming.values()):
            process.exchange.collect(whole=True)
            process.exchange.deliver()
        self.told += 1
        (controller, right), rng = process.peers, self._rng
        for message in [self.sample(stamp)] if samples is None else samples(stamp):
            right.speak(message)
        if self.told % 20 == 0:
            model = np.repeat((0.05, 2.0, 0.2), 36) * rng.normal(size=108)
            gain = LocalFeedbackGain.answering(stamp, stamp, 1e-6 * self.told, model)
            controller.lane.send(LEFT_GAINS, 2, 0, self._gain.encode(gain.values), False)
        if coupled and self.told % 15 == 0:
            matrix = 0.1 * rng.normal(size=(6, 6))
            found = CouplingMatrices(stamp, {"right": matrix} if self.told % 75 else {})
            controller.lane.send(COUPLINGS, 3, 0, self._wire.encode(found), False)
        wrench = np.array((0.5, 0.5, 0.0, 0.0, 0.0, 0.02)) * rng.normal(size=6)
        controller.speak(encode_wrench(wrench, stamp))

    def until(self, happened: Callable[[], object], **given: Any) -> None:
        """Answer until something has happened."""
        at_last(happened, partial(self.answer, **given))


@pytest.fixture
def beside(begun: Callable[..., Process]) -> Beside:
    return Beside(begun)


def test_the_device_corrects_for_another_hand_as_pythons_does(beside: Beside) -> None:
    log, notes = beside.log, beside.process.actor.loop.others.data.notes

    def some(stamp: int) -> list[bytes]:
        """Return right's sample, or none, or twice, or one that is late."""
        late = 3 * MS if beside.told % 11 == 0 else 0
        message = beside.sample(stamp - late)
        return [message] * (2 if beside.told % 5 == 0 else int(beside.told % 7 != 0))

    # The hand is silent for longer than its samples are used.
    for samples in (some, lambda _: [], some, lambda _: []):
        done = log.by_kernel
        beside.until(lambda done=done: log.by_kernel > done + 150, samples=samples)
    assert min(notes.corrected, notes.uncorrected) > 100
    beside.process.exchange.settle()
    expected = log.replayed("two_users", operational_point="left")
    assert log.hands_by_kernel > 150
    assert log.couplings_by_kernel > 10
    check_as_pythons(beside.got, expected)
    replayed = log.replaying.loop.others.data.notes
    assert (replayed.corrected, replayed.uncorrected) == (notes.corrected, notes.uncorrected)


def test_what_an_old_message_says_of_another_hand_is_used_no_more(beside: Beside) -> None:
    log, notes = beside.log, beside.process.actor.loop.others.data.notes

    def corrected(steps: int, **given: Any) -> tuple[int, int]:
        """Return how many commands were corrected in so many steps, and how many not."""
        begun, before = log.by_kernel, (notes.corrected, notes.uncorrected)
        beside.until(lambda: log.by_kernel >= begun + steps, **given)
        beside.process.exchange.settle()
        return notes.corrected - before[0], notes.uncorrected - before[1]

    beside.until(lambda: beside.told % 75 == 20 and notes.corrected > 50)
    still, no_more = corrected(300, coupled=False)
    # H of up to 15 periods ago.
    fresh = FRESH_NS // MS
    assert fresh - 30 < still < fresh + 10
    assert no_more > 300 - fresh - 10
    assert corrected(200)[0] > 100


@pytest.mark.parametrize("spoil", [nan, old])
def test_a_sample_of_another_hand_that_breaks_a_rule_is_refused_once_and_named(
    beside: Beside, spoil: Callable[[Any], None]
) -> None:
    host, log = beside.process.host, beside.log
    beside.until(lambda: log.hands_by_kernel > 5)
    refused, counts, told = host.refused, beside.process.actor.loop.others.data.counts, beside.told
    beside.until(lambda: beside.told > told + 3, samples=lambda _: [])
    before = int(counts[0])
    beside.until(
        lambda: host.refused > refused, samples=lambda stamp: [beside.sample(stamp, spoil)]
    )
    assert host.last_refusal.startswith("/right/device/state: ")
    assert counts[0] == before
    by_kernel = log.hands_by_kernel
    beside.until(lambda: log.hands_by_kernel > by_kernel + 5)


def test_two_devices_of_another_hand_leave_the_device_to_python_without_correction(
    begun: Callable[..., Process], beside: Beside, folder: Path
) -> None:
    actor, log, stranger = beside.process.actor, beside.log, Peer(folder, "", RIGHT_STATES)
    try:
        notes = actor.loop.others.data.notes
        beside.until(lambda: log.hands_by_kernel > 5 and notes.corrected > 5)
        for _ in range(2):
            beside.process.peers.append(stranger)
            beside.process.meet()
            beside.process.peers.remove(stranger)
            stranger.speak(beside.sample(time.time_ns()))
            beside.until(lambda: actor.users.fault(actor.now_ns()))
            steps, corrected = log.by_kernel, notes.corrected
            told = beside.told
            beside.until(lambda told=told: beside.told > told + 100)
            assert log.by_kernel == steps
            assert notes.corrected == corrected
            assert actor.answers.obeys
            # Until it has been silent for a while.
            beside.until(lambda corrected=corrected: notes.corrected > corrected + 50)
            assert log.by_kernel > steps
        warnings = [line for line in beside.process.host.log.lines if line[0] == "warning"]
        assert sum("no correction for other hands" in text for _, text in warnings) == 2
    finally:
        stranger.lane.close()


def test_a_loop_that_is_opened_is_announced(moving: Process) -> None:
    actor = moving.actor
    moving.settle(lambda: command(moving, np.zeros(6)))
    moving.until(lambda: actor.steps_plainly)
    actor._switch("ground_pin", False)
    # By Python: nothing else says so.
    assert not actor.steps_plainly
    moving.until(lambda: actor.steps_plainly)
    assert actor._announced == actor.state.active == (False,)


def test_a_device_that_moves_faster_than_it_can_be_moved_is_left_to_python(
    begun: Callable[..., Process], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A step that is late here is Python's, which says so by itself: then once more."""
    for attempt in range(5):
        place = folder / str(attempt)
        place.mkdir(mode=0o700)
        process = begin_driving(begun, place=place)
        actor, (peer,) = process.actor, process.peers
        codes, log = by_the_kernel(process, monkeypatch), Logged(process)
        # The kernel does several steps; all but the last one were well.
        process.wait.ages = np.zeros(8, dtype=np.int64)
        end = time.monotonic() + 20.0
        while not actor.failures.count:
            assert time.monotonic() < end
            if log.by_kernel > 20:
                # Faster than it is now: some steps later.
                speed = 1.01 * float(np.linalg.norm(actor._state.measured_twist[:3]))
                actor.fastest[:] = min(actor.fastest[0], speed + 2e-3), 100.0
            process.go(20 * MS if log.by_kernel > 20 else MS // 2)
            for got in process.answers()[-1:]:
                peer.speak(encode_wrench(np.array((0.5, 0.0, 0.0, 0.0, 0.0, 0.0)), stamp_in(got)))
        assert "must not exceed device.motion" in actor.failures.last
        # To a state that may be published.
        assert actor.failures.count == 1
        assert actor.node.active
        gone_back_to = actor._last_valid._good.measured_twist[:3]
        assert np.linalg.norm(gone_back_to) <= actor.fastest[0]
        if lane_kernels.TO_SAY in codes:
            return
    pytest.fail("no step was the kernel's")


def numbers_of(argument: Any) -> Iterator[Any]:
    """Yield the arrays of a kernel's argument."""
    if isinstance(argument, np.ndarray):
        yield argument
    elif isinstance(argument, Record):
        yield argument.values
    elif isinstance(argument, Structure):
        yield from (argument.numbers, argument.data)


@pytest.fixture(params=NODES)
def node_and_message(
    begun: Callable[..., Process], request: pytest.FixtureRequest
) -> tuple[Process, Callable[[], None]]:
    """Return a node's process, and what sends it its next message."""
    if request.param == "nullspace_analyser":
        process, states = map(request.getfixturevalue, ("analyser", "states"))
        return process, lambda: process.speak(states.next())
    if request.param == "teleoperation_controller":
        process = begin_rendering(begun, GAINS)
        inputs = begin_inputs(process)
        return process, lambda: render(process, inputs)
    name = "driven" if request.param == "haptic_device" else "moving"
    process = request.getfixturevalue(name)
    return process, lambda: command(process)


def test_a_view_uses_nothing_that_a_kernel_works_in(
    node_and_message: tuple[Process, Callable[[], None]], monkeypatch: pytest.MonkeyPatch
) -> None:
    process, send = node_and_message
    process.settle(send)
    # Its last run has read a message, after which there is something to see.
    while not process.wait.link.reads:
        send()
        process.go(2 * MS)
    process.exchange.settle()
    published: list[tuple[int, Any]] = []

    def publish(view: Callable[[], None]) -> list[tuple[int, Any]]:
        published.clear()
        with monkeypatch.context() as patch:
            patch.setattr(Outlet, "wanted", True)
            patch.setattr(Outlet, "publish", lambda one, sent: published.append((one.number, sent)))
            view()
        return published.copy()

    at_once, later = process.wait.view(), process.wait.view()
    expected = publish(at_once)
    arguments = process.wait.kernel().args
    arrays = [one for argument in arguments for one in numbers_of(argument)]
    before = [one.tobytes() for one in arrays]
    process.exchange.lane.worked = False
    for _ in range(10):
        send()
        process.go(2 * MS)
    process.exchange.settle()
    after = [one.tobytes() for one in arrays]
    found = publish(later)
    assert len(expected) >= 2
    assert found == expected
    assert after != before
    assert after == [one.tobytes() for one in arrays]
