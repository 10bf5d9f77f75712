# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""States of a mechanism from a bag: `mechanism/state` at the control rate, or joint states.

Other people's robots publish joint states in their own ways. Velocities may be missing or NaN, a
coupled joint may be in no message, and several nodes may publish on the topic, each with its own
joints.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.polynomial import Polynomial

from hapticmech_ros.bag import BagReader
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.state import StateLayout, coordinate_names
from hapticmech_ros.wire.topics import JOINT_STATES, STATE

# A joint that moves so far and back within two states, rad or m, and so many times as far as
# usually in two, and so often, is published by two senders.
JUMP, TIMES_USUAL, OFTEN = 0.01, 10.0, 3
_Times = npt.NDArray[np.int64]


def recorded_joints(messages: Iterable[Any], mechanism: Mechanism, topic: str) -> RecordedStates:
    """Return the states in joint states; closures and points held are those of the scene's start.

    Each message makes a state, with the newest positions of the joints that it does not name; those
    before all joints are known are left out. Where no message has the position of a coupled joint,
    it follows from its leader. Rates in no message are 0.

    Args:
        messages: ``sensor_msgs/msg/JointState``, in order of reception.
        mechanism: that was recorded.
        topic: of the messages.

    Raises:
        InvalidInputError: a joint that is in no message and follows from none, a position that is
            not finite, or a message with more names than values.
    """
    names = coordinate_names(mechanism)
    stamps, told, named = _columns(messages, names)
    number = np.arange(stamps.size)[:, None]
    finite = np.isfinite(told[:, 0])
    measured = finite.any(axis=0)
    followers = _followers(mechanism, names, measured, named)
    newest = np.maximum.accumulate(np.where(finite, number, -1), axis=0)
    lapses = np.argwhere(named & ~finite & (newest >= 0))
    if lapses.size:
        row, column = lapses[0].tolist()
        rule = f"must be finite, in the message of {stamps[row]} ns"
        raise InvalidInputError(f"position of {names[column]}", told[row, 0, column].item(), rule)
    known = (newest[:, measured] >= 0).all(axis=1) & finite.any(axis=1)
    # Of messages with one stamp, each with its own joints, the last has them all.
    apart = ~(named[1:] & named[:-1]).any(axis=1) & (stamps[1:] == stamps[:-1])
    kept = known & ~np.append(apart, False)
    newest = newest[kept]
    columns = np.arange(len(names))
    positions, rates = told[newest, 0, columns], told[newest, 1, columns]
    for follower, leader, curve in followers:
        at = positions[:, leader]
        positions[:, follower] = curve(at)
        rates[:, follower] = curve.deriv()(at) * rates[:, leader]
    rateless = ~np.isfinite(rates)
    rates[rateless] = 0.0
    times = stamps[kept]
    notes = [
        f"{names[follower]} is in no message: it follows from {names[leader]}"
        for follower, leader, _ in followers
    ]
    notes += _rates_missing(names, rateless)
    early = int((~known).sum())
    if early:
        notes.append(f"messages left out, as not all positions are known yet: {early}")
    notes += _parts(names, named[known], (times[:, None] - stamps[newest])[:, measured])
    notes += _jumps(mechanism, names, times, positions)
    return RecordedStates(
        times,
        np.array([mechanism.configuration(row) for row in positions]),
        rates,
        np.tile(np.array(mechanism.initially_active, dtype=bool), (times.size, 1)),
        np.tile(flat_grasps(mechanism.scene), (times.size, 1, 1)),
        topic,
        tuple(notes),
    )


def _columns(
    messages: Iterable[Any], names: tuple[str, ...]
) -> tuple[_Times, Array, npt.NDArray[np.bool_]]:
    """Return stamps (n,), positions and rates (n, 2, nv), NaN where unknown, and who is named."""
    column = {name: index for index, name in enumerate(names)}
    stamps, told, named = [], [], []
    others: set[str] = set()
    for message in messages:
        row, there = np.full((2, len(names)), np.nan), np.zeros(len(names), dtype=bool)
        at = [column.get(name, -1) for name in message.name]
        ours = [index for index in at if index >= 0]
        others.update(message.name)
        if not ours:
            continue
        for line, what in zip(row, ("position", "velocity"), strict=True):
            values = getattr(message, what)
            if what == "velocity" and len(values) == 0:
                continue
            if len(values) != len(message.name):
                rule = f"must be as many as names ({len(message.name)})"
                raise InvalidInputError(f"number of {what}s", len(values), rule)
            line[ours] = [value for value, index in zip(values, at, strict=True) if index >= 0]
        there[ours] = True
        stamp = message.header.stamp
        stamps.append(int(stamp.sec) * NANOSECONDS + int(stamp.nanosec))
        told.append(row)
        named.append(there)
    if not stamps:
        raise InvalidInputError("joints", sorted(others), f"must name {', '.join(names)}")
    times = np.array(stamps, dtype=np.int64)
    order = np.argsort(times, kind="stable")
    return times[order], np.array(told)[order], np.array(named)[order]


def _followers(
    mechanism: Mechanism,
    names: tuple[str, ...],
    measured: npt.NDArray[np.bool_],
    named: npt.NDArray[np.bool_],
) -> list[tuple[int, int, Polynomial]]:
    """Return follower, leader and coupling of joints in no message, leaders first."""
    known = {name for name, there in zip(names, measured, strict=True) if there}
    found = []
    left = list(mechanism.scene.couplings)
    while ready := [one for one in left if one.leader in known and one.joint not in known]:
        one = ready[0]
        known.add(one.joint)
        curve = Polynomial(one.curve)
        found.append((names.index(one.joint), names.index(one.leader), curve))
    missing = [name for name in names if name not in known]
    if missing:
        told = [name for column, name in enumerate(names) if named[:, column].any()]
        nowhere = f"must name {', '.join(missing)}, with a position, in some message"
        raise InvalidInputError("joints", told, nowhere)
    return found


