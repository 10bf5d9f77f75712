# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages to put into bags, serialized by rosbags and not by the package."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from bag.record import STORE, WRENCH


@pytest.fixture(scope="session")
def wrench_bytes() -> Callable[[int, float], bytes]:
    """Serialize a WrenchStamped with a stamp (ns) and force (f, 2 f, -f)."""
    types = STORE.types
    vector = types["geometry_msgs/msg/Vector3"]

    def make(time_ns: int, f: float) -> bytes:
        stamp = types["builtin_interfaces/msg/Time"](*divmod(time_ns, 1_000_000_000))
        message = types[WRENCH](
            types["std_msgs/msg/Header"](stamp, "world"),
            types["geometry_msgs/msg/Wrench"](vector(f, 2 * f, -f), vector(0.0, 0.0, 0.5)),
        )
        return bytes(STORE.serialize_cdr(message, WRENCH))

    return make
