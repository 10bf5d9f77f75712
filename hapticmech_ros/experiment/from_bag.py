# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A record of the experiment from a bag of a graph of nodes.

Times are the senders' stamps, not those of reception.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.bag import BagReader
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.experiment.bag_topics import chosen_topics
from hapticmech_ros.experiment.orientation import slerp
from hapticmech_ros.experiment.record import ExperimentRecord, first_push
from hapticmech_ros.experiment.stamped import samples_of
from hapticmech_ros.mechanism.model import build_tree
from hapticmech_ros.scene import Scene
from hapticmech_ros.times import nanoseconds
from hapticmech_ros.wire.layouts import ENERGY_NAMES
from hapticmech_ros.wire.topic import Topic
from hapticmech_ros.wire.topics import (
    CONSTRAINT_PART,
    DEVICE_STATE,
    ENERGY,
    JOINT_STATES,
    POINT_MODEL,
)

Series = tuple[Array, Array]
# Columns in the rows of stamped.py: of device states, and of operational models.
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
    start_ns = first_push_ns(series)
    if start_ns is None:
        raise never_pushed(path)
    return record_of(path, series, scene, name, start_ns, duration)


def never_pushed(path: str | os.PathLike[str]) -> BagError:
    """Return the error of a bag in which no hand pushes."""
    return BagError(f"bag {path}: the hand never pushed (its wrench in {DEVICE_STATE.name} is 0)")


def first_push_ns(series: Mapping[Topic, Series]) -> int | None:
    """Return the stamp of the first sample in which the hand pushes, ns; None if there is none."""
    stamps, rows = series[DEVICE_STATE]
    pushed = first_push(rows[:, HAND])
    return None if pushed is None else int(stamps[pushed])


def record_of(
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
    latest = None if duration is None else start_ns + nanoseconds(duration)
    window = (earliest, latest)
    try:
        return ExperimentRecord(
            scene=scene.name,
            point=point,
            source="graph",
            period=scene.simulation.period,
            **_motion(series, window, start_ns),
            **_wrenches(series, window, start_ns),
            **_analyses(series, window, start_ns, scene),
            **_energies(series, window, start_ns),
            **_joints(series, window, start_ns, scene),
        )
    except InvalidInputError as error:
        raise BagError(f"bag {path}: {error}") from error


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
        samples = {name: samples_of(name, topic.type) for topic, name in names.items()}
        for item in bag.messages(*names.values()):
            samples[item.topic].add(item.message)
    return {topic: samples[name].ordered() for topic, name in names.items()}


def _cut(series: Series, window: tuple[int, int | None]) -> Series:
    stamps, rows = series
    kept = stamps >= window[0]
    if window[1] is not None:
        kept &= stamps <= window[1]
    return stamps[kept], rows[kept]


def _seconds(stamps: Array, start_ns: int) -> Array:
    return np.asarray((stamps - start_ns) * 1e-9)


def _motion(
    series: Mapping[Topic, Series], window: tuple[int, int | None], start_ns: int
) -> dict[str, Array]:
    stamps, device = _cut(series[DEVICE_STATE], window)
    point_stamps, found = series[POINT_MODEL]
    point = found[:, POINT]
    both = (stamps >= point_stamps[0]) & (stamps <= point_stamps[-1])
    times = _seconds(stamps[both], start_ns)
    point_times = _seconds(point_stamps, start_ns)
    position = [np.interp(times, point_times, point[:, axis]) for axis in range(3)]
    return {
        "times": times,
        "device_position": device[both, :3],
        "device_orientation": device[both, 3:7],
        "point_position": np.column_stack(position),
        "point_orientation": slerp(times, point_times, point[:, 3:]),
        "hand_wrench": device[both, HAND],
    }


def _wrenches(
    series: Mapping[Topic, Series], window: tuple[int, int | None], start_ns: int
) -> dict[str, Array]:
    stamps, rows = _cut(series[CONSTRAINT_PART], window)
    return {"wrench_times": _seconds(stamps, start_ns), "constraint_wrench": rows}


def _analyses(
    series: Mapping[Topic, Series], window: tuple[int, int | None], start_ns: int, scene: Scene
) -> dict[str, Array]:
    stamps, rows = _cut(series[POINT_MODEL], window)
    hand = held((series[DEVICE_STATE][0], series[DEVICE_STATE][1][:, HAND]), stamps)
    share = rows[:, SHARE].reshape(-1, 6, 6)
    beta = scene.controller.joint_constraint.feedforward
    return {
        "analysis_times": _seconds(stamps, start_ns),
        "count": rows[:, 0],
        "s": rows[:, SHARE.stop :],
        "expected_wrench": (beta - 1.0) * np.einsum("kij,kj->ki", share, hand),
    }


def _energies(
    series: Mapping[Topic, Series], window: tuple[int, int | None], start_ns: int
) -> dict[str, Array]:
    stamps, rows = _cut(series[ENERGY], window)
    columns = {name: rows[:, index] for index, name in enumerate(ENERGY_NAMES)}
    return {"energy_times": _seconds(stamps, start_ns), **columns}


def _joints(
    series: Mapping[Topic, Series], window: tuple[int, int | None], start_ns: int, scene: Scene
) -> dict[str, Array]:
    """Return q; the topic has it as the difference from the neutral configuration.

    Raises:
        InvalidInputError: a wrong number of coordinates.
    """
    model = build_tree(scene).pinocchio
    if JOINT_STATES not in series or series[JOINT_STATES][1].ndim != 2:
        return {"joint_times": np.zeros(0), "joint_positions": np.zeros((0, model.nq))}
    stamps, rows = _cut(series[JOINT_STATES], window)
    if rows.shape[1] != model.nv:
        rule = f"must be {model.nv}, as in the scene"
        raise InvalidInputError(f"coordinates in {JOINT_STATES.name}", rows.shape[1], rule)
    neutral = pin.neutral(model)
    positions = [np.asarray(pin.integrate(model, neutral, row)) for row in rows]
    return {
        "joint_times": _seconds(stamps, start_ns),
        "joint_positions": np.array(positions).reshape(-1, model.nq),
    }


def held(series: Series, at: Array) -> Array:
    """Return the rows (m, 6) valid at stamps: the latest sent by then, or zeros.

    Args:
        series: stamps (n,), ns, and rows (n, 6).
        at: (m,) stamps, ns.
    """
    stamps, rows = series
    index = np.searchsorted(stamps, at, side="right") - 1
    return np.where((index >= 0)[:, None], rows[np.maximum(index, 0)], 0.0)
