# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Processes of a Dask cluster as an executor, for whatever shares its work among workers.

Scheduler and workers are whoever's who started them: they run what they are sent, and their
messages are not encrypted unless the address says ``tls://``.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.installation import refuse_unmet

# The extra ``cluster`` in setup.py says the same.
DASK = "distributed>=2024.5"
# s until a scheduler has answered, and has a worker.
PATIENCE = 20.0


class _OfCluster(Executor):
    """A client's workers as an executor.

    Dask has one, ``Client.get_executor``, which ends with a ValueError of its own where a worker
    dies between its answer and the answer's way here, and the task is done again.

    Args:
        client: of Dask.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, work: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """Return the future of a call by a worker; arguments as of ``Executor.submit``."""
        found: Future[Any] = Future()
        # The same call twice is done twice, by whoever is free.
        there = self._client.submit(work, *given, pure=False, **named)
        there.add_done_callback(partial(_hand_over, found))
        return found


def _hand_over(found: Future[Any], there: Any) -> None:
    """Fill a future with what became of a task of Dask."""
    try:
        result = there.result()
    except CancelledError:
        found.cancel()
        # Only so does whoever waits for several wake up.
        found.set_running_or_notify_cancel()
    except Exception as error:  # noqa: BLE001 - whatever it was: who waits for it is told
        found.set_exception(error)
    else:
        found.set_result(result)


class ClusterError(HapticMechError):
    """A cluster that cannot be used: nobody answers, or its workers have other packages."""


@contextmanager
def cluster(address: str, patience: float = PATIENCE) -> Iterator[Executor]:
    """Yield an executor whose workers are those of a Dask cluster.

    Args:
        address: of its scheduler, such as ``tcp://10.0.0.5:8786``.
        patience: s, for the scheduler to answer, and for its first worker.

    Raises:
        InstallationError: Dask is not installed.
        InvalidInputError: no address of a scheduler.
        ClusterError: nobody answers, there is no worker, or one does not answer, has another Python
            or another version of what the results depend on; or the scheduler goes away.
    """
    refuse_unmet([DASK])
    if not address.startswith(("tcp://", "tls://")):
        raise InvalidInputError("cluster", address, "must be tcp://HOST:PORT, or tls://")
    # Here, as it takes a second, and only clusters need it.
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
    """Return the versions of what results depend on, by package; of Python to its minor one."""
    found = {"python": ".".join(platform.python_version_tuple()[:2])}
    for name in ("hapticmech_ros", "numpy", "pin", "numba"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found


def _versions_there(client: Any, address: str, patience: float) -> Mapping[str, object]:
    """Return what each worker says of its versions.

    Raises:
        ClusterError: one is there, and says nothing: it is frozen, or its machine is.
    """
    try:
        found = client.run(versions, on_error="return", callback_timeout=patience)
    except TimeoutError:
        workers = ", ".join(client.scheduler_info()["workers"])
        rule = f"of the workers of {address} one does not answer within {patience:g} s"
        raise ClusterError(f"{rule}: {workers}") from None
    return dict(found)


def _can_work(found: Mapping[str, object], address: str) -> bool:
    """Return whether a worker answers, none of which has other packages than this process.

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
            said = "; ".join(f"{name} {there[name]}, not {own[name]}" for name in other)
            raise ClusterError(f"worker {worker} of {address} has {said}")
        answered = True
    return answered