def _rates_missing(names: tuple[str, ...], missing: npt.NDArray[np.bool_]) -> Iterator[str]:
    number = int(missing.any(axis=1).sum())
    if number:
        which = ", ".join(np.array(names)[missing.any(axis=0)].tolist())
        yield f"rates of {which} taken as 0 in {number} of {len(missing)} states: none are recorded"


def _parts(names: tuple[str, ...], named: npt.NDArray[np.bool_], ages: _Times) -> Iterator[str]:
    parts = np.unique(named, axis=0)
    if len(parts) > 1:
        said = " | ".join(", ".join(np.array(names)[part].tolist()) for part in parts[:4])
        more = " | ..." if len(parts) > 4 else ""
        age = ages.max() / 1e6
        yield (
            f"messages name parts of the joints ({said}{more}): each state has the newest"
            f" positions of the others, up to {age:.3g} ms old"
        )


def _jumps(
    mechanism: Mechanism, names: tuple[str, ...], times: _Times, positions: Array
) -> Iterator[str]:
    """Yield a warning if states alternate between those of two senders."""
    if len(positions) < 3:
        return
    steps = np.abs(np.diff(positions, axis=0))
    double = np.abs(positions[2:] - positions[:-2]).max(axis=1)
    there, back = steps[:-1].max(axis=1), steps[1:].max(axis=1)
    moving = double[double > 0.0]
    usual = float(np.median(moving)) if moving.size else 0.0
    least = np.maximum(JUMP, TIMES_USUAL * np.maximum(usual, double))
    jumps = (there > least) & (back > least)
    number = int(jumps.sum())
    if number >= OFTEN:
        row = int(np.argmax(np.where(jumps, there, 0.0)))
        column = int(np.argmax(steps[row]))
        joint = names[column]
        kinds = dict(zip(mechanism.tree.joint_names, mechanism.tree.joint_types, strict=True))
        unit = "m" if kinds.get(joint) == "prismatic" else "rad"
        within = (times[row + 1] - times[row]) / 1e6
        yield (
            f"warning: {joint} jumps by {steps[row, column]:.3g} {unit} in {within:.3g} ms and"
            f" back, and there are {number} such jumps: the stamps alternate between two senders,"
            " one of which is wrong"
        )


@dataclass(frozen=True, slots=True)
class RecordedStates:
    """States in order of their stamps.

    Attributes:
        stamps_ns: (n,) stamps, ns.
        q: (n, nq) configurations.
        v: (n, nv) rates.
        active: (n, closures) whether each closure is closed.
        grasps: (n, points, 7) place of each operational point.
        topic: of the messages.
        notes: on joint states: rates and joints that were in no message, parts of several
            publishers, jumps.
    """

    stamps_ns: npt.NDArray[np.int64]
    q: Array
    v: Array
    active: npt.NDArray[np.bool_]
    grasps: Array
    topic: str
    notes: tuple[str, ...] = ()


def states_from_bag(
    path: str | os.PathLike[str], mechanism: Mechanism, topic: str = "", namespace: str = ""
) -> RecordedStates:
    """Return the states of a mechanism that were recorded into a bag.

    Args:
        path: rosbag2 folder, or one ``.mcap`` or ``.db3`` file.
        mechanism: that was recorded.
        topic: of joint states of any graph. If empty, ``mechanism/state`` is read, which has every
            sample and the closed loops, or else ``mechanism/measured_js``. Joint states have no
            information about loops: those closed at the scene's start are assumed. See
            :func:`hapticmech_ros.bag.recorded_states.recorded_joints`.
        namespace: of the graph.

    Raises:
        BagError: no bag, a damaged one, a topic that is missing or empty, or messages of another
            mechanism.
    """
    with BagReader(path) as bag:
        name = topic or _name(bag, namespace)
        if name not in bag.topics or bag.topics[name].count == 0:
            raise BagError(f"bag {bag.path}: no messages on {name}")
        kind = bag.topics[name].type
        try:
            if kind == STATE.type:
                return _own_states(bag, name, mechanism)
            if kind == JOINT_STATES.type:
                messages = (item.message for item in bag.messages(name))
                return recorded_joints(messages, mechanism, name)
        except InvalidInputError as error:
            raise BagError(f"bag {bag.path}, {name}: {error}") from error
    raise BagError(f"bag {path}, {name}: is {kind}, should be {STATE.type} or {JOINT_STATES.type}")


def _name(bag: BagReader, namespace: str) -> str:
    prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""
    own = f"{prefix}/{STATE.name}"
    found = bag.topics.get(own)
    return own if found is not None and found.count else f"{prefix}/{JOINT_STATES.name}"


def _own_states(bag: BagReader, name: str, mechanism: Mechanism) -> RecordedStates:
    layout = StateLayout(mechanism)
    messages = [data for _, _, data in bag.serialized(name)]
    columns = layout.unpack_all(FlatArray(layout.fields).decode_all(messages))
    stamps, active, q, v, grasps = columns
    order = np.argsort(stamps, kind="stable")
    return RecordedStates(stamps[order], q[order], v[order], active[order], grasps[order], name)
