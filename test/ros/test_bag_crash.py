# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A recorder that is killed while messages stream in."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import pytest

from hapticmech_ros.bag import BagReader
from hapticmech_ros.bag.mcap_file import McapScan
from hapticmech_ros.bag.repair import repair
from hapticmech_ros.bag.sqlite_file import SqliteScan
from hapticmech_ros.errors import BagError
from hapticmech_ros.wire.cdr import decode
from ros.bag_processes import bag_command, steady_publisher

pytestmark = pytest.mark.alone

RATE_HZ = 2000.0
ENOUGH = 4000
WAIT_S = 60.0


def messages_on_disk(folder: Path, storage: str, scratch: Path) -> int:
    count = 0
    for file in folder.glob("*.mcap" if storage == "mcap" else "*.db3"):
        scan = McapScan(file) if storage == "mcap" else SqliteScan(file, scratch)
        count += sum(found.data is not None for found in scan)
    return count


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_kill_costs_the_last_second_at_most(storage: str, domain: int, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    with (
        bag_command(domain, "record", "/steady", "--out", bag, "--storage", storage) as recorder,
        steady_publisher(domain, "/steady", RATE_HZ),
    ):
        end = time.monotonic() + WAIT_S
        while messages_on_disk(bag, storage, tmp_path) < ENOUGH:
            assert time.monotonic() < end, "the recorder writes nothing"
            assert recorder.poll() is None
            time.sleep(0.2)
        killed_ns = time.time_ns()
        recorder.send_signal(signal.SIGKILL)
        assert recorder.wait() == -signal.SIGKILL
    with pytest.raises(BagError, match="hapticmech bag repair"):
        BagReader(bag)
    report = repair(bag)
    with BagReader(report.path) as reader:
        rows = [decode(data) for _, _, data in reader.serialized("/steady")]
    indices = [int(row[2]) for row in rows]
    assert indices == list(range(indices[0], indices[0] + len(indices)))
    newest_ns = int(rows[-1][0]) * 10**9 + int(rows[-1][1])
    assert newest_ns > killed_ns - 10**9
    assert report.messages == len(rows) >= ENOUGH
