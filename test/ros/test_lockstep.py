# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Graphs in lockstep: the same bits on every run, the session's numbers, and replays of either."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from geometry_msgs.msg import WrenchStamped

from hapticmech_ros import Mechanism, Session, load_scene
from hapticmech_ros.bag.reader import BagReader
from hapticmech_ros.control.measurements import device_of, point_of
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.graph.lockstep import LockstepError, LockstepRun, run_lockstep
from hapticmech_ros.graph.processes import private_environment, start_process, stop_process
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import DeviceEnergy, DeviceStateMessage, OperationalModelMessage
from hapticmech_ros.wire.state import StateLayout
from hapticmech_ros.wire.topics import TOPICS
from ros.harness import Peer, next_domain, scene_like, six, unstamped

# Both hands wait for a quarter of a second.
DURATIONS = {"five_bar": 0.5, "spatial_arm": 0.5}
CONTROL = [f"/{topic.of('handle')}" for topic in TOPICS if topic.rate == "control"]
START_NS, PERIOD_NS = 1_000_000_000, 1_000_000
Bag = dict[str, list[bytes]]


def lockstep(
    scene: str, out: Path | None = None, asked: Callable[[], bool] = lambda: False, **run: object
) -> int:
    """Run in a domain of its own; return the number of ticks."""
    given = {"composed": True, **run}
    environment = private_environment(next_domain())
    return run_lockstep(LockstepRun(scene, out=out, **given), environment, asked)


def messages(path: Path) -> Bag:
    """Return the serialized messages of a bag, by topic."""
    with BagReader(path) as bag:
        return {name: [data for _, _, data in bag.serialized(name)] for name in bag.topics}


