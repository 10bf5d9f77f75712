# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""States on the wire: what is packed is unpacked again, and what breaks a rule is refused."""

import numpy as np
import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.state import StateLayout, WireState
from oracles.generator import random_mechanism
from oracles.posed import posed_sample

STAMP = 12_345_678_901_234_567


def layouts():
    """Return layouts where q is a vector and where it is not, and a configuration of each."""
    mechanism = Mechanism(load_scene("five_bar"))
    yield StateLayout(mechanism), mechanism, np.array([1.9, -0.0, -1.8, 0.6])
    for seed in range(4):
        pair = posed_sample(random_mechanism(seed))
        yield StateLayout(pair.mechanism), pair.mechanism, pair.q


def state_of(mechanism, q):
    points = len(mechanism.point_names)
    v = np.linspace(-1.0, 1.0, mechanism.nv)
    contacts = np.arange(6.0 * points).reshape(points, 6)
    active = tuple(index % 2 == 0 for index in range(len(mechanism.closures)))
    grasps = flat_grasps(mechanism.scene)
    received = tuple(i % 2 == 1 for i in range(points))
    return WireState(STAMP, active, q, v, contacts, grasps, received)


@pytest.fixture
def five_bar():
    """A layout, and a state of it."""
    layout, mechanism, q = next(layouts())
    return layout, state_of(mechanism, q)


@pytest.mark.parametrize(("layout", "mechanism", "q"), list(layouts()))
def test_what_is_packed_is_unpacked(layout, mechanism, q):
    state = state_of(mechanism, q)
    data = layout.pack(state)
    assert data.shape == (sum(layout.fields.values()),)
    found = layout.unpack(data)
    assert found.stamp_ns == state.stamp_ns
    assert found.active == state.active
    assert found.commanded == state.commanded
    assert all(type(flag) is bool for flag in (*found.active, *found.commanded))
    assert found.v.tobytes() == state.v.tobytes()
    assert found.contacts.tobytes() == state.contacts.tobytes()
    # On the manifold there and back again, of q of length 1 at most; quaternions up to their sign.
    if mechanism.nq == mechanism.nv:
        assert found.q.tobytes() == q.tobytes()
    else:
        assert np.abs(mechanism.coordinates(found.q) - mechanism.coordinates(q)).max() < 1e-12


def test_parts_are_where_the_label_says(five_bar):
    layout, state = five_bar
    parts = np.split(layout.pack(state), np.cumsum(list(layout.fields.values()))[:-1])
    expected = (
        divmod(STAMP, 1_000_000_000),
        state.active,
        state.q,
        state.v,
        state.contacts.ravel(),
        state.grasps.ravel(),
        state.commanded,
    )
    for found, part in zip(parts, expected, strict=True):
        assert (found == np.array(part, dtype=float)).all()


def test_what_is_unpacked_is_a_copy(five_bar):
    layout, state = five_bar
    data = layout.pack(state)
    found = layout.unpack(data)
    data[:] = 0.0
    assert found.q.tobytes() == state.q.tobytes()


@pytest.mark.parametrize(
    ("field", "key"),
    [("v", "joint_velocity"), ("q", "joint_position"), ("contacts", "force"), ("grasps", "angle")],
)
def test_numbers_beyond_what_the_scene_allows_are_refused(five_bar, field, key):
    layout, state = five_bar
    value = getattr(state, field).copy()
    value.flat[0 if field == "contacts" else -1] = -1e200
    data = layout.pack(state._replace(**{field: value}))
    with pytest.raises(InvalidInputError, match=f"at most .*{key}.*-1e\\+200"):
        layout.unpack(data)
    with pytest.raises(InvalidInputError, match=key):
        layout.unpack_all(np.stack((layout.pack(state), data)))


@pytest.mark.parametrize("stamp", [(1.797e308, 0.0), (-1.0, 0.0), (1.5, 0.0), (2.0**31, 0.0)])
def test_stamps_that_are_none_are_refused(five_bar, stamp):
    layout, state = five_bar
    data = layout.pack(state)
    data[:2] = stamp
    for read in (layout.unpack, lambda row: layout.unpack_all(row[None])):
        with pytest.raises(InvalidInputError, match="stamp"):
            read(data)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_refused(five_bar, bad):
    layout, state = five_bar
    for index in range(sum(layout.fields.values())):
        data = layout.pack(state)
        data[index] = bad
        with pytest.raises(InvalidInputError, match=rf"state message\[{index}\]"):
            layout.unpack(data)


def test_wrong_lengths_and_flags_are_refused(five_bar):
    layout, state = five_bar
    data = layout.pack(state)
    for wrong in (data[:-1], np.append(data, 0.0), np.zeros(0), data.reshape(1, -1)):
        with pytest.raises(InvalidInputError, match="must hold"):
            layout.unpack(wrong)
    for index in (2, -1):
        for flag in (0.5, 2.0, -1.0):
            bad = data.copy()
            bad[index] = flag
            with pytest.raises(InvalidInputError, match="flags"):
                layout.unpack(bad)


def test_many_messages_are_unpacked_as_each_of_them_is():
    for layout, mechanism, q in layouts():
        states = [state_of(mechanism, q)._replace(stamp_ns=STAMP + n) for n in range(20)]
        states[7] = states[7]._replace(active=(False,) * len(mechanism.closures))
        rows = [layout.pack(state._replace(v=n * state.v)) for n, state in enumerate(states)]
        wire = FlatArray(layout.fields)
        decoded = wire.decode_all([wire.encode(row) for row in rows])
        assert decoded.tobytes() == np.array(rows).tobytes()
        found = layout.unpack_all(decoded)
        for index, row in enumerate(rows):
            one = layout.unpack(row)
            assert found.stamps_ns[index] == one.stamp_ns
            assert tuple(found.active[index].tolist()) == one.active
            assert found.q[index].tobytes() == one.q.tobytes()
            assert found.v[index].tobytes() == one.v.tobytes()


@pytest.mark.parametrize(("place", "value"), [(0, np.nan), (2, 0.5), (-1, 2.0), (5, np.inf)])
def test_of_many_messages_the_first_bad_one_is_refused_as_alone(place, value):
    layout = StateLayout(Mechanism(load_scene("five_bar")))
    rows = np.zeros((5, sum(layout.fields.values())))
    rows[3, place] = rows[4, 2] = value
    with pytest.raises(InvalidInputError) as alone:
        layout.unpack(rows[3])
    with pytest.raises(InvalidInputError) as among:
        layout.unpack_all(rows)
    assert str(among.value) == str(alone.value)


def test_many_messages_of_another_layout_are_decoded_too_unless_their_size_differs():
    mine, other = FlatArray({"a": 2, "b": 1}), FlatArray({"abc": 3})
    values = np.array([1.0, 2.0, 3.0])
    mixed = [mine.encode(values), other.encode(2.0 * values)]
    assert mine.decode_all(mixed).tolist() == [[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]]
    assert mine.decode_all([]).shape == (0, 3)
    with pytest.raises(InvalidInputError, match="shape"):
        mine.decode_all([*mixed, FlatArray({"a": 2}).encode(values[:2])])
