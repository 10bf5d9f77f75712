# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from hapticmech_ros.compilation.library import compile_ahead
from hapticmech_ros.graph import processes
from hapticmech_ros.graph.processes import private_environment
from ros import forked
from ros.harness import Peer, Statuses, next_domain


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Say of all tests of this folder that they start graphs."""
    for item in items:
        if item.path.parent == Path(__file__).parent:
            item.add_marker(pytest.mark.ros)


@pytest.fixture(scope="session", autouse=True)
def compiled_kernels() -> None:
    compile_ahead()


@pytest.fixture(autouse=True)
def graphs_are_forked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "start_process", forked.start)


@pytest.fixture(autouse=True)
def as_urgent_as_nodes(request: pytest.FixtureRequest) -> Iterator[None]:
    """Who watches nodes: two at nice -20 left a test no processor for minutes, or for a few ms.

    Who drives a device too, or is one: a hand that waits 30 ms for an answer is another device.

    Not where a test starts what should be less urgent than nodes, such as a demo's recorder.
    """
    before = os.getpriority(os.PRIO_PROCESS, 0)
    beside_others = "PYTEST_XDIST_WORKER" in os.environ and request.node.get_closest_marker("ros")
    devices = ("test_reliability", "test_foreign_drivers", "test_haply")
    if beside_others or request.path.stem.startswith(devices):
        with suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, -20)
    yield
    os.setpriority(os.PRIO_PROCESS, 0, before)


@pytest.fixture
def domain() -> int:
    return next_domain()


@pytest.fixture
def in_domain(domain: int, monkeypatch: pytest.MonkeyPatch) -> int:
    """Return a domain that this process and all that it starts are in."""
    for name, value in private_environment(domain).items():
        monkeypatch.setenv(name, value)
    return domain


@pytest.fixture
def peer(domain: int) -> Iterator[Peer]:
    peer = Peer(domain)
    yield peer
    peer.close()


@pytest.fixture
def statuses(peer: Peer) -> Statuses:
    """What nodes say of themselves, from before any of them begins."""
    return peer.statuses()


@pytest.fixture
def environment(domain: int) -> dict[str, str]:
    """Of processes that are to be in the test's domain."""
    return private_environment(domain)
