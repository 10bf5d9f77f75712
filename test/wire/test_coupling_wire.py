# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``transmission`` and ``coupling_gain``: layout, and what is refused."""

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.wire.layouts import CouplingMatrices, CouplingWire


def test_what_is_packed_is_unpacked_and_zero_is_nothing():
    wire = CouplingWire(["b", "c"], Limits())
    assert dict(wire.fields) == {"stamp": 2, "b": 36, "c": 36}
    matrix = np.arange(36.0).reshape(6, 6)
    stamp_ns = 1_700_000_000_123_456_789
    data = wire.pack(CouplingMatrices(stamp_ns, {"c": matrix}))
    assert data.tolist() == [
        *(1_700_000_000.0, 123_456_789.0),
        *([0.0] * 36),
        *np.arange(36.0).tolist(),
    ]
    found = wire.unpack(data)
    assert found.stamp_ns == stamp_ns
    assert list(found.by_point) == ["c"]
    assert np.array_equal(found.by_point["c"], matrix)


@pytest.mark.parametrize(
    ("at", "value", "words"),
    [(2, np.nan, "finite"), (37, np.inf, "finite"), (1, 1e9, "nanoseconds"), (3, 1e12, "ratio")],
)
def test_what_is_out_of_bounds_is_refused(at, value, words):
    wire = CouplingWire(["b"], Limits())
    data = wire.pack(CouplingMatrices(0, {}))
    data[at] = value
    with pytest.raises(InvalidInputError, match=words):
        wire.unpack(data)


def test_a_message_of_another_scene_is_refused():
    data = CouplingWire(["b", "c"], Limits()).pack(CouplingMatrices(0, {}))
    with pytest.raises(InvalidInputError, match="38 numbers"):
        CouplingWire(["b"], Limits()).unpack(data)
