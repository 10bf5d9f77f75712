# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages between processes of one host: who gets them, whoever dies, stalls or lies."""

from __future__ import annotations

import contextlib
import os
import socket
import stat
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hapticmech_ros.nodes import exchange as exchange_module
from hapticmech_ros.nodes import lane as lane_module
from hapticmech_ros.nodes.exchange import CENSUS_NS, Exchange
from hapticmech_ros.nodes.lane import (
    HEADER,
    MOST_BEHIND,
    MOST_BYTES,
    Lane,
    LaneError,
    lane_folder,
)
from hapticmech_ros.nodes.sources import Batch, Origin

TOPIC = "/topic Kind"
# More messages than a socket holds.
MOST_SENT = 100_000


@pytest.fixture
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # A socket's path holds 107 bytes.
    made = tmp_path_factory.mktemp("l")
    made.chmod(0o700)
    return made


@pytest.fixture
def lanes(folder: Path) -> Iterator[list[Lane]]:
    made = [Lane(folder) for _ in range(3)]
    yield made
    for lane in made:
        lane.close()
    assert not folder.exists()


class Received(list):
    """What a listener got."""

    def __call__(self, message: bytes, origin: Origin) -> None:
        self.append((message, origin))

    __hash__ = object.__hash__

    def every(self, batch: Batch) -> None:
        self.extend(batch)

    @property
    def messages(self) -> list[bytes]:
        return [message for message, _ in self]


def meet(lanes: list[Lane], seconds: float = 5.0) -> None:
    """Let lanes find each other and tell what they hear."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for lane in lanes:
            lane._looked_ns = -lane_module.LOOK_NS
            lane.look()
            hand_on(lane)
        if all(
            len(lane._outgoing) == len(lanes) - 1 == len(lane._incoming) for lane in lanes
        ) and all(
            incoming.announced == lane._version
            for lane in lanes
            for incoming in lane._incoming.values()
        ):
            for lane in lanes:
                hand_on(lane)
            return
    raise AssertionError("lanes do not meet")


def hand_on(lane: Lane) -> None:
    for listener, message, origin in lane.collect(whole=True):
        listener(message, origin)


def send(lane: Lane, message: bytes, number: int = 0, both: bool = False, outlet: int = 1) -> None:
    lane.send(TOPIC, outlet, number, message, both)


def test_a_message_reaches_all_who_hear_its_topic_and_nobody_else(lanes: list[Lane]) -> None:
    speaks, first, second = lanes
    received, other, deaf = Received(), Received(), Received()
    first.listen(TOPIC, received)
    second.listen(TOPIC, other)
    second.listen("/topic Other", deaf)
    meet(lanes)
    assert speaks.readers(TOPIC) == 2
    assert speaks.readers("/else Kind") == 0
    send(speaks, b"a", 7)
    hand_on(first)
    hand_on(second)
    assert received.messages == other.messages == [b"a"]
    assert deaf == []
    assert received[0][1].number == 7
    assert received[0][1].via > 0


def test_who_wants_every_message_gets_it_after_those_who_answer(
    monkeypatch: pytest.MonkeyPatch, lanes: list[Lane]
) -> None:
    speaks, records, answers = lanes
    kept, received = Received(), Received()
    records.listen_to_all(TOPIC, kept.every)
    meet(lanes)
    answers.listen(TOPIC, received)
    meet(lanes)
    order = []
    plain = lane_module.Outgoing.send

    def noted(outgoing: lane_module.Outgoing, frame: bytes) -> bool:
        order.append(outgoing.wants_all)
        return plain(outgoing, frame)

    monkeypatch.setattr(lane_module.Outgoing, "send", noted)
    send(speaks, b"one")
    hand_on(records)
    hand_on(answers)
    assert order == [False, True]
    assert kept.messages == received.messages == [b"one"]


def test_origins_tell_when_messages_were_sent_and_batches_are_in_that_order(
    lanes: list[Lane],
) -> None:
    one, two, receives = lanes
    received = Received()
    receives.listen_to_all(TOPIC, received.every)
    meet(lanes)
    times = [time.time_ns()]
    for number in range(6):
        send((one, two)[number % 2], bytes([number]))
        times.append(time.time_ns())
    # Long after, and from two processes.
    hand_on(receives)
    assert received.messages == [bytes([number]) for number in range(6)]
    for (_, origin), before, after in zip(received, times[:-1], times[1:], strict=True):
        assert before <= origin.sent_ns <= after


KILLED = """
    import sys, time
    from pathlib import Path
    from hapticmech_ros.nodes.lane import Lane
    lane = Lane(Path(sys.argv[1]))
    lane.listen("/topic Kind", lambda message, origin: None)
    print("ready", flush=True)
    while True:
        lane.look()
        lane.collect(0.01)
        lane.send("/back Kind", 1, 0, b"x" * 500, False)
