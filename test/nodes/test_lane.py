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
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

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
from nodes.stand_ins import Publisher, at_last

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


@pytest.fixture
def received(lanes: list[Lane]) -> Received:
    """What the first lane hears on the topic, once all have met."""
    return heard(lanes[0], lanes)


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


def heard(lane: Lane, lanes: list[Lane], every: bool = False) -> Received:
    """Return what a lane hears on the topic from now on, once all know that it does."""
    found = Received()
    if every:
        lane.listen_to_all(TOPIC, found.every)
    else:
        lane.listen(TOPIC, found)
    meet(lanes)
    return found


def meet(lanes: list[Lane]) -> None:
    """Let lanes find each other and tell what they hear."""

    def have_met() -> bool:
        return all(
            len(lane._outgoing) == len(lanes) - 1 == len(lane._incoming)
            and all(one.announced == lane._version for one in lane._incoming.values())
            for lane in lanes
        )

    until(have_met, *lanes)
    for lane in lanes:
        hand_on(lane)


def until(condition: Callable[[], bool], *lanes: Lane) -> None:
    """Let lanes go on until a condition holds."""

    def go_on() -> None:
        for lane in lanes:
            look(lane)
            hand_on(lane)

    at_last(condition, go_on, 10.0)


def look(lane: Lane) -> None:
    """Let a lane look for others, though it has just done so."""
    lane._looked_ns = -lane_module.LOOK_NS
    lane.look()


def hand_on(lane: Lane, timeout_s: float = 0.0, whole: bool = True) -> None:
    for listener, message, origin in lane.collect(timeout_s, whole):
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
    send(speaks, b"a", 7, outlet=2)
    send(second, b"a", 7)
    hand_on(first)
    hand_on(second)
    assert received.messages == [b"a"] * 3
    assert other.messages == [b"a"] * 2
    assert deaf == []
    assert {origin.number for _, origin in received} == {7}
    # Each publisher is another one.
    assert len({origin.via for _, origin in received} - {0}) == 3


def test_who_wants_every_message_gets_it_after_those_who_answer(
    monkeypatch: pytest.MonkeyPatch, lanes: list[Lane]
) -> None:
    speaks, records, answers = lanes
    kept, received = heard(records, lanes, every=True), heard(answers, lanes)
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
    received = heard(receives, lanes, every=True)
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
            hand_on(reader, 0.01, whole)
            size = HEADER.size + 300
            assert len(asked) - looks <= 1
            assert (len(received) - before) * size <= max(sum(asked[looks:]), size)
        assert max(asked) > 10 * size
    assert plain
    reader.close()


def test_messages_of_an_outlet_are_numbered_lost_ones_included(lanes: list[Lane]) -> None:
    speaks, first, second = lanes
    early = heard(first, lanes, every=True)
    send(speaks, b"a")
    send(speaks, b"b", outlet=2)
    late = heard(second, lanes, every=True)
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
    look(lanes[0])
    assert not left.exists()


def test_of_what_has_piled_up_the_latest_of_each_publisher_counts(
    lanes: list[Lane], received: Received
) -> None:
    receives, speaks, other = lanes
    for number in range(20):
        send(speaks, b"%d" % number, number, both=number % 2 == 0)
    send(other, b"other")
    hand_on(receives)
    assert sorted(received.messages) == [b"19", b"other"]
    # Those that the middleware brings too are known, all of them.
    assert [message for _, message in receives.copied] == [b"%d" % n for n in range(0, 20, 2)]


