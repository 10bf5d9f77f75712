# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A record of the experiment from a bag of a graph of nodes.

Times are the senders' stamps, not those of reception.

Of several users the mechanism is sampled once for all of them; device, analyser and controller of
each are in a namespace of its point's name.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from hapticmech_ros.bag import BagReader
from hapticmech_ros.bag.reader import refuse_former_topics
from hapticmech_ros.bag.recorded_states import states_from_bag
from hapticmech_ros.control.measurements import device_of, point_of
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.experiment.record import (
    ExperimentRecord,
    SharedRecord,
    couplings,
    first_push,
    slerp,
)
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.model import build_tree
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import quaternion_of
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.scene import Scene
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.messages import (
    ENERGY_NAMES,
    DeviceStateMessage,
    MechanismEnergy,
    OperationalModelMessage,
)
from hapticmech_ros.wire.topics import (
    CONSTRAINT_PART,
    DEVICE_STATE,
    ENERGY,
    JOINT_STATES,
    POINT_COMMAND,
    POINT_FORCE,
    POINT_MODEL,
    Topic,
    users_of,
)

# Stamps (n,), ns, and rows (n, ...) of a topic.
Series = tuple[Array, Array]


def _stamp_ns(header: Any) -> int:
    return int(header.stamp.sec) * NANOSECONDS + int(header.stamp.nanosec)


def _wrench(message: Any) -> tuple[int, tuple[float, ...]]:
    f, t = message.wrench.force, message.wrench.torque
    return _stamp_ns(message.header), (f.x, f.y, f.z, t.x, t.y, t.z)


def _operational_model(message: Any) -> tuple[int, Array]:
    """Return a row: count, position (3), quaternion (4), Π (36), s (t)."""
    found = read(OperationalModelMessage, message.data)
    share = found.operational_model.wrench_projector
    pose = _pose_row(point_of(found.operational_model.values).pose)
    return found.stamp_ns, np.concatenate(([found.count], pose, share.ravel(), found.s))


def _device(message: Any) -> tuple[int, Array]:
    """Return a row: position (3), quaternion (4), hand wrench (6)."""
    found = read(DeviceStateMessage, message.data)
    measured = device_of(found.sample.values)
    return found.stamp_ns, np.concatenate((_pose_row(measured.pose), measured.hand_wrench))


def _pose_row(pose: pin.SE3) -> Array:
    return np.concatenate((pose.translation, quaternion_of(pose.rotation)))


def _energy(message: Any) -> tuple[int, tuple[float, ...]]:
    """Return a row: ``ENERGY_NAMES``."""
    energy = read(MechanismEnergy, message.data)
    return energy.stamp_ns, tuple(energy.values[2:].tolist())


NEEDED = (DEVICE_STATE, POINT_MODEL, CONSTRAINT_PART, ENERGY)
# Needed where several users hold one mechanism, of each.
SHARED = (POINT_COMMAND, POINT_FORCE)
# A function from a message to its stamp and row.
READERS: dict[Topic, Callable[[Any], tuple[int, Any]]] = {
    DEVICE_STATE: _device,
    POINT_MODEL: _operational_model,
    ENERGY: _energy,
    JOINT_STATES: lambda message: (_stamp_ns(message.header), np.array(message.position, float)),
    **dict.fromkeys((CONSTRAINT_PART, POINT_COMMAND, POINT_FORCE), _wrench),
}


def full_name(topic: Topic, point: str, namespace: str = "", user: str = "") -> str:
    """Return the absolute name of a topic of a graph.

    Args:
        topic: of it.
        point: operational point.
        namespace: that the graph runs under.
        user: namespace of one of several users within it.
    """
    name = topic.of(point, user)
    if name.startswith("/"):
        return name
    prefix = namespace.strip("/")
    return f"/{prefix}/{name}" if prefix else f"/{name}"