@contextmanager
def busy() -> Iterator[None]:
    """Keep the machine's cores busy for a while."""
    command = [sys.executable, "-c", "while True: pass"]
    loads = [start_process(command, private_environment()) for _ in range(2)]
    try:
        yield
    finally:
        for load in loads:
            load.kill()
            stop_process(load)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return a bag of each scene, recorded from one process."""
    folder = tmp_path_factory.mktemp("lockstep")
    for scene, duration in DURATIONS.items():
        ticks = lockstep(scene, folder / scene, duration=duration)
        assert ticks == round(duration * 1000)
    return {scene: folder / scene for scene in DURATIONS}


@pytest.mark.parametrize("scene", DURATIONS)
def test_a_run_is_repeated_to_the_bit_whatever_the_machine_does(
    runs: dict[str, Path], tmp_path: Path, scene: str
) -> None:
    with busy():
        lockstep(scene, tmp_path / "again", duration=DURATIONS[scene], composed=False)
    one, two = messages(runs[scene]), messages(tmp_path / "again")
    assert set(one) == set(two)
    ticks = round(DURATIONS[scene] * 1000)
    for name in CONTROL:
        assert len(one[name]) == ticks, name
    for name in ("/device/measured_cp", "/analysis/handle/constraint_count", "/mechanism/energy"):
        assert len(one[name]) == ticks // 10, name
    for name in set(one) - {"/diagnostics"}:
        # Nodes say that they are inactive before the run, when a recorder may not hear them yet.
        first = -1 if name.endswith("/operating_state") else 0
        assert one[name][first:] == two[name][first:], name


@pytest.mark.parametrize("scene", DURATIONS)
def test_a_run_is_the_session_tick_by_tick(runs: dict[str, Path], scene: str) -> None:
    bag = messages(runs[scene])
    devices = [read(DeviceStateMessage, decode(data)) for data in bag["/device/state"]]
    models = [
        read(OperationalModelMessage, decode(data))
        for data in bag["/analysis/handle/operational_model"]
    ]
    session = Session(load_scene(scene))
    samples = [session.tick() for _ in devices]
    stamps = [START_NS + tick * PERIOD_NS for tick in range(len(samples))]
    assert [device.stamp_ns for device in devices] == stamps
    assert [model.stamp_ns for model in models] == stamps
    assert [model.count for model in models] == [sample.count for sample in samples]
    outputs = [sample.output for sample in samples]
    for found, expected in (
        (
            [_place(device_of(d.sample.values).pose) for d in devices],
            [_place(s.device.pose) for s in samples],
        ),
        ([d.sample.twist for d in devices], [s.device.twist for s in samples]),
        ([d.sample.hand_wrench for d in devices], [s.hand_wrench for s in samples]),
        (
            [_place(point_of(r.operational_model.values).pose) for r in models],
            [_place(s.point.pose) for s in samples],
        ),
        ([r.operational_model.twist for r in models], [s.point.twist for s in samples]),
        (
            [r.operational_model.inverse_inertia for r in models],
            [s.model.inverse_inertia for s in samples],
        ),
        (
            [r.operational_model.free_acceleration for r in models],
            [s.model.free_acceleration for s in samples],
        ),
        (_wrenches(bag["/device/servo_cf"]), [output.device for output in outputs]),
        (_wrenches(bag["/mechanism/handle/servo_cf"]), [o.mechanism for o in outputs]),
    ):
        _alike(found, expected)


def test_a_late_uneven_and_lossy_connection_is_the_sessions(tmp_path: Path) -> None:
    connection = {"delay": 0.02, "jitter": 0.2, "loss": 0.05, "seed": 3}
    late = scene_like(tmp_path, "spatial_arm", connection=connection)
    lockstep(late, tmp_path / "bag", duration=0.6)
    bag = messages(tmp_path / "bag")
    devices = [read(DeviceStateMessage, decode(data)) for data in bag["/device/state"]]
    session = Session(load_scene(late))
    samples, energies = [], []
    for _ in devices:
        samples.append(session.tick())
        energies.append((session.passivity.actuators, session.energies.to_mechanism))
    for found, expected in (
        ([d.sample.twist for d in devices], [s.device.twist for s in samples]),
        ([d.sample.hand_wrench for d in devices], [s.hand_wrench for s in samples]),
        ([d.applied for d in devices], [s.device.applied for s in samples]),
    ):
        _alike(found, expected)
    told = [read(DeviceEnergy, decode(data)) for data in bag["/device/energy"]]
    ticks = [(one.stamp_ns - START_NS) // PERIOD_NS for one in told]
    assert len(ticks) > 50
    # The session has given the next command by the end of its tick; its own account is a tick old.
    assert [one.taken_by_actuators for one in told[1:]] == pytest.approx(
        [energies[tick - 1][0] for tick in ticks[1:]], rel=1e-9, abs=1e-15
    )
    assert told[-1].from_hand > 0.0


def test_the_hands_wrenches_reproduce_the_run(runs: dict[str, Path], tmp_path: Path) -> None:
    ticks = lockstep("five_bar", tmp_path / "bag", feed_from=runs["five_bar"], feed=("hand",))
    assert ticks == 500
    _same(runs["five_bar"], tmp_path / "bag", CONTROL)


def test_the_devices_samples_reproduce_what_is_rendered(
    runs: dict[str, Path], tmp_path: Path
) -> None:
    scene = "spatial_arm"
    lockstep(scene, tmp_path / "bag", feed_from=runs[scene], feed=("device",))
    _same(runs[scene], tmp_path / "bag", CONTROL)


def test_a_push_from_outside_is_recorded_and_reproduced(
    domain: int, peer: Peer, tmp_path: Path
) -> None:
    publisher = peer.node.create_publisher(WrenchStamped, "mechanism/handle/external_cf", 10)
    forces = peer.listen("mechanism/handle/measured_cf", WrenchStamped)
    asked = itertools.count()

    def pushed_and_over() -> bool:
        """Push until that is felt, and wait until it has run out; called every 0.2 s."""
        peer.run(0.02)
        felt = [any(six(force)) for force in forces]
        if not any(felt):
            publisher.publish(unstamped(0.2, *[0.0] * 4, 0.003))
        return (any(felt) and not felt[-1]) or next(asked) > 150

    run = LockstepRun("five_bar", rate=0.5, out=tmp_path / "pushed", composed=True)
    run_lockstep(run, private_environment(domain), pushed_and_over)
    layout = StateLayout(Mechanism(load_scene("five_bar")))
    states = [layout.unpack(decode(data)) for data in messages(run.out)["/mechanism/state"]]
    pushed = [bool(state.contacts.any()) for state in states]
    assert 100 < sum(pushed) < len(pushed)
    feed = ("hand", "external")
    lockstep("five_bar", tmp_path / "again", feed_from=run.out, feed=feed)
    # Stopped on its way: the last tick may be incomplete.
    _same(run.out, tmp_path / "again", CONTROL, ticks=len(states) - 1)


def test_a_replay_with_a_change_differs(runs: dict[str, Path], tmp_path: Path) -> None:
    heavier = scene_like(tmp_path, "five_bar", "links[0].inertial.mass=1.1")
    lockstep(heavier, tmp_path / "bag", feed_from=runs["five_bar"], feed=("hand",))
    one, two = messages(runs["five_bar"]), messages(tmp_path / "bag")
    topic = "/analysis/handle/operational_model"
    first, second = (
        [read(OperationalModelMessage, decode(data)) for data in bag[topic]] for bag in (one, two)
    )
    assert [r.stamp_ns for r in first] == [r.stamp_ns for r in second]
    assert (
        np.abs(
            first[0].operational_model.inverse_inertia - second[0].operational_model.inverse_inertia
        ).max()
        > 0.01
    )
    # The same hand, felt otherwise.
    wrenches = [
        [read(DeviceStateMessage, decode(d)).sample.hand_wrench for d in bag["/device/state"]]
        for bag in (one, two)
    ]
    assert np.array_equal(*wrenches)
    assert one["/device/servo_cf"] != two["/device/servo_cf"]


def test_progress_and_ends_of_the_nodes_are_told(domain: int) -> None:
    run = LockstepRun("two_link", duration=2.0, composed=True, shown=True)
    ticks, ends = dict[int, int](), list[int]()
    environment = private_environment(domain)
    run_lockstep(
        run,
        environment,
        lambda: False,
        lambda done, every: ticks.update({done: every}),
        lambda reports, endings: ends.append(len(endings)),
    )
    assert set(ticks.values()) == {2000}
    assert list(ticks) == sorted(ticks)
    assert ends == [4]


def test_a_silent_node_is_named(domain: int) -> None:
    run = LockstepRun(
        "five_bar",
        duration=0.1,
        composed=True,
        stall_timeout=2.0,
        parameters={"nullspace_analyser.autostart": False},
    )
    with pytest.raises(LockstepError, match="/analysis/handle/operational_model"):
        run_lockstep(run, private_environment(domain), lambda: False)


def test_what_cannot_be_run_is_refused(runs: dict[str, Path], tmp_path: Path) -> None:
    bag = runs["five_bar"]
    for given, word in (
        ({"feed_from": bag, "feed": ("foot",)}, "foot"),
        ({"feed_from": bag, "feed": ("hand", "device")}, "not both"),
        ({"feed_from": bag}, "must both be given"),
        ({"feed": ("hand",)}, "must both be given"),
        ({"feed_from": bag, "feed": ("hand",), "hold": ("a", "b")}, "one point"),
    ):
        with pytest.raises(InvalidInputError, match=word):
            lockstep("five_bar", tmp_path / "never", **given)
    with pytest.raises((LockstepError, BagError), match="nowhere"):
        lockstep("five_bar", feed_from=tmp_path / "nowhere", feed=("hand",))
    assert not (tmp_path / "never").exists()


def _alike(found: list[np.ndarray], expected: list[np.ndarray]) -> None:
    one, two = np.array(found), np.array(expected)
    # Poses travel as quaternions, states as joint coordinates: 1e-16 of a pose, which stiff
    # controllers turn into 1e-13 of the forces of a few tenths of a newton met here.
    assert np.abs(one - two).max() <= 5e-12 * np.abs(two).max()
    assert np.abs(two).max() > 0.0


def _same(expected: Path, found: Path, topics: list[str], ticks: int | None = None) -> None:
    one, two = messages(expected), messages(found)
    for name in topics:
        assert one[name][:ticks] == two[name][:ticks], name
        assert one[name], name


def _place(pose: pin.SE3) -> np.ndarray:
    return np.asarray(pose.homogeneous)


def _wrenches(data: list[bytes]) -> list[np.ndarray]:
    """Return the wrenches of serialized WrenchStamped messages: their last six numbers."""
    return [np.frombuffer(message[-48:], dtype="<f8") for message in data]
