# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node on a host whose clock is wrong.

python -m benchmarks.reliability.shifted_clock SECONDS NODE [--ros-args ...]
"""

from __future__ import annotations

import sys
import time


def main() -> int:
    """Run a node to which the machine's clock tells another time, by so many seconds."""
    shift_ns = round(float(sys.argv[1]) * 1e9)
    true_ns = time.time_ns
    time.time_ns = lambda: true_ns() + shift_ns
    from hapticmech_ros.nodes.entry import start

    return start(sys.argv[2].split(","), sys.argv[3:])


if __name__ == "__main__":
    sys.exit(main())