"""


@contextlib.contextmanager
def process(folder: Path, program: str = KILLED) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", textwrap.dedent(program), str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as made:
        try:
            assert made.stdout is not None
            assert made.stdout.readline() == "ready\n"
            yield made
        finally:
            made.kill()


NEVER_PAUSES = """
    import sys, time
    from pathlib import Path
    from hapticmech_ros.nodes.lane import Lane
    lane = Lane(Path(sys.argv[1]))
    print("ready", flush=True)
    while True:
        lane.look()
        lane.collect()
        for _ in range(1000):
            lane.send("/topic Kind", 1, 0, b"x" * 300, False)
"""


@pytest.mark.parametrize("whole", [False, True])
def test_a_writer_that_never_pauses_keeps_no_reader(
    folder: Path, monkeypatch: pytest.MonkeyPatch, whole: bool
) -> None:
    """What has come by the time of a call is taken, and no more, as slow as it may be taken."""
    reader, received, plain = Lane(folder), Received(), Received()
    reader.listen_to_all(TOPIC, received.every)
    reader.listen(TOPIC, plain)
    asked: list[int] = []
    plainly = lane_module.Incoming.bytes_waiting

    def noted(incoming: lane_module.Incoming) -> int:
        asked.append(plainly(incoming))
        return asked[-1]

    monkeypatch.setattr(lane_module.Incoming, "bytes_waiting", noted)
    with process(folder, NEVER_PAUSES):
        end = time.monotonic() + 20.0
        while len(asked) < 20:
            assert time.monotonic() < end
            reader.look()
            time.sleep(0.005)
            before, looks = len(received), len(asked)
            for listener, batch, origin in reader.collect(0.01, whole):
                listener(batch, origin)
            size = HEADER.size + 300
            assert len(asked) - looks <= 1
            assert (len(received) - before) * size <= max(sum(asked[looks:]), size)
        assert max(asked) > 10 * size
    assert plain
    reader.close()


def test_messages_of_an_outlet_are_numbered_lost_ones_included(lanes: list[Lane]) -> None:
    speaks, first, second = lanes
    early, late = Received(), Received()
    first.listen_to_all(TOPIC, early.every)
    meet(lanes)
    send(speaks, b"a")
    send(speaks, b"b", outlet=2)
    second.listen_to_all(TOPIC, late.every)
    meet(lanes)
    send(speaks, b"c", both=True)
    hand_on(first)
    hand_on(second)
    assert [(m, o.sent) for m, o in early] == [(b"a", 1), (b"b", 1), (b"c", 2)]
    assert [(m, o.sent) for m, o in late] == [(b"c", 2)]


def test_what_a_process_leaves_that_was_killed_before_it_was_ready_is_removed(
    lanes: list[Lane], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = folder / ".123-abcdef"
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as unready:
        unready.bind(str(left))
    meet(lanes)
    assert left.exists()
    monkeypatch.setattr(lane_module, "UNREADY_S", -1.0)
    lanes[0]._looked_ns = -lane_module.LOOK_NS
    lanes[0].look()
    assert not left.exists()


def test_publishers_are_told_apart_whoever_they_are(lanes: list[Lane]) -> None:
    receives, received = lanes[0], Received()
    receives.listen(TOPIC, received)
    meet(lanes)
    for lane in lanes[1:]:
        for outlet in (1, 2):
            send(lane, b"x", outlet=outlet)
    hand_on(receives)
    assert len({origin.via for _, origin in received}) == 4


def test_of_what_has_piled_up_the_latest_of_each_publisher_counts(lanes: list[Lane]) -> None:
    receives, speaks, other = lanes
    received = Received()
    receives.listen(TOPIC, received)
    meet(lanes)
    for number in range(20):
        send(speaks, b"%d" % number, number, both=number % 2 == 0)
    send(other, b"other")
    hand_on(receives)
    assert sorted(received.messages) == [b"19", b"other"]
    # Those that the middleware brings too are known, all of them.
    assert [message for _, message in receives.copied] == [b"%d" % n for n in range(0, 20, 2)]


def test_whoever_looked_a_moment_ago_takes_one_at_a_time_and_loses_none(lanes: list[Lane]) -> None:
    receives, speaks, _ = lanes
    received = Received()
    receives.listen(TOPIC, received)
    meet(lanes)
    receives._idle_ns = time.monotonic_ns() + 10**9
    for number in range(3):
        send(speaks, b"%d" % number)
    for _ in range(3):
        for listener, message, origin in receives.collect():
            listener(message, origin)
    assert received.messages == [b"0", b"1", b"2"]


def test_whoever_is_slower_than_a_publisher_has_its_newest_messages(lanes: list[Lane]) -> None:
    receives, speaks, _ = lanes
    received, behind = Received(), []
    receives.listen(TOPIC, received)
    meet(lanes)
    for number in range(0, 600, 3):
        for late in range(3):
            send(speaks, b"%d" % (number + late))
        for listener, message, origin in receives.collect():
            listener(message, origin)
        behind.append(number + 2 - int(received.messages[-1]))
        time.sleep(0.001)
    # What comes in three milliseconds, and in one round more.
    assert max(behind) <= 20


def test_who_stalls_is_not_counted_until_it_goes_on(
    lanes: list[Lane], monkeypatch: pytest.MonkeyPatch
) -> None:
    stalls, speaks, _ = lanes
    received = Received()
    stalls.listen(TOPIC, received)
    meet(lanes)
    monkeypatch.setattr(lane_module, "STALLED_NS", 0)
    for _ in range(MOST_SENT):
        if speaks.lost:
            break
        assert speaks.readers(TOPIC) == 1
        send(speaks, b"m" * 1000)
    assert speaks.lost
    send(speaks, b"m")
    assert speaks.readers(TOPIC) == 0
    hand_on(stalls)
    send(speaks, b"goes on")
    assert speaks.readers(TOPIC) == 1
    hand_on(stalls)
    assert received.messages[-1] == b"goes on"


def test_who_wants_all_gets_all_in_order_though_it_falls_behind(lanes: list[Lane]) -> None:
    receives, speaks, _ = lanes
    received, count = Received(), MOST_BEHIND
    receives.listen_to_all(TOPIC, received.every)
    meet(lanes)
    message = b"m" * 4000
    for number in range(count):
        send(speaks, message, number)
    end = time.monotonic() + 10.0
    while len(received) < count and time.monotonic() < end:
        hand_on(receives)
        speaks._looked_ns = -lane_module.LOOK_NS
        speaks.look()
    assert [origin.number for _, origin in received] == list(range(count))
    assert speaks.lost == 0


def test_who_stalls_holds_up_nobody_and_what_it_misses_is_counted(lanes: list[Lane]) -> None:
    stalls, speaks, receives = lanes
    never, received = Received(), Received()
    stalls.listen(TOPIC, never)
    receives.listen(TOPIC, received)
    meet(lanes)
    begun = time.monotonic()
    for number in range(5000):
        send(speaks, b"m" * 1000, number)
        hand_on(receives)
    assert time.monotonic() - begun < 10.0
    assert len(received) == 5000
    assert speaks.lost > 0
    hand_on(stalls)
    assert len(never) == 1


def test_a_change_of_what_is_heard_is_told(lanes: list[Lane]) -> None:
    speaks, receives, _ = lanes
    received, late = Received(), Received()
    meet(lanes)
    receives.listen(TOPIC, received)
    meet(lanes)
    send(speaks, b"a")
    receives.silence(TOPIC, received)
    # What was sent before it was told is dropped.
    hand_on(receives)
    meet(lanes)
    assert speaks.readers(TOPIC) == 0
    receives.listen(TOPIC, late)
    meet(lanes)
    send(speaks, b"b")
    hand_on(receives)
    assert received == []
    assert late.messages == [b"b"]


def test_whoever_closes_is_forgotten_and_leaves_nothing(folder: Path) -> None:
    stays, goes = Lane(folder), Lane(folder)
    goes.listen(TOPIC, Received())
    meet([stays, goes])
    assert stays.readers(TOPIC) == 1
    assert stays.linked
    goes.close()
    assert [path.name for path in folder.iterdir()] == [stays._name]
    hand_on(stays)
    assert stays.readers(TOPIC) == 0
    assert not stays.linked
    send(stays, b"to nobody")
    stays.close()
    assert not folder.exists()


def test_a_killed_process_is_noticed_at_once_and_its_socket_removed_by_others(
    folder: Path,
) -> None:
    lane = Lane(folder)
    received = Received()
    lane.listen("/back Kind", received)
    for _ in range(3):
        with process(folder) as other:
            end = time.monotonic() + 10.0
            received.clear()
            while not (lane.readers(TOPIC) == 1 and received):
                assert time.monotonic() < end
                lane.look()
                for listener, message, origin in lane.collect(0.01):
                    listener(message, origin)
            other.kill()
            other.wait()
            end = time.monotonic() + 10.0
            while lane.readers(TOPIC) or lane.linked:
                assert time.monotonic() < end
                send(lane, b"m")
                hand_on(lane)
    end = time.monotonic() + 10.0
    while len(list(folder.iterdir())) > 1:
        assert time.monotonic() < end
        lane.look()
    lane.close()
    assert not folder.exists()


def test_bytes_that_are_no_messages_harm_nobody(lanes: list[Lane], folder: Path) -> None:
    receives, received = lanes[0], Received()
    receives.listen(TOPIC, received)
    meet(lanes)
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as liar:
        liar.connect(str(folder / receives._name))
        for frame in (b"\0", b"\1", b"\1" * 16, b"\2" * 400, os.urandom(1000)):
            liar.send(frame)
        liar.send(b"\1\0\xff\xff" + bytes(12) + b"of an unknown topic")
        hand_on(receives)
        hand_on(receives)
        assert receives.refused == 5
    hand_on(receives)
    send(lanes[1], b"a")
    hand_on(receives)
    assert received.messages == [b"a"]


@pytest.mark.parametrize(
    "text",
    [
        *(b"", b"{", b"[]", b'{"version": 1, "topics": []}', b'{"version": 2}', b"\xff" * 100),
        *(b"[" * 50_000, b'{"version": Infinity}'),
        *(
            b'{"version": 2, "topics": [["/topic Kind", %s, %s, false]]}' % numbers
            for numbers in [(b"-1", b"1"), (b"65536", b"1"), (b"1", b"0"), (b"1", b"-7")]
        ),
        b'{"version": 2, "topics": [["/topic Kind", Infinity, 1, false]]}',
    ],
)
def test_a_listener_that_tells_nonsense_is_left_alone(
    lanes: list[Lane], folder: Path, text: bytes
) -> None:
    speaks = lanes[0]
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as liar:
        liar.bind(str(folder / "1-liar"))
        liar.listen()
        speaks._looked_ns = -lane_module.LOOK_NS
        speaks.look()
        links = len(speaks._outgoing)
        there, _ = liar.accept()
        there.send(bytes(HEADER.size) + text)
        hand_on(speaks)
        assert len(speaks._outgoing) == links - 1
        there.close()
        # It is not tried again.
        speaks._looked_ns = -lane_module.LOOK_NS
        speaks.look()
        assert len(speaks._outgoing) == links - 1
    (folder / "1-liar").unlink()


def test_what_is_no_socket_is_left_alone(lanes: list[Lane], folder: Path) -> None:
    (folder / "folder").mkdir()
    (folder / "file").write_bytes(b"of somebody's")
    meet(lanes)
    assert (folder / "file").read_bytes() == b"of somebody's"
    (folder / "file").unlink()
    (folder / "folder").rmdir()


def test_without_a_descriptor_left_a_newcomer_is_met_later(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lane = Lane(folder)
    other = Lane(folder)

    def none_left(*_: object) -> socket.socket:
        raise OSError(24, "Too many open files")

    with monkeypatch.context() as few:
        few.setattr(lane_module.socket, "socket", none_left)
        lane.look()
    assert not lane._outgoing
    meet([lane, other])
    lane.close()
    other.close()


def test_numbers_of_topics_begin_again(lanes: list[Lane]) -> None:
    receives, speaks, _ = lanes
    received = Received()
    receives._next_code = (1 << 16) - 1
    receives.listen("/last Kind", Received())
    receives.listen(TOPIC, received)
    meet(lanes)
    send(speaks, b"a")
    hand_on(receives)
    assert received.messages == [b"a"]


def test_connections_of_another_user_are_refused(
    lanes: list[Lane], monkeypatch: pytest.MonkeyPatch
) -> None:
    receives, speaks, _ = lanes
    receives.listen(TOPIC, Received())
    there = os.geteuid()
    monkeypatch.setattr(lane_module.os, "geteuid", lambda: there + 1)
    for lane in (speaks, receives):
        lane._looked_ns = -lane_module.LOOK_NS
        lane.look()
        hand_on(lane)
    assert speaks.refused > 0
    assert speaks.readers(TOPIC) == 0
    assert not receives.linked


class FakePublisher:
    """Counts what goes through the middleware."""

    def __init__(self, subscriptions: int) -> None:
        self.subscriptions = subscriptions
        self.sent: list[object] = []

    def publish(self, message: object) -> None:
        self.sent.append(message)

    def get_subscription_count(self) -> int:
        return self.subscriptions


@pytest.fixture
def pair(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Exchange, Exchange]]:
    made = Exchange(), Exchange()
    monkeypatch.setattr(exchange_module, "SETTLES_NS", 0)
    for exchange in made:
        exchange.lane = Lane(folder)
    yield made
    for exchange in made:
        exchange.close()


def test_the_middleware_carries_what_somebody_else_hears_and_the_copy_is_known(
    pair: tuple[Exchange, Exchange],
) -> None:
    speaks, receives = pair
    publisher, received = FakePublisher(1), Received()
    outlet = speaks.outlet(publisher, "/topic", False, "Kind")
    had = receives.listen("/topic", received, "Kind")
    outlet.publish(b"before they meet")
    assert publisher.sent == [b"before they meet"]
    meet([speaks.lane, receives.lane])
    outlet.publish(b"alone")
    assert len(publisher.sent) == 1
    assert outlet.ways() == "lane"
    publisher.subscriptions = 2
    end = time.monotonic_ns() + 2 * CENSUS_NS
    while time.monotonic_ns() < end:
        pass
    outlet.publish(b"for both")
    assert publisher.sent[1:] == [b"for both"]
    assert outlet.ways() == "lane, middleware"
    # The middleware is faster here: what went over the lane is taken first all the same.
    assert had(b"for both")
    assert received.messages[-1] == b"for both"
    assert received[-1][1].number == 2
    assert not had(b"of somebody else")


def test_while_listeners_come_and_go_the_middleware_carries_all(
    pair: tuple[Exchange, Exchange], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may not know yet of the one on the lane, but of one that only it reaches."""
    monkeypatch.setattr(exchange_module, "SETTLES_NS", 300_000_000)
    speaks, receives = pair
    publisher, received = FakePublisher(1), Received()
    outlet = speaks.outlet(publisher, "/topic", False, "Kind")
    receives.listen("/topic", received, "Kind")
    meet([speaks.lane, receives.lane])
    outlet.publish(b"a")
    assert publisher.sent == [b"a"]
    assert outlet.ways() == "lane, middleware"
    time.sleep(0.31)
    outlet.publish(b"b")
    assert publisher.sent == [b"a"]
    assert outlet.ways() == "lane"


