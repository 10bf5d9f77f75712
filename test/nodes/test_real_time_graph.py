# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A graph in real time whose nodes are never late moves as the session does, tick by tick."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from benchmarks.reliability.fake_graph import ACTORS, FakeGraph
from hapticmech_ros import Session, load_scene
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import DeviceStateMessage
from ros.harness import scene_like

# Longer than a start's ramp, which begins some ticks later in a graph: until then all stand still.
WAIT_S, PUSHED_S = 0.8, 0.8
# A command is corrected by the newest gain, in the session by its own, a period older.
CLOSE = 1e-5


class Moved(NamedTuple):
    """What a device did from the first push on: F_h, positions (m) and twists, (n, ...)."""

    pushes: np.ndarray
    places: np.ndarray
    twists: np.ndarray

    @classmethod
    def of(cls, found):
        """Return that of (F_h, position, twist) at each tick."""
        pushes, places, twists = (np.array(column) for column in zip(*found, strict=True))
        begun = int(np.flatnonzero(np.abs(pushes).max(axis=1))[0])
        ticks = slice(begun, begun + round(PUSHED_S * 1000))
        return cls(pushes[ticks], places[ticks] - places[begun], twists[ticks])


@pytest.mark.parametrize("name", ["five_bar", "two_link"])
def test_a_graph_that_is_never_late_is_the_session(name, tmp_path):
    """A command acts from the tick after its arrival on, on device and mechanism alike.

    Were it to act a period earlier, as it could in a simulated device that is moved over the past
    period, the commands in flight would be counted twice: then twists differ by a percent.
    """
    hand = {"kind": "constant_wrench", "force": [-0.4, 0.2, 0.0], "start_delay": WAIT_S}
    path = scene_like(tmp_path, name, hand=hand)
    # Gains with every command, as the session has them.
    given = {"teleoperation_controller": {"view_rate": 1000.0}}
    graph = FakeGraph(path, actors=ACTORS[:4], parameters=given)
    ticks = round((WAIT_S + PUSHED_S) * 1000) + 50
    live, session = [], Session(load_scene(path))
    for _ in range(2 * ticks):
        graph.tick()
        if graph.now_ns % 1_000_000 == 0:
            seen = read(DeviceStateMessage, decode(graph.last["/device/state"])).sample
            live.append((seen.hand_wrench, seen.position, seen.twist))
    samples = [session.tick() for _ in range(ticks)]
    ours = Moved.of(live)
    theirs = Moved.of([(s.hand_wrench, s.device.pose.translation, s.device.twist) for s in samples])
    assert len(ours.twists) == len(theirs.twists) == round(PUSHED_S * 1000)
    assert np.array_equal(ours.pushes, theirs.pushes)
    largest = np.abs(theirs.twists).max()
    assert largest > 0.05
    assert np.abs(ours.twists - theirs.twists).max() < CLOSE * largest
    assert np.abs(ours.places - theirs.places).max() < CLOSE * np.abs(theirs.places).max()
