"""Processes that share work, and end with the one that started them."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import connection, get_context, parent_process


def worker_pool(
    processes: int | None = None, prepare: Callable[..., None] | None = None, *given: object
) -> ProcessPoolExecutor:
    """Return a pool of fresh processes.

    A worker that is at work when its parent is killed would go on by itself: it watches, and ends.

    Args:
        processes: how many; one for each core if left out.
        prepare: called in each of them first.
        given: what it is called with.
    """
    start = (prepare, given)
    return ProcessPoolExecutor(processes or os.cpu_count(), get_context("spawn"), _begin, start)


def _begin(prepare: Callable[..., None] | None, given: tuple[object, ...]) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if prepare is not None:
        prepare(*given)


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
