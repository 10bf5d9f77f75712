# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work shared by processes, which end with the one that started them, or by a cluster's.

Scheduler and workers of a Dask cluster run any code that they are sent, as the user who started
them, and their messages are not encrypted unless the address begins with ``tls://``.
"""

from __future__ import annotations

import os
import platform
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from multiprocessing import connection, get_context, parent_process
from typing import Any, Generic, TypeVar

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.system.installation import refuse_unmet

Given = TypeVar("Given")
Found = TypeVar("Found")
# A number of processes, 1 being this one; one for each core if None; or an executor, of whatever
# processes: one of concurrent.futures, or of Dask.
Workers = int | Executor | None
# Cases that are given to each process, or to an executor, before an answer has come.
AHEAD, AHEAD_ELSEWHERE = 2, 4096


@dataclass(frozen=True, slots=True)
class Lost(Generic[Given]):
    """A case that has no answer: its worker ended, and so did the one that tried it once more.

    Attributes:
        case: that was given.
    """

    case: Given

    def __str__(self) -> str:
        return f"{self.case}: the process that worked at it was ended, twice"


class LostError(HapticMechError):
    """A case without which the others are worth nothing was lost."""


def worker_pool(processes: int | None = None) -> ProcessPoolExecutor:
    """Return a pool of fresh processes.

    A worker that is at work when its parent is killed would go on by itself: it watches, and ends.

    Args:
        processes: how many; one for each core if left out.
    """
    # Workers share the processors among themselves; NumPy here has begun with its own threads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    return ProcessPoolExecutor(processes or os.cpu_count(), get_context("spawn"), _watch_parent)


def _watch_parent() -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


class WorkerPool(AbstractContextManager["WorkerPool"]):
    """Shares cases among workers; a context that ends its own processes on exit.

    A worker that is killed, or out of memory, loses only its own case: the others in progress are
    tried once more, each by a separate process. An executor passed as ``workers`` is left open, and
    its lost cases stay lost: a cluster's tries again by itself.

    Args:
        workers: that share the cases.

    Raises:
        InvalidInputError: no process.
    """

    def __init__(self, workers: Workers = 1) -> None:
        if isinstance(workers, int) and workers < 1:
            raise InvalidInputError("processes", workers, "must be 1 or more")
        self._workers = workers
        self._pool: ProcessPoolExecutor | None = None

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)

    @property
    def processes(self) -> int | None:
        """How many processes share the work; None if an executor knows."""
        if isinstance(self._workers, Executor):
            return None
        return self._workers or os.cpu_count() or 1

    def completed(
        self, work: Callable[[Given], Found], cases: Iterable[Given]
    ) -> Iterator[tuple[int, Found | Lost[Given]]]:
        """Yield the index of each case and the function's result for it, as results come.

        Args:
            work: a function of a module, and of nothing but its argument.
            cases: that processes can be given.
        """
        if self._workers == 1:
            yield from ((index, work(case)) for index, case in enumerate(cases))
            return
        left, again = enumerate(cases), deque[tuple[int, Given]]()
        ahead = AHEAD_ELSEWHERE if self.processes is None else AHEAD * self.processes
        flying: dict[Future[Found], tuple[int, Given]] = {}
        while True:
            for index, case in islice(left, ahead - len(flying)):
                try:
                    flying[self._executor().submit(work, case)] = index, case
                except BrokenExecutor:
                    again.append((index, case))
                    break
            if not flying and not again:
                return
            done = wait(flying, return_when=FIRST_COMPLETED).done if flying else set()
            if again or any(map(_is_lost, done)):
                # A pool that lost a worker answers none of those that were given to it.
                done = self._drained(flying) or done
            for future in done:
                index, case = flying.pop(future)
                if _is_lost(future):
                    again.append((index, case))
                else:
                    yield index, future.result()
            while again:
                index, case = again.popleft()
                yield index, self._once_more(work, case)

    def in_order(
        self, work: Callable[[Given], Found], cases: Iterable[Given]
    ) -> Iterator[Found | Lost[Given]]:
        """Yield the results of :meth:`completed` in the order of the cases."""
        early: dict[int, Found | Lost[Given]] = {}
        following = 0
        for index, found in self.completed(work, cases):
            early[index] = found
            while following in early:
                yield early.pop(following)
                following += 1

    def answers(self, work: Callable[[Given], Found], cases: Iterable[Given]) -> Iterator[Found]:
        """Yield a function's result for each case, in their order.

        Raises:
            LostError: a case was lost.
        """
        for found in self.in_order(work, cases):
            if isinstance(found, Lost):
                raise LostError(str(found))
            yield found

    def _executor(self) -> Executor:
        if isinstance(self._workers, Executor):
            return self._workers
        if self._pool is None:
            # Forked, a process would lack the threads that this one has.
            self._pool = worker_pool(self.processes)
        return self._pool

    def _drained(self, flying: Collection[Future[Any]]) -> set[Future[Any]]:
        """Return all futures of workers, one of which died, when done; drop an own pool.

        Dask blames every task that waits at a dying worker: a retry must be there alone.
        """
        found = wait(flying).done
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
        return found

    def _once_more(self, work: Callable[[Given], Found], case: Given) -> Found | Lost[Given]:
        given = self._workers
        with nullcontext(given) if isinstance(given, Executor) else worker_pool(1) as pool:
            try:
                future = pool.submit(work, case)
                return Lost(case) if _is_lost(future) else future.result()
            except BrokenExecutor:
                return Lost(case)


def _is_lost(future: Future[Any]) -> bool:
    error = future.exception()
    # KilledWorker is Dask's, which need not be installed.
    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"


def in_order(
    work: Callable[[Given], Found], cases: Iterable[Given], workers: Workers = None
) -> Iterator[Found | Lost[Given]]:
    """Yield a function's result for each case, in their order.

    Args:
        work: a function of a module, and of nothing but its argument.
        cases: that processes can be given.
        workers: that share the cases.

    Raises:
        InvalidInputError: no process.
    """
    with WorkerPool(workers) as pool:
        yield from pool.in_order(work, cases)


def answers(
    work: Callable[[Given], Found], cases: Iterable[Given], workers: Workers = None
) -> Iterator[Found]:
    """Yield the results of :func:`in_order`, where no case may be lost.

    Raises:
        LostError: one was.
        InvalidInputError: no process.
    """
    with WorkerPool(workers) as pool:
        yield from pool.answers(work, cases)


# The same as the extra ``cluster`` in setup.py.
DASK = "distributed>=2024.5"
# s until a scheduler has answered, and has a worker.
PATIENCE = 20.0


class _OfCluster(Executor):
    """A client's workers as an executor.

    Dask's own, ``Client.get_executor``, ends with a ValueError if a worker dies after its answer
    but before the answer arrives, and the task is repeated.

    Args:
        client: of Dask.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, work: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """Return the future of a call by a worker; arguments as of ``Executor.submit``."""
        found: Future[Any] = Future()
        # Equal calls are done separately, by any free worker.
        there = self._client.submit(work, *given, pure=False, **named)
        there.add_done_callback(partial(_hand_over, found))
        return found