def chosen_topics(bag: BagReader, point: str, namespace: str, user: str = "") -> dict[Topic, str]:
    """Return the topics to read and their full names in ``bag``.

    Args:
        bag: to read.
        point: operational point that the user holds.
        namespace: of the graph.
        user: namespace of one of several users; empty of one alone.

    Raises:
        BagError: topics missing, empty, of another type or under a former name; the message lists
            all of them.
    """
    refuse_former_topics(bag)
    needed = NEEDED + SHARED if user else NEEDED
    names = {topic: full_name(topic, point, namespace, user) for topic in needed}
    missing = [name for name in names.values() if name not in bag.topics]
    empty = [n for n in names.values() if n in bag.topics and bag.topics[n].count == 0]
    other = [
        f"{name} (is {bag.topics[name].type}, should be {topic.type})"
        for topic, name in names.items()
        if name in bag.topics and bag.topics[name].type != topic.type
    ]
    complaints = [
        f"{what}: {', '.join(which)}"
        for what, which in (
            ("missing topics", missing),
            ("topics without messages", empty),
            ("topics of another type", other),
        )
        if which
    ]
    if complaints:
        hint = _namespace_hint(bag, missing, f"{namespace}/{user}")
        raise BagError(f"bag {bag.path}: {'; '.join(complaints)}{hint}")
    # Welcome, but needed only for the drawing of the mechanism.
    joints = full_name(JOINT_STATES, point, namespace, user)
    if joints in bag.topics and bag.topics[joints].type == JOINT_STATES.type:
        names[JOINT_STATES] = joints
    return names


def _namespace_hint(bag: BagReader, missing: list[str], namespace: str) -> str:
    """Return a hint if the bag has the device's state under another namespace."""
    if not missing:
        return ""
    ending = f"/{DEVICE_STATE.name}"
    found = [name.removesuffix(ending) or "/" for name in bag.topics if name.endswith(ending)]
    other = [place for place in found if place.strip("/") != namespace.strip("/")]
    return f" (the bag has the namespace {', '.join(other)})" if other else ""


# Columns in the rows: of device states, and of operational models.
HAND = slice(7, 13)
POINT = slice(1, 8)
SHARE = slice(8, 44)


def record_from_bag(
    path: str | os.PathLike[str],
    scene: Scene,
    point: str = "",
    namespace: str = "",
    duration: float | None = None,
) -> ExperimentRecord:
    """Return the run recorded in the bag at ``path``.

    Time 0 is the first sample in which the hand pushes. Samples more than the hand's start delay
    before it, or after ``duration``, are left out. Mechanism and device are sampled at different
    times: the operational point's pose is interpolated at the device's times.

    Args:
        path: rosbag2 folder, or one ``.mcap`` or ``.db3`` file.
        scene: of the run.
        point: operational point that the device held; the scene's first one if empty.
        namespace: of the graph.
        duration: s after the hand's start; to the bag's end if left out.

    Raises:
        BagError: no bag, a damaged one, topics missing or empty, invalid messages, or a hand that
            never pushed.
        InvalidInputError: the scene has no such point.
    """
    name = scene.operational_point(point).name
    series = read_series(path, name, namespace)
    return _record(path, series, scene, name, _first_push_ns(path, [series]), duration)


def read_series(
    path: str | os.PathLike[str], point: str, namespace: str, user: str = ""
) -> dict[Topic, Series]:
    """Return stamps (n,), ns, and rows (n, ...) of each topic of one user.

    Args:
        path: of the bag.
        point: operational point that the device held.
        namespace: of the graph.
        user: namespace of one of several users; empty of one alone.

    Raises:
        BagError: no bag, a damaged one, topics missing or empty, or invalid messages.
    """
    with BagReader(path) as bag:
        names = chosen_topics(bag, point, namespace, user)
        topics = {name: topic for topic, name in names.items()}
        samples: dict[str, list[tuple[int, Any]]] = {name: [] for name in topics}
        for item in bag.messages(*topics):
            found = samples[item.topic]
            try:
                found.append(READERS[topics[item.topic]](item.message))
            except (InvalidInputError, AttributeError) as error:
                raise BagError(f"topic {item.topic}, message {len(found)}: {error}") from error
    return {topic: _ordered(name, samples[name]) for topic, name in names.items()}


