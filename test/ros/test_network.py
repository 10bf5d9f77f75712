# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Devices on another host, as far as one machine can be two: over a path of packets."""

import sys
from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest

# Development tools, beside the package.
sys.path.insert(0, str(FilePath(__file__).parents[2]))

from benchmarks.reliability.emulated_network import EmulatedNetwork, Path, not_permitted
from benchmarks.reliability.split_graph import SplitGraph, of_one_user, run_for
from benchmarks.reliability.users import (
    RESTS_AT,
    RETURNS_S,
    WAY,
    simulated,
    watched,
)
from sampling import only_long

pytestmark = pytest.mark.alone
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
        processes = of_one_user("five_bar", given, device)
        with SplitGraph(network, tmp_path, processes, domain) as graph:
            # A packet that is held back comes later than the declared delay and jitter say.
            events = [
                (1.3, lambda: network.set(replace(path, reordered=0.0))),
                (1.5, lambda: network.set(Path(out=True))),
                (2.5, lambda: network.set(path)),
            ]
            _, cut, mended = run_for(graph, 4.0, events)
            network.set()
            seen = graph.watched()[""]
    assert all(way["lost"] and way["held_back"] for way in network.counts.values())
    # The device's clock is 200 s behind that by which the path was cut.
    cut, mended = cut - 200.0, mended - 200.0
    assert 0.0 <= seen.zero_after(cut, mended) <= DELAY_S + MARGIN_S
    assert seen.back_after(mended) < 1.0
    assert seen.from_hand.min() >= -1e-3
    assert seen.round_trip[-1] > 2 * DELAY_S


# Less of two cores is taken so, and pauses of a machine with other work end nothing.
PERIOD_S, PATIENCE_S = 0.004, 0.1
PATIENT = {
    "haptic_device.command_timeout": PATIENCE_S,
    "teleoperation_controller.input_timeout": PATIENCE_S,
}


@pytest.mark.skipif(bool(REASON), reason=f"no network can be emulated here: {REASON}")
@pytest.mark.parametrize(
    "path",
    [Path(0.01, jitter=0.2, loss=0.05), *only_long(Path(0.05))],
    ids=lambda path: f"{1e3 * path.delay:.0f} ms",
)
def test_two_users_on_two_hosts_feel_each_other_and_the_loss_of_one_frees_only_him(
    domain: int, tmp_path: FilePath, path: Path
) -> None:
    # Again where the machine stalled: an arm that let go holds elsewhere then.
    seen = watched(path, tmp_path, PERIOD_S, settings=PATIENT, domain=domain, to_the_end=True)
    # Springs of 100 and 300 N/m balance at three quarters of the way of the far arm's target.
    assert pytest.approx(0.75 * WAY) == RESTS_AT
    assert seen.rests_at(seen.cut, 1.0) == pytest.approx(RESTS_AT, rel=0.01)
    # A session over the same path or, of a machine that adds to it (60 ms instead of 50), over the
    # delay that there was.
    paths = (path, Path(seen.delay(PERIOD_S)))
    sessions = [simulated(one, PERIOD_S) for one in paths]
    time, moved = seen.moved()
    off = [
        np.abs(moved - np.interp(time, known, expected))[time < known[-1]].max()
        for known, expected, _ in sessions
    ]
    # 80 mm/s at most: a graph is one to two periods later than a session, 0.6 mm. What is lost on
    # the way changes 0.03 mm.
    assert min(off) < 0.05 * WAY
    near, far, total = seen.energies()
    assert min(near, far) >= -1e-3
    # What the connections lack in sum is the delay's.
    lost = [least for _, _, least in sessions]
    assert min(lost) - 2e-3 <= total <= max(lost) + 2e-3
    for start, end in ((seen.cut, seen.mended), (seen.killed, seen.killed + RETURNS_S)):
        assert seen.held(start, end) > 0.95
        # The near arm alone holds the body then: e-fold in 0.25 s.
        assert seen.rests_at(start + RETURNS_S) == pytest.approx(0.0, abs=0.02 * WAY)
    assert seen.far.zero_after(seen.cut, seen.mended) <= path.delay + PATIENCE_S + MARGIN_S
    assert seen.far.back_after(seen.mended) < 1.0
    assert np.isfinite(seen.far.back_after(seen.killed))
