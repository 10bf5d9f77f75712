# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0

from collections.abc import Iterator

import pytest

from hapticmech_ros.compilation.library import compile_ahead
from ros.harness import Peer, next_domain


@pytest.fixture(scope="session", autouse=True)
def compiled_kernels() -> None:
    compile_ahead()


@pytest.fixture
def domain() -> int:
    return next_domain()


@pytest.fixture
def peer(domain: int) -> Iterator[Peer]:
    peer = Peer(domain)
    yield peer
    peer.close()