def _ordered(topic: str, samples: Sequence[tuple[int, Any]]) -> Series:
    """Return increasing stamps (n,), ns, and rows (n, ...); of equal stamps the last is kept.

    Raises:
        BagError: non-finite values, or rows of different lengths.
    """
    stamps = np.array([stamp for stamp, _ in samples], dtype=np.int64)
    order = np.argsort(stamps, kind="stable")
    order = order[np.diff(stamps[order], append=np.iinfo(np.int64).max) > 0]
    try:
        rows = np.array([row for _, row in samples], dtype=float)[order]
    except ValueError:
        raise BagError(f"topic {topic}: messages of different lengths") from None
    if not np.isfinite(rows).all():
        bad = int(np.argwhere(~np.isfinite(rows))[0][0])
        rule = "holds a value that is not finite"
        raise BagError(f"topic {topic}, message {bad} in order of time: {rule}")
    return stamps[order], rows


def _first_push_ns(path: str | os.PathLike[str], users: Iterable[Mapping[Topic, Series]]) -> int:
    """Return the stamp of the first sample in which any user's hand pushes, ns.

    Raises:
        BagError: none does.
    """
    devices = [series[DEVICE_STATE] for series in users]
    pushes = [(stamps, first_push(rows[:, HAND])) for stamps, rows in devices]
    found = [int(stamps[pushed]) for stamps, pushed in pushes if pushed is not None]
    if not found:
        what = f"the hand never pushed (its wrench in {DEVICE_STATE.name} is 0)"
        raise BagError(f"bag {path}: {what}")
    return min(found)


def _record(
    path: str | os.PathLike[str],
    series: Mapping[Topic, Series],
    scene: Scene,
    point: str,
    start_ns: int,
    duration: float | None,
) -> ExperimentRecord:
    """Return the record of one user.

    Args:
        path: of the bag, for errors.
        series: its topics, from :func:`read_series`.
        scene: of the run, as this user has it.
        point: operational point that the device held.
        start_ns: stamp of the first push, ns.
        duration: s after it; to the bag's end if None.

    Raises:
        BagError: invalid messages.
    """
    earliest = start_ns - nanoseconds(scene.hand.start_delay + scene.simulation.period / 2)
    latest = np.inf if duration is None else start_ns + nanoseconds(duration)
    cut: dict[Topic, Series] = {}
    for topic, (stamps, rows) in series.items():
        kept = (stamps >= earliest) & (stamps <= latest)
        cut[topic] = stamps[kept], rows[kept]
    times = {topic: (stamps - start_ns) * 1e-9 for topic, (stamps, _) in cut.items()}
    columns: dict[str, Any] = dict(zip(ENERGY_NAMES, cut[ENERGY][1].T, strict=True))
    columns |= _motion(series[POINT_MODEL], cut[DEVICE_STATE], start_ns)
    analyses = cut[POINT_MODEL][1]
    try:
        return ExperimentRecord(
            scene=scene.name,
            point=point,
            source="graph",
            period=scene.simulation.period,
            **columns,
            wrench_times=times[CONSTRAINT_PART],
            constraint_wrench=cut[CONSTRAINT_PART][1],
            analysis_times=times[POINT_MODEL],
            count=analyses[:, 0],
            s=analyses[:, SHARE.stop :],
            expected_wrench=_expected_wrench(series[DEVICE_STATE], cut[POINT_MODEL], scene),
            energy_times=times[ENERGY],
            joint_times=times.get(JOINT_STATES, np.zeros(0)),
            joint_positions=_joint_positions(cut.get(JOINT_STATES), scene),
        )
    except InvalidInputError as error:
        raise BagError(f"bag {path}: {error}") from error


def _motion(points: Series, device: Series, start_ns: int) -> dict[str, Array]:
    """Return the motion of device and point at the device's times within those of the point."""
    (point_stamps, found), (stamps, rows) = points, device
    both = (stamps >= point_stamps[0]) & (stamps <= point_stamps[-1])
    times, point_times = ((one - start_ns) * 1e-9 for one in (stamps[both], point_stamps))
    point, rows = found[:, POINT], rows[both]
    position = [np.interp(times, point_times, point[:, axis]) for axis in range(3)]
    return {
        "times": times,
        "device_position": rows[:, :3],
        "device_orientation": rows[:, 3:7],
        "point_position": np.column_stack(position),
        "point_orientation": slerp(times, point_times, point[:, 3:]),
        "hand_wrench": rows[:, HAND],
    }


