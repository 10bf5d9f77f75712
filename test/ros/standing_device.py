# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A haptic device whose thread of callbacks stands still for a while with each SIGUSR1."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from typing import Any

from hapticmech_ros.nodes import loop
from hapticmech_ros.nodes.entry import start

STANDS_S = 1.0


class Standing:
    """An executor that stands still, as one that waits for a lock of the middleware.

    Args:
        executor: that it is otherwise.
    """

    def __init__(self, executor: loop.Executor) -> None:
        self._executor, self._stands = executor, False
        asked.append(self._stand)

    def _stand(self) -> None:
        self._stands = True

    def __getattr__(self, name: str) -> Any:
        """Return what else the executor has."""
        return getattr(self._executor, name)

    def spin_once(self, timeout_sec: float) -> None:
        """Stand still if told to, else do what the executor does."""
        if self._stands:
            self._stands = False
            time.sleep(STANDS_S)
        self._executor.spin_once(timeout_sec=timeout_sec)


# Called by SIGUSR1.
asked: list[Callable[[], None]] = []

if __name__ == "__main__":
    signal.signal(signal.SIGUSR1, lambda *_: [stand() for stand in asked])
    made = loop.Threads.__init__
    loop.Threads.__init__ = lambda self, executor, exchange: made(  # type: ignore[method-assign]
        self, Standing(executor), exchange
    )
    sys.exit(start(["haptic_device"], sys.argv[1:]))
