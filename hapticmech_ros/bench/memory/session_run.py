"""A session in this process, watched while it ticks."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

from hapticmech_ros.bench.memory.watch import Watch
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session

SAMPLES = 400
# Lines that tell how far it is.
TOLD = 20

Show = Callable[[str], None]


def watch_session(
    scene: Scene, ticks: int, show: Show = lambda line: None, samples: int = SAMPLES
) -> Watch:
    """Run a session for many ticks, and return how large the process was meanwhile.

    Args:
        scene: to run.
        ticks: how many.
        show: told of the progress.
        samples: how many; times are those of the simulation's clock, s.
    """
    session, processes, watch = Session(scene), {"session": os.getpid()}, Watch()
    tick, done, begun = session.tick, 0, time.perf_counter()
    watch.look(0.0, processes)
    for number in range(1, samples + 1):
        until = ticks * number // samples
        for _ in range(until - done):
            tick()
        done = until
        watch.look(session.time, processes)
        if number % max(samples // TOLD, 1) == 0:
            spent = time.perf_counter() - begun
            show(f"session: {session.time:.0f} s simulated in {spent:.0f} s")
    return watch