def _hand_over(found: Future[Any], there: Any) -> None:
    """Fill a future with the outcome of a task of Dask."""
    try:
        result = there.result()
    except CancelledError:
        found.cancel()
        # This wakes a caller that waits for several futures.
        found.set_running_or_notify_cancel()
    except Exception as error:  # noqa: BLE001 - any error goes to the waiting caller
        found.set_exception(error)
    else:
        found.set_result(result)


class ClusterError(HapticMechError):
    """A cluster that cannot be used: no answer, or its workers have other packages."""


@contextmanager
def cluster(address: str, patience: float = PATIENCE) -> Iterator[Executor]:
    """Yield an executor whose workers are those of a Dask cluster.

    Args:
        address: of its scheduler, such as ``tcp://10.0.0.5:8786``.
        patience: s, for the scheduler to answer, and for its first worker.

    Raises:
        InstallationError: Dask is not installed.
        InvalidInputError: no address of a scheduler.
        ClusterError: no answer, no worker, or one that does not answer, or has another Python or
            another version of a package that affects results; or the scheduler goes away.
    """
    refuse_unmet([DASK])
    if not address.startswith(("tcp://", "tls://")):
        raise InvalidInputError("cluster", address, "must be tcp://HOST:PORT, or tls://")
    # Imported here: it takes a second, and only clusters need it.
    from distributed import Client

    try:
        client = Client(address, timeout=patience, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(f"no scheduler of Dask answers at {address}: {error}") from None
    with client:
        end = time.monotonic() + patience
        while not _can_work(_versions_there(client, address, patience), address):
            if time.monotonic() > end:
                raise ClusterError(f"the scheduler at {address} has no worker")
            time.sleep(0.1)
        try:
            yield _OfCluster(client)
        except CancelledError:
            raise ClusterError(f"the scheduler at {address} has gone") from None


def versions() -> dict[str, str]:
    """Return the versions of packages that affect results, by name; of Python to its minor one."""
    found = {"python": ".".join(platform.python_version_tuple()[:2])}
    for name in ("hapticmech_ros", "numpy", "pin", "numba"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found


def _versions_there(client: Any, address: str, patience: float) -> Mapping[str, object]:
    """Return the versions that each worker reports.

    Raises:
        ClusterError: one does not answer: it is frozen, or its machine is.
    """
    try:
        found = client.run(versions, on_error="return", callback_timeout=patience)
    except TimeoutError:
        workers = ", ".join(client.scheduler_info()["workers"])
        rule = f"a worker of {address} does not answer within {patience:g} s"
        raise ClusterError(f"{rule}: {workers}") from None
    return dict(found)


def _can_work(found: Mapping[str, object], address: str) -> bool:
    """Return whether a worker answers; none may have other packages than this process.

    Raises:
        ClusterError: one has.
    """
    own, answered = versions(), False
    for worker, there in found.items():
        # One that died a moment ago is still known to the scheduler.
        if isinstance(there, OSError):
            continue
        if not isinstance(there, Mapping):
            raise ClusterError(f"worker {worker} of {address} cannot take work: {there}")
        other = [name for name in own if there[name] != own[name]]
        if other:
            text = "; ".join(f"{name} {there[name]}, not {own[name]}" for name in other)
            raise ClusterError(f"worker {worker} of {address} has {text}")
        answered = True
    return answered