def test_what_waits_for_the_loop_is_sent_before_the_loop_stands_alone(
    pair: tuple[Exchange, Exchange],
) -> None:
    speaks, receives = pair
    publisher = FakePublisher(1)
    outlet = speaks.outlet(publisher, "/view", False, "Kind", later=True)
    receives.listen("/other", Received(), "Kind")
    meet([speaks.lane, receives.lane])
    outlet.publish(b"a")
    assert speaks.has_later
    assert publisher.sent == []
    receives.close()
    hand_on(speaks.lane)
    assert not speaks.is_linked
    # In order, though nobody is on the lane any more.
    outlet.publish(b"b")
    speaks.publish_kept()
    assert publisher.sent == [b"a", b"b"]


def test_a_copy_that_comes_much_later_is_somebody_elses(
    pair: tuple[Exchange, Exchange], monkeypatch: pytest.MonkeyPatch
) -> None:
    speaks, receives = pair
    outlet = speaks.outlet(FakePublisher(2), "/topic", False, "Kind")
    had = receives.listen("/topic", Received(), "Kind")
    meet([speaks.lane, receives.lane])
    outlet.publish(b"the same")
    assert had(b"the same")
    monkeypatch.setattr(exchange_module, "UNDERWAY_NS", 0)
    assert not had(b"the same")


