# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A late, uneven and lossy connection: what arrives, when, and that it is the same each time."""

import numpy as np
import pytest

from hapticmech_ros.control.kernels import drawn, mixed
from hapticmech_ros.control.loop_layout import ChannelState
from hapticmech_ros.control.rendering_controller import Channel
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.controller import Connection

MS = 1_000_000


def received(connection, messages, direction=0):
    """Return what a channel hands out each millisecond, for messages that are their own number."""
    line = Channel(connection, direction, 2, 1e-3)
    found = []
    for tick in range(messages):
        line.put(tick * MS, np.array([tick, -tick], dtype=float), 3 * tick)
        message = line.take(tick * MS)
        if message is not None:
            assert message[1] == -message[0]
            assert line.tag == 3 * message[0]
        found.append(None if message is None else int(message[0]))
    return found, line


@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_random_numbers_are_those_that_are_published():
    """SplitMix64's first ones from 0, of Vigna's splitmix64.c."""
    found = [int(mixed(number)) for number in range(4)]
    assert found == [
        0xE220A8397B1DCDAF,
        0x6E789E6AA1B965F4,
        0x06C45D188009454F,
        0xF88BB8A8724C81EC,
    ]
    assert drawn(2, 1) == found[3] / 2.0**64


@pytest.mark.filterwarnings("ignore:overflow encountered")
@pytest.mark.parametrize("direction", [0, 1])
@pytest.mark.parametrize("seed", [0, 5, 2**31 - 1])
@pytest.mark.parametrize(
    ("delay", "jitter", "loss"), [(0.0231, 0.7, 0.1), (0.0, 0.0, 0.0), (0.007, 0.0, 0.05)]
)
def test_it_is_late_and_lossy_as_its_random_numbers_say(delay, jitter, loss, seed, direction):
    connection = Connection(delay=delay, jitter=jitter, loss=loss, seed=seed)
    found, channel = received(connection, 5000, direction)
    stream = int(mixed(2 * seed + direction))
    assert ChannelState(channel.state).stream % 2**64 == stream
    due = {}
    for number in range(5000):
        if drawn(stream, 2 * number) >= loss:
            late = delay * (1.0 + jitter * (2.0 * drawn(stream, 2 * number + 1) - 1.0))
            arrives = -(-(number * MS + round(1e9 * late)) // MS)
            due.setdefault(arrives, []).append(number)
    newest = -1
    for tick, message in enumerate(found):
        new = max(due.get(tick, [-1]))
        assert message == (new if new > newest else None)
        newest = max(newest, new)
    assert channel.lost == 5000 - sum(map(len, due.values()))
    assert (channel.lost > 0) == (loss > 0.0)


def test_more_messages_than_the_period_allows_are_refused():
    line = Channel(Connection(delay=0.01), 0, 1, 1e-3)
    for _ in range(12):
        line.put(5, np.zeros(1))
    with pytest.raises(InvalidInputError, match="a period after the last message"):
        line.put(5, np.zeros(1))


def test_there_are_two_directions():
    with pytest.raises(InvalidInputError, match=r"direction: must be 0 or 1 \(got 2\)"):
        Channel(Connection(), 2, 1, 1e-3)
