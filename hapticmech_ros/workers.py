# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processes that share work, and end with the one that started them."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import connection, get_context, parent_process
from typing import TypeVar

from hapticmech_ros.errors import InvalidInputError

Given = TypeVar("Given")
Found = TypeVar("Found")


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
    # Workers share the processors among themselves; NumPy here has begun with its own threads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
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


def in_order(
    work: Callable[[Given], Found], cases: Sequence[Given], processes: int | None = None
) -> Iterator[Found]:
    """Yield what a function returns for each case, in their order.

    Args:
        work: a function of a module, and of nothing but its argument.
        cases: that processes can be given.
        processes: that share the cases; this one alone if 1, one for each core if None.

    Raises:
        InvalidInputError: no process.
    """
    if processes is not None and processes < 1:
        raise InvalidInputError("processes", processes, "must be 1 or more")
    if processes == 1:
        yield from map(work, cases)
        return
    # Forked, a process would lack the threads that this one has.
    with worker_pool(processes) as pool:
        yield from pool.map(work, cases)
