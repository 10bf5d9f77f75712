# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Part ``disk``: a recorder fills its disk, where the nodes write their logs too.

The recorder says so and ends, what it wrote can be repaired, and the graph renders on.
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from pathlib import Path

from benchmarks.children import wait_until
from benchmarks.reliability.figure import Figure
from benchmarks.reliability.full_disk import FullDisk
from benchmarks.reliability.rig import Rig
from benchmarks.reliability.soak import growth, render
from benchmarks.reliability.trial import GOAL_PEAK
from hapticmech_ros.graph.processes import stop_process

FULL_S, QUICK_FULL_S = 600.0, 10.0
MEGABYTES = 4
FILLS_WITHIN_S = 120.0
LOOKS = 200
HAPTICMECH = [sys.executable, "-m", "hapticmech_ros"]


def run(quick: bool, out: Path) -> list[Figure]:
    """Let a graph render on a full disk for ten minutes (quick: seconds).

    Raises:
        NoDiskError: this machine lets nobody mount a disk in memory.
    """
    folder, told = out / "full_disk", out / "disk_recorder.log"
    bag, logs = folder / "bag", {"ROS_LOG_DIR": str(folder / "log")}
    with FullDisk(folder, MEGABYTES) as disk, Rig(out, "disk", variables=logs) as rig:
        rig.ready()
        with told.open("w") as log:
            record = [*HAPTICMECH, "bag", "record", "--all", "--out", str(bag)]
            recorder = subprocess.Popen(
                record, env=rig.environment, stdout=log, stderr=log, text=True
            )
        try:
            what = "the recorder to end with its disk full"
            wait_until(lambda: recorder.poll() is not None, FILLS_WITHIN_S, what, rig.check)
        finally:
            stop_process(recorder)
        disk.fill()
        found = render(rig, QUICK_FULL_S if quick else FULL_S, LOOKS)
        repaired = _repaired(bag, out)
    sentence = told.read_text(encoding="utf-8")
    plain = "No space left on device" in sentence and "Traceback" not in sentence
    return [
        Figure("rendered on a full disk for", found.seconds, "s", trials=1),
        Figure("largest force, of a clean run's", found.peak / rig.clean_max, "", GOAL_PEAK),
        Figure(
            "share of samples with force",
            found.pushed / max(found.samples, 1),
            "",
            None,
            0.99,
        ),
        Figure("samples", found.samples / found.seconds, "Hz"),
        Figure("rendering broke off", float(found.breaks), "times"),
        Figure("recorder: says that the disk is full", float(plain), "", None, 1.0, 1),
        Figure("recorder: exit code", float(recorder.returncode), "", 1.0, 1.0, 1),
        Figure("messages repaired of its bag", repaired, "", None, 1.0, 1),
        *(
            figure
            for node, held in found.held.items()
            for figure in growth(node, found.times, held, "resident memory")
        ),
    ]


def _repaired(bag: Path, out: Path) -> float:
    """Return how many messages of a bag that was cut short are found again, on another disk."""
    whole = out / f"disk_repaired_{time.time_ns()}"
    command = [*HAPTICMECH, "bag", "repair", str(bag), "--out", str(whole)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    found = re.search(r"(\d+) messages recovered", done.stdout)
    return float(found[1]) if found and done.returncode == 0 else 0.0
