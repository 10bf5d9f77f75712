# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A device on another host, as far as one machine can be two: over a path of packets."""

import sys
from dataclasses import replace
from pathlib import Path as FilePath

import pytest

# Development tools, beside the package.
sys.path.insert(0, str(FilePath(__file__).parents[2]))

from benchmarks.reliability.emulated_network import EmulatedNetwork, Path, not_permitted
from benchmarks.reliability.split_graph import SplitGraph, run_for

pytestmark = [pytest.mark.ros, pytest.mark.alone]
REASON = not_permitted()
DELAY_S = 0.01
MARGIN_S = 0.02


@pytest.mark.skipif(bool(REASON), reason=f"no network can be emulated here: {REASON}")
def test_a_declared_network_is_rendered_over_and_its_loss_ends_every_force(
    domain: int, tmp_path: FilePath
) -> None:
    path = Path(DELAY_S, jitter=0.2, loss=0.05, reordered=0.05)
    given = {"network_delay": DELAY_S}
    with EmulatedNetwork(path, path) as network:
        # Off by minutes: nothing may depend on what time it is at the other end.
        device = (sys.executable, "-m", "benchmarks.reliability.shifted_clock", "-200")
        with SplitGraph(network, tmp_path, "five_bar", given, device, domain) as graph:
            # A packet that is held back comes later than the declared delay and jitter say.
            events = [
                (1.3, lambda: network.set(replace(path, reordered=0.0))),
                (1.5, lambda: network.set(Path(out=True))),
                (2.5, lambda: network.set(path)),
            ]
            _, cut, mended = run_for(graph, 4.0, events)
            network.set()
            seen = graph.watched()
    assert all(way["lost"] and way["held_back"] for way in network.counts.values())
    # The device's clock is 200 s behind that by which the path was cut.
    cut, mended = cut - 200.0, mended - 200.0
    assert 0.0 <= seen.zero_after(cut, mended) <= DELAY_S + MARGIN_S
    assert seen.back_after(mended) < 1.0
    assert seen.from_hand.min() >= -1e-3
    assert seen.round_trip[-1] > 2 * DELAY_S