def test_a_connection_that_another_thread_drops_is_closed_by_the_loops(
    lanes: list[Lane], received: Received, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As while a callback reads the lane, and the loop's thread is about to wait for it."""
    lane, select = lanes[0], lane_module.select.select
    connections = [one.connection for one in lane._incoming.values()]
    assert connections

    def drop() -> None:
        with lane.turn.taken():
            for one in list(lane._incoming.values()):
                lane._close_incoming(one)

    def dropping(waited: list[int], *rest: Any) -> Any:
        thread = threading.Thread(target=drop)
        thread.start()
        thread.join()
        return select(waited, *rest)

    lane.turn.share()
    monkeypatch.setattr(lane_module.select, "select", dropping)
    for _ in range(2):
        lane.collect(0.01)
    lane.turn.end()
    assert [one.fileno() for one in connections] == [-1] * len(connections)


class LongWait:
    """Waits as a kernel does."""

    settled, has_news = True, False

    def prepare(self, lane: Lane, waited: list[int], until_ns: int) -> bool:
        self.waited = waited
        return True

    def __call__(self, lane: Lane) -> list[int]:
        time.sleep(0.001)
        return self.waited


@pytest.mark.parametrize("old", [False, True])
@pytest.mark.parametrize("by_kernel", [False, True])
def test_messages_are_taken_one_at_a_time_unless_they_are_old(
    lanes: list[Lane],
    received: Received,
    monkeypatch: pytest.MonkeyPatch,
    old: bool,
    by_kernel: bool,
) -> None:
    receives, speaks, _ = lanes
    receives.wait = LongWait() if by_kernel else None
    monkeypatch.setattr(lane_module, "BEHIND_NS", 0 if old else 10**10)
    for number in range(3):
        send(speaks, b"%d" % number)
    for _ in range(3):
        hand_on(receives, whole=False, timeout_s=0.01)
    assert received.messages == ([b"2"] if old else [b"0", b"1", b"2"])


def test_whoever_is_slower_than_a_publisher_has_its_newest_messages(
    lanes: list[Lane], received: Received
) -> None:
    receives, speaks, _ = lanes
    behind = []
    for number in range(0, 600, 3):
        for late in range(3):
            send(speaks, b"%d" % (number + late))
        hand_on(receives, whole=False)
        behind.append(number + 2 - int(received.messages[-1]))
        time.sleep(0.001)
    # What comes in three milliseconds, and in one round more.
    assert max(behind) <= 20


def test_who_stalls_is_not_counted_until_it_goes_on(
    lanes: list[Lane], received: Received, monkeypatch: pytest.MonkeyPatch
) -> None:
    stalls, speaks, _ = lanes
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
    received, count = heard(receives, lanes, every=True), MOST_BEHIND
    message = b"m" * 4000
    for number in range(count):
        send(speaks, message, number)
    until(lambda: len(received) == count, receives, speaks)
    assert [origin.number for _, origin in received] == list(range(count))
    assert speaks.lost == 0


def test_a_change_of_what_is_heard_is_told(lanes: list[Lane]) -> None:
    speaks, receives, _ = lanes
    meet(lanes)
    received = heard(receives, lanes)
    send(speaks, b"a")
    receives.silence(TOPIC, received)
    # What was sent before it was told is dropped.
    hand_on(receives)
    meet(lanes)
    assert speaks.readers(TOPIC) == 0
    late = heard(receives, lanes)
    send(speaks, b"b")
    hand_on(receives)
    assert received == []
    assert late.messages == [b"b"]


def test_a_killed_process_is_noticed_at_once_and_its_socket_removed_by_others(
    folder: Path,
) -> None:
    lane = Lane(folder)
    received = Received()
    lane.listen("/back Kind", received)

    def go_on() -> None:
        send(lane, b"m")
        hand_on(lane)

    for _ in range(3):
        with process(folder) as other:
            received.clear()
            until(lambda: lane.readers(TOPIC) == 1 and bool(received), lane)
            other.kill()
            other.wait()
            # Though it does not look for others.
            at_last(lambda: not (lane.readers(TOPIC) or lane.linked), go_on, 10.0)
    until(lambda: len(list(folder.iterdir())) == 1, lane)
    lane.close()
    assert not folder.exists()


def test_bytes_that_are_no_messages_harm_nobody(
    lanes: list[Lane], received: Received, folder: Path
) -> None:
    receives = lanes[0]
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
        look(speaks)
        links = len(speaks._outgoing)
        there, _ = liar.accept()
        there.send(bytes(HEADER.size) + text)
        hand_on(speaks)
        assert len(speaks._outgoing) == links - 1
        there.close()
        # It is not tried again.
        look(speaks)
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
    receives._next_code = (1 << 16) - 1
    receives.listen("/last Kind", Received())
    received = heard(receives, lanes)
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
        look(lane)
        hand_on(lane)
    assert speaks.refused > 0
    assert speaks.readers(TOPIC) == 0
    assert not receives.linked


class Talk:
    """Two processes on a lane: one publishes on a topic that the other hears.

    Args:
        folder: of the lane.
    """

    def __init__(self, folder: Path) -> None:
        self.speaks, self.receives = Exchange(), Exchange()
        for exchange in (self.speaks, self.receives):
            exchange.lane = Lane(folder)
        # The one subscription is that of the process that is on the lane too.
        self.publisher, self.received = Publisher(1), Received()
        self.outlet = self.speaks.outlet(self.publisher, "/topic", False, "Kind")
        self.had = self.receives.listen("/topic", self.received, "Kind")

    def meet(self) -> None:
        meet([self.speaks.lane, self.receives.lane])

    def publish(self, message: bytes) -> str:
        """Publish a message; return the ways that it took."""
        self.outlet.publish(message)
        return self.outlet.ways()


@pytest.fixture
def talk(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Talk]:
    monkeypatch.setattr(exchange_module, "SETTLES_NS", 0)
    made = Talk(folder)
    yield made
    made.speaks.close()
    made.receives.close()


def test_the_middleware_carries_what_somebody_else_hears_and_the_copy_is_known(talk: Talk) -> None:
    talk.publish(b"before they meet")
    assert talk.publisher.sent == [b"before they meet"]
    talk.meet()
    assert talk.publish(b"alone") == "lane"
    assert len(talk.publisher.sent) == 1
    talk.publisher.subscriptions = 2
    time.sleep(2e-9 * CENSUS_NS)
    assert talk.publish(b"for both") == "lane, middleware"
    assert talk.publisher.sent[1:] == [b"for both"]
    # The middleware is faster here: what went over the lane is taken first all the same.
    assert talk.had(b"for both")
    assert talk.received.messages[-1] == b"for both"
    assert talk.received[-1][1].number == 2
    assert not talk.had(b"of somebody else")


def test_while_listeners_come_and_go_the_middleware_carries_all(
    talk: Talk, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may not know yet of the one on the lane, but of one that only it reaches."""
    monkeypatch.setattr(exchange_module, "SETTLES_NS", 300_000_000)
    talk.meet()
    assert talk.publish(b"a") == "lane, middleware"
    time.sleep(0.31)
    assert talk.publish(b"b") == "lane"
    assert talk.publisher.sent == [b"a"]


def test_what_waits_for_the_loop_is_sent_before_the_loop_stands_alone(talk: Talk) -> None:
    publisher, speaks = Publisher(), talk.speaks
    outlet = speaks.outlet(publisher, "/view", False, "Kind", later=True)
    talk.meet()
    outlet.publish(b"a")
    assert speaks.has_later
    assert publisher.sent == []
    talk.receives.close()
    hand_on(speaks.lane)
    assert not speaks.is_linked
    # In order, though nobody is on the lane any more.
    outlet.publish(b"b")
    speaks.publish_kept()
    assert publisher.sent == [b"a", b"b"]


def test_a_copy_that_comes_much_later_is_somebody_elses(
    talk: Talk, monkeypatch: pytest.MonkeyPatch
) -> None:
    talk.publisher.subscriptions = 2
    talk.meet()
    talk.publish(b"the same")
    assert talk.had(b"the same")
    monkeypatch.setattr(exchange_module, "UNDERWAY_NS", 0)
    assert not talk.had(b"the same")


def test_a_message_too_long_for_the_lane_goes_through_the_middleware(talk: Talk) -> None:
    talk.meet()
    for size in (MOST_BYTES, MOST_BYTES + 1):
        talk.publish(b"m" * size)
    talk.receives.collect()
    talk.receives.deliver()
    assert [len(message) for message in talk.received.messages] == [MOST_BYTES]
    assert [len(message) for message in talk.publisher.sent] == [MOST_BYTES + 1]


def test_what_stays_and_what_has_no_kind_keeps_off_the_lane(talk: Talk) -> None:
    talk.meet()
    for stays, kind in ((True, "Kind"), (False, "")):
        publisher = Publisher()
        talk.speaks.outlet(publisher, "/topic", stays, kind).publish(b"a")
        assert publisher.sent == [b"a"]


@pytest.fixture
def base(tmp_path: Path) -> dict[str, str]:
    """An environment whose folder for what runs is the test's own."""
    tmp_path.chmod(0o700)
    return {"XDG_RUNTIME_DIR": str(tmp_path)}


def test_graphs_that_the_middleware_keeps_apart_have_folders_of_their_own(
    base: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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


@pytest.mark.parametrize("mode", [0o755, 0o770, 0o701, 0])
def test_a_folder_that_others_reach_is_refused_and_a_link_in_its_place(
    base: dict[str, str], tmp_path: Path, mode: int
) -> None:
    place = tmp_path / f"hapticmech_ros-{os.geteuid()}"
    if mode:
        place.mkdir()
        place.chmod(mode)
    else:
        (tmp_path / "there").mkdir(mode=0o700)
        place.symlink_to(tmp_path / "there")
    with pytest.raises(LaneError, match="must be a folder of mode 0700 of this user"):
        Lane.open(base)
    exchange = Exchange()
    exchange.join_lane(base)
    assert exchange.lane is None
    assert str(place) in exchange.refusal


def test_graphs_with_security_leave_it_to_the_middleware(
    base: dict[str, str], tmp_path: Path
) -> None:
    with pytest.raises(LaneError, match="ROS_SECURITY_ENABLE is true"):
        lane_folder({**base, "ROS_SECURITY_ENABLE": "true"})
    assert not list(tmp_path.iterdir())
    assert lane_folder({**base, "ROS_SECURITY_ENABLE": "false"}).exists()


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


def test_there_is_news_of_who_comes_and_who_is_behind_only(
    lanes: list[Lane], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A kernel is left for it."""
    monkeypatch.setattr(lane_module, "LOOK_NS", 0)
    lane, other, _ = lanes
    heard(other, lanes, every=True)
    os.utime(folder, (0, 0))
    lane.look()
    assert not lane.has_news
    # A newcomer, and a change of what is subscribed to here.
    os.utime(folder)
    assert lane.has_news
    os.utime(folder, (0, 0))
    lane.look()
    assert not lane.has_news
    next(iter(lane._incoming.values())).announced = -1
    assert lane.has_news
    lane.look()
    assert not lane.has_news
    # Whoever wants all, and has not taken all.
    at_last(lambda: lane.has_news, lambda: send(lane, bytes(50_000)))
    until(lambda: not lane.has_news, *lanes)