def _expected_wrench(device: Series, analyses: Series, scene: Scene) -> Array:
    """Return -(1 - β) Π F_h (k, 6) of each analysis, with the hand's last wrench by then."""
    hand = held((device[0], device[1][:, HAND]), analyses[0])
    share = analyses[1][:, SHARE].reshape(-1, 6, 6)
    beta = scene.controller.joint_constraint.feedforward
    return np.asarray((beta - 1.0) * np.einsum("kij,kj->ki", share, hand))


def _joint_positions(states: Series | None, scene: Scene) -> Array:
    """Return q (j, nq); the topic has it as the difference from the neutral configuration.

    Raises:
        InvalidInputError: a wrong number of coordinates.
    """
    model = build_tree(scene).pinocchio
    if states is None or states[1].ndim != 2:
        return np.zeros((0, model.nq))
    rows = states[1]
    if rows.shape[1] != model.nv:
        rule = f"must be {model.nv}, as in the scene"
        raise InvalidInputError(f"coordinates in {JOINT_STATES.name}", rows.shape[1], rule)
    neutral = pin.neutral(model)
    positions = [pin.integrate(model, neutral, row) for row in rows]
    return np.array(positions).reshape(-1, model.nq)


def held(series: Series, at: Array) -> Array:
    """Return the rows (m, 6) valid at stamps: the latest sent by then, or zeros.

    Args:
        series: stamps (n,), ns, and rows (n, 6).
        at: (m,) stamps, ns.
    """
    stamps, rows = series
    index = np.searchsorted(stamps, at, side="right") - 1
    return np.where((index >= 0)[:, None], rows[np.maximum(index, 0)], 0.0)


def shared_record_from_bag(
    path: str | os.PathLike[str],
    scene: Scene,
    namespace: str = "",
    duration: float | None = None,
) -> SharedRecord:
    """Return the run of several users that was recorded in the bag at ``path``.

    Time 0 is the first sample in which any hand pushes. Whenever the mechanism published F_c, X_ij
    is computed from its state, and F_j is the last command by then.

    Args:
        path: rosbag2 folder, or one ``.mcap`` or ``.db3`` file.
        scene: of the run, with several ``hands``; its points are where the scene has them.
        namespace: of the graph.
        duration: s after the first push; to the bag's end if left out.

    Raises:
        BagError: no bag, a damaged one, topics missing or empty, invalid messages, or hands that
            never pushed.
    """
    series = {
        point: read_series(path, point, namespace, user)
        for user, point in users_of(scene.held_points)
    }
    start_ns = _first_push_ns(path, series.values())
    users = {
        point: _record(path, found, scene.held_at(point), point, start_ns, duration)
        for point, found in series.items()
    }
    mechanism = Mechanism(scene)
    states = states_from_bag(path, mechanism, "", namespace)
    point, user = next(iter(users.items()))
    # The mechanism publishes F_c of all points at once.
    stamps, _ = series[point][POINT_FORCE]
    times = (stamps - start_ns) / NANOSECONDS
    stamps = stamps[(times >= user.times[0]) & (times <= user.times[-1])]
    chosen = np.searchsorted(states.stamps_ns, stamps, side="right") - 1
    known = chosen >= 0
    if not known.any():
        raise BagError(f"bag {path}: nothing of the mechanism while the hands were there")
    stamps, chosen = stamps[known], chosen[known]
    return SharedRecord(
        users,
        (stamps - start_ns) / NANOSECONDS,
        # The answer to a sample of this time acts from the next one on.
        _rows([found[POINT_COMMAND] for found in series.values()], stamps - 1),
        _rows([found[POINT_FORCE] for found in series.values()], stamps),
        couplings(
            mechanism,
            scene.held_points,
            states.q[chosen],
            [tuple(row) for row in states.active[chosen].tolist()],
        ),
    )


def _rows(series: list[Series], stamps: Array) -> Array:
    """Return (k, n, 6) the last value of each series at k stamps."""
    return np.stack([held(one, stamps) for one in series], axis=1)
