from collections.abc import Iterator

import pytest

from ros.harness import Peer, next_domain


@pytest.fixture
def domain() -> int:
    return next_domain()


@pytest.fixture
def peer(domain: int) -> Iterator[Peer]:
    peer = Peer(domain)
    yield peer
    peer.close()
