# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A watchdog: a node that is alive and does nothing ends, and whatever started it may do so again.

The middleware may hold a lock for ever (rmw_fastrtps had such a fault with QoS events), while the
thread that waits for it holds Python's. So the watch is a kernel in a thread of its own, which asks
for neither.
"""

from __future__ import annotations

import faulthandler
import threading

import numpy as np

from hapticmech_ros.nodes.watch_kernels import ENDED, LOOK_US, ROUNDS, abort_when_still

# Longer than anything that a node's loop does at once, the loading of a large scene included.
STILL_S = 20.0


class Watchdog:
    """Aborts the process when its loop stands still, with a sentence and the stacks of its threads.

    A process that was stopped as a whole, by SIGSTOP or a debugger, goes on afterwards.

    Args:
        still_s: how long it may stand.
    """

    def __init__(self, still_s: float = STILL_S) -> None:
        faulthandler.enable()
        said = f"watchdog: the loop of this process has stood still for {still_s:g} s; aborted\n"
        padded = said.encode().rjust(-(-len(said) // 8) * 8)
        self._shared = np.zeros(2, dtype=np.int64)
        arguments = (
            self._shared,
            np.frombuffer(padded, dtype=np.int64).copy(),
            np.zeros(1, dtype=np.int64),
            max(1, round(still_s * 1e6 / LOOK_US)),
        )
        threading.Thread(target=abort_when_still, args=arguments, daemon=True).start()

    def go_round(self) -> None:
        """Note that the loop goes on."""
        self._shared[ROUNDS] += 1

    def end(self) -> None:
        """Watch no more."""
        self._shared[ENDED] = 1
