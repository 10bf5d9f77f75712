# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""States of a mechanism from a bag: `mechanism/state` at the control rate, or joint states."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hapticmech_ros.arrays import Array
from hapticmech_ros.bag import BagReader
from hapticmech_ros.bag.recorded_joints import recorded_joints
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.grasp import flat_grasps
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.state import StateColumns, StateLayout
from hapticmech_ros.wire.topic import Topic
from hapticmech_ros.wire.topics import JOINT_STATES, STATE


@dataclass(frozen=True, slots=True)
class RecordedStates:
    """States in order of their stamps.

    Attributes:
        stamps_ns: (n,) stamps, ns.
        q: (n, nq) configurations.
        v: (n, nv) rates.
        active: (n, closures) whether each closure is closed.
        grasps: (n, points, 7) where each operational point is.
        topic: of the messages.
        notes: what is to be said of joint states: rates and joints that were in no message, parts
            of several publishers, jumps.
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
            :func:`hapticmech_ros.bag.recorded_joints.recorded_joints`.
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
                return _joint_states(bag, name, mechanism)
        except InvalidInputError as error:
            raise BagError(f"bag {bag.path}, {name}: {error}") from error
    raise BagError(f"bag {path}, {name}: is {kind}, should be {STATE.type} or {JOINT_STATES.type}")


def _name(bag: BagReader, namespace: str) -> str:
    prefix = f"/{namespace.strip('/')}" if namespace.strip("/") else ""

    def full(topic: Topic) -> str:
        return f"{prefix}/{topic.name}"

    found = bag.topics.get(full(STATE))
    return full(STATE) if found is not None and found.count else full(JOINT_STATES)


def _own_states(bag: BagReader, name: str, mechanism: Mechanism) -> RecordedStates:
    layout = StateLayout(mechanism)
    messages = [data for _, _, data in bag.serialized(name)]
    found = layout.unpack_all(FlatArray(layout.fields).decode_all(messages))
    return _ordered(found, name)


def _joint_states(bag: BagReader, name: str, mechanism: Mechanism) -> RecordedStates:
    found = recorded_joints((item.message for item in bag.messages(name)), mechanism)
    number = len(found.stamps_ns)
    return RecordedStates(
        found.stamps_ns,
        np.array([mechanism.configuration(row) for row in found.positions]),
        found.rates,
        np.tile(np.array(mechanism.initially_active, dtype=bool), (number, 1)),
        np.tile(flat_grasps(mechanism.scene), (number, 1, 1)),
        name,
        found.notes,
    )


def _ordered(found: StateColumns, topic: str) -> RecordedStates:
    stamps, active, q, v, grasps = found
    order = np.argsort(stamps, kind="stable")
    return RecordedStates(stamps[order], q[order], v[order], active[order], grasps[order], topic)