def test_a_message_too_long_for_the_lane_goes_through_the_middleware(
    pair: tuple[Exchange, Exchange],
) -> None:
    speaks, receives = pair
    publisher, received = FakePublisher(1), Received()
    outlet = speaks.outlet(publisher, "/topic", False, "Kind")
    receives.listen("/topic", received, "Kind")
    meet([speaks.lane, receives.lane])
    outlet.publish(b"m" * MOST_BYTES)
    outlet.publish(b"m" * (MOST_BYTES + 1))
    receives.collect()
    receives.deliver()
    assert [len(message) for message in received.messages] == [MOST_BYTES]
    assert [len(message) for message in publisher.sent] == [MOST_BYTES + 1]


def test_what_stays_and_what_has_no_kind_keeps_off_the_lane(
    pair: tuple[Exchange, Exchange],
) -> None:
    speaks, receives = pair
    receives.listen("/topic", Received(), "Kind")
    meet([speaks.lane, receives.lane])
    for stays, kind in ((True, "Kind"), (False, "")):
        publisher = FakePublisher(1)
        speaks.outlet(publisher, "/topic", stays, kind).publish(b"a")
        assert publisher.sent == [b"a"]


def test_graphs_that_the_middleware_keeps_apart_have_folders_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tmp_path.chmod(0o700)
    base = {"XDG_RUNTIME_DIR": str(tmp_path)}
    plain = lane_folder(base)
    assert plain == lane_folder({**base, "ROS_DOMAIN_ID": "0", "HOME": "/else"})
    assert plain.is_relative_to(tmp_path)
    assert stat.S_IMODE(plain.stat().st_mode) == stat.S_IMODE(plain.parent.stat().st_mode) == 0o700
    others = [
        {"ROS_DOMAIN_ID": "7"},
        {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"},
        {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"},
        {"ROS_STATIC_PEERS": "10.0.0.1"},
    ]
    assert len({lane_folder({**base, **other}) for other in others} | {plain}) == 5
    monkeypatch.setattr(Path, "readlink", lambda self: Path("net:[1]"))
    assert lane_folder(base) != plain


@pytest.mark.parametrize("mode", [0o755, 0o770, 0o701])
def test_a_folder_that_others_reach_is_refused(tmp_path: Path, mode: int) -> None:
    tmp_path.chmod(0o700)
    open_to_others = tmp_path / f"hapticmech_ros-{os.geteuid()}"
    open_to_others.mkdir()
    open_to_others.chmod(mode)
    with pytest.raises(LaneError, match="must be a folder of mode 0700 of this user"):
        Lane.open({"XDG_RUNTIME_DIR": str(tmp_path)})
    exchange = Exchange()
    exchange.join_lane({"XDG_RUNTIME_DIR": str(tmp_path)})
    assert exchange.lane is None
    assert str(open_to_others) in exchange.refusal


def test_graphs_with_security_leave_it_to_the_middleware(tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    base = {"XDG_RUNTIME_DIR": str(tmp_path)}
    with pytest.raises(LaneError, match="ROS_SECURITY_ENABLE is true"):
        lane_folder({**base, "ROS_SECURITY_ENABLE": "true"})
    assert not list(tmp_path.iterdir())
    assert lane_folder({**base, "ROS_SECURITY_ENABLE": "false"}).exists()


def test_a_link_in_the_folders_place_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    there = tmp_path / "there"
    there.mkdir(mode=0o700)
    (tmp_path / f"hapticmech_ros-{os.geteuid()}").symlink_to(there)
    with pytest.raises(LaneError):
        Lane.open({"XDG_RUNTIME_DIR": str(tmp_path)})


def test_a_runtime_folder_of_somebody_else_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    for runtime in ("/", "/proc", str(tmp_path / "nowhere"), ""):
        assert lane_folder({"XDG_RUNTIME_DIR": runtime}).is_relative_to(tmp_path)


def test_a_path_too_long_for_a_socket_is_refused_in_a_sentence(tmp_path: Path) -> None:
    deep = tmp_path / ("d" * 100)
    deep.mkdir(mode=0o700)
    with pytest.raises(LaneError, match="no socket for the lane"):
        Lane.open({"XDG_RUNTIME_DIR": str(deep)})
