# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Padding between values says nothing: messages that differ only there are the same."""

import numpy as np

from bag.record import STORE
from hapticmech_ros.bag.compare import Deviations
from hapticmech_ros.wire.wrench import encode_wrench


def decode(data):
    return STORE.deserialize_cdr(data, "geometry_msgs/msg/WrenchStamped")


def test_garbage_in_the_padding_is_no_difference_and_a_sign_is_one():
    values = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    clean = encode_wrench(values, 7)
    dirty = clean[:22] + b"\x90\x12\xff\x00\x01\x02" + clean[28:]
    signed = encode_wrench(np.where(values == 0.0, -0.0, values), 7)
    found = Deviations(decode, decode)
    found.add(7, clean, dirty)
    assert (found.pairs, found.equal) == (1, 1)
    found.add(7, clean, signed)
    assert (found.pairs, found.equal) == (2, 1)
