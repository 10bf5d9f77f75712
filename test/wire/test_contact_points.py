# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Points of contact on the wire: what goes in comes out, and what is wrong is refused."""

import numpy as np
import pytest

from hapticmech_ros.contact.memory import Touching
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.contact_points import ContactLayout

LAYOUT = ContactLayout(("floor", "wall"))


def touching(count):
    rng = np.random.default_rng(count)
    vectors = rng.normal(size=(4, count, 3))
    pairs = np.sort(rng.integers(0, 2, count))
    depths = rng.normal(size=count)
    return Touching(pairs, vectors[0], vectors[1], depths, vectors[2], vectors[3], np.zeros(2))


@pytest.mark.parametrize("count", [0, 1, 8])
def test_what_goes_in_comes_out(count):
    given = touching(count)
    found = LAYOUT.unpack(decode(LAYOUT.encode(given, 12_000_000_034)))
    assert found.stamp_ns == 12_000_000_034
    for name in ("pairs", "points", "normals", "depths", "forces"):
        assert (getattr(found, name) == getattr(given, name)).all(), name


def test_nothing_known_is_nothing_that_touches():
    assert LAYOUT.encode(None, 5) == LAYOUT.encode(touching(0), 5)


def broken(at, value):
    data = decode(LAYOUT.encode(touching(2), 0)).copy()
    data[at] = value
    return data


@pytest.mark.parametrize(
    "data",
    [
        np.zeros(0),
        np.zeros(1),
        np.zeros(14),
        broken(2, 2.0),
        broken(2, -1.0),
        broken(13, 0.5),
        broken(7, np.nan),
        broken(7, np.inf),
    ],
    ids=str,
)
def test_bad_messages_are_refused(data):
    with pytest.raises(InvalidInputError):
        LAYOUT.unpack(data)


def test_a_pairs_own_wrench_is_about_shape_a():
    given = touching(6)
    for pair in range(2):
        mine = given.pairs == pair
        arms = given.points[mine] - given.origins[mine]
        wanted = np.concatenate(
            (given.forces[mine].sum(axis=0), np.cross(arms, given.forces[mine]).sum(axis=0))
        )
        assert given.wrench(pair) == pytest.approx(wanted, abs=1e-15)
        # About another point it is the same wrench, moved there.
        place = np.array((0.3, -0.2, 0.1))
        shift = np.cross(given.origins[mine] - place, given.forces[mine]).sum(axis=0)
        assert given.wrench(pair, place)[3:] == pytest.approx(wanted[3:] + shift, abs=1e-14)
