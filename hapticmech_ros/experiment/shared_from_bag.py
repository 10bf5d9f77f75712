# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A record of several users from a bag of a graph of nodes.

The mechanism is sampled once for all of them; device, analyser and controller of each are in a
namespace of its point's name.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.bag.recorded_states import states_from_bag
from hapticmech_ros.errors import BagError
from hapticmech_ros.experiment.from_bag import (
    Series,
    first_push_ns,
    held,
    never_pushed,
    read_series,
    record_of,
)
from hapticmech_ros.experiment.record import ExperimentRecord
from hapticmech_ros.experiment.shared_record import SharedRecord, couplings
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.scene import Scene
from hapticmech_ros.times import NANOSECONDS
from hapticmech_ros.wire.topic import Topic, users_of
from hapticmech_ros.wire.topics import POINT_COMMAND, POINT_FORCE


def shared_record_from_bag(
    path: str | os.PathLike[str],
    scene: Scene,
    namespace: str = "",
    duration: float | None = None,
) -> SharedRecord:
    """Return the run of several users that was recorded in the bag at ``path``.

    Time 0 is the first sample in which any hand pushes. Whenever the mechanism told F_c, X_ij is
    computed from its state, and F_j is the last command by then.

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
    pushes = [first_push_ns(found) for found in series.values()]
    pushed = [stamp for stamp in pushes if stamp is not None]
    if not pushed:
        raise never_pushed(path)
    start_ns = min(pushed)
    users = {
        point: record_of(path, found, scene.held_at(point), point, start_ns, duration)
        for point, found in series.items()
    }
    mechanism = Mechanism(scene)
    states = states_from_bag(path, mechanism, "", namespace)
    stamps = _stamps(series, users, start_ns)
    chosen = np.searchsorted(states.stamps_ns, stamps, side="right") - 1
    known = chosen >= 0
    if not known.any():
        raise BagError(f"bag {path}: nothing of the mechanism while the hands were there")
    stamps, chosen = stamps[known], chosen[known]
    return SharedRecord(
        users,
        (stamps - start_ns) / NANOSECONDS,
        # What answers a sample of this time acts from the next one on.
        _rows([found[POINT_COMMAND] for found in series.values()], stamps - 1),
        _rows([found[POINT_FORCE] for found in series.values()], stamps),
        couplings(
            mechanism,
            scene.held_points,
            states.q[chosen],
            [tuple(row) for row in states.active[chosen].tolist()],
        ),
    )


def _stamps(
    series: Mapping[str, Mapping[Topic, Series]],
    users: Mapping[str, ExperimentRecord],
    start_ns: int,
) -> Array:
    """Return when the mechanism told F_c during the run, ns; it does so of all points at once."""
    point, user = next(iter(users.items()))
    stamps, _ = series[point][POINT_FORCE]
    times = (stamps - start_ns) / NANOSECONDS
    return np.asarray(stamps[(times >= user.times[0]) & (times <= user.times[-1])])


def _rows(series: list[Series], stamps: Array) -> Array:
    """Return (k, n, 6) what each series had last by k stamps."""
    return np.stack([held(one, stamps) for one in series], axis=1)
