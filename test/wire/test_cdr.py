# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Our bytes are what ROS's own serialisation makes, and the other way round."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.wire.cdr import FlatArray, decode

KIND = "std_msgs/msg/Float64MultiArray"
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
VALUES = np.array([0.1, -2.5, 1e300, 5e-324, 0.0, 7.0])


def message(labels, values):
    dimension = TYPES["std_msgs/msg/MultiArrayDimension"]
    dims = [dimension(label, values.size, values.size) for label in labels]
    layout = TYPES["std_msgs/msg/MultiArrayLayout"](dims, 0)
    return TYPES[KIND](layout, values)


@pytest.mark.parametrize("name", ["a", "ab", "abc", "abcd", "abcde", "Λ_h⁻¹"])
def test_encodes_as_an_independent_library_does(name):
    fields = {name: 2, "rest": VALUES.size - 2}
    label = f"{name}:2,rest:{VALUES.size - 2}"
    expected = bytes(STORE.serialize_cdr(message([label], VALUES), KIND))
    assert FlatArray(fields).encode(VALUES) == expected


@pytest.mark.parametrize("labels", [[], [""], ["x"], ["row", "column"], ["a", "bcd", "efghi"]])
@pytest.mark.parametrize("size", [0, 1, 6])
def test_decodes_any_layout(labels, size):
    data = bytes(STORE.serialize_cdr(message(labels, VALUES[:size]), KIND))
    assert np.array_equal(decode(data), VALUES[:size])


def test_refuses_what_is_cut_short_or_something_else():
    whole = FlatArray({"values": VALUES.size}).encode(VALUES)
    for length in range(len(whole)):
        with pytest.raises(InvalidInputError):
            decode(whole[:length])
    with pytest.raises(InvalidInputError, match="little-endian"):
        decode(b"\x00\x00" + whole[2:])
    with pytest.raises(InvalidInputError):
        decode(whole[:4] + b"\xff\xff\xff\xff" + whole[8:])


def test_refuses_to_encode_the_wrong_size():
    with pytest.raises(InvalidInputError, match="shape"):
        FlatArray({"values": 3}).encode(np.zeros(4))
