# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One run of ``hapticmech demo`` as a user starts it, and whether what it wrote is right."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.children import BenchError, output_to
from hapticmech_ros.analysis.study import number
from hapticmech_ros.graph.processes import start_process, stop_process

SCENE = "five_bar"
FIGURES = ("fig5a.png", "fig5b.png", "fig5c.png")
SUMMARY, LOG = "summary.json", "output.log"
# Of a summary: rate at which the graph was to run, Hz, and messages that the recorder has lost.
NOMINAL, LOST = "nominal_rate_hz", "recorder_lost"
# What a run of the graph is held to, as the project promises: its path to the session's; the median
# of the constraint force over what is expected, since of eighty samples one that lies beside the
# change of count, or rings after a late command, is as much as is allowed; and that change.
CHANGES = [(1, 2)]
APART = "from the session"
POSITION_MM, ROTATION_DEG, FORCE_GAIN, CHANGE_S = 0.5, 0.5, 0.02, 0.05


@dataclass(frozen=True, slots=True)
class DemoRun:
    """What was seen of one run. Figures are None where the summary has none.

    Attributes:
        seconds: from the start of the command to its end.
        failures: why it did not pass; none if it did.
        last_line: of what the command printed.
        graph: figures of the summary about the graph, by their names there.
    """

    seconds: float
    failures: tuple[str, ...]
    last_line: str
    graph: Mapping[str, Any] = field(default_factory=dict)

    def figure(self, name: str) -> float | None:
        """Return a figure about the graph; of one that advanced in lockstep only what was lost."""
        return None if self.graph.get("lockstep") and name != LOST else self.graph.get(name)

    @property
    def passed(self) -> bool:
        """Whether the command did its work, in time, and its physics is right."""
        return not self.failures


def demo_command(out: Path, duration: float | None) -> list[str]:
    """Return the command of a run.

    Args:
        out: folder for what it writes.
        duration: s that the hand pushes; the scene's if None.

    Raises:
        BenchError: hapticmech is not installed.
    """
    options = [] if duration is None else ["--duration", f"{duration:g}"]
    return [hapticmech(), "demo", SCENE, "--out", str(out), *options]


def hapticmech() -> str:
    """Return the path of the command.

    Raises:
        BenchError: it is not installed.
    """
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    if (command := shutil.which("hapticmech", path=path)) is None:
        raise BenchError("hapticmech is not installed: make .venv/package")
    return command


def watch_demo(command: Sequence[str], out: Path, limit_s: float) -> DemoRun:
    """Run a demo, end it where it takes too long, and look at what it wrote.

    The bag of a run that passed is removed: those of many runs fill a disk.

    Args:
        command: writes into ``out``.
        out: folder, removed before; ``output.log`` in it is what the command printed.
        limit_s: s that the command may take.
    """
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    begun = time.monotonic()
    with output_to(out / LOG):
        process = start_process(command, os.environ)
    failures: list[str] = []
    try:
        if code := process.wait(limit_s):
            failures.append(f"exit code {code}" if code > 0 else f"ended by signal {-code}")
    except subprocess.TimeoutExpired:
        failures.append(f"not done within {limit_s:g} s")
    finally:
        seconds = time.monotonic() - begun
        if process.poll() is None:
            stop_process(process)
    printed = (out / LOG).read_text(encoding="utf-8", errors="replace").split("\n")
    last = next((line.strip() for line in reversed(printed) if line.strip()), "")
    if not failures:
        failures = [f"no {name}" for name in (*FIGURES, SUMMARY) if not (out / name).is_file()]
    if failures:
        return DemoRun(seconds, tuple(failures), last)
    summary = json.loads((out / SUMMARY).read_text(encoding="utf-8"))
    failures += faults(summary)
    if not failures:
        shutil.rmtree(out / "bag")
    return DemoRun(seconds, tuple(failures), last, summary["graph"])


def faults(summary: Mapping[str, Any]) -> Iterator[str]:
    """Yield what of a run's summary is not as the physics is."""
    constraints, agreement = summary["constraints"], summary["agreement"]
    changes = [(change["from"], change["to"]) for change in constraints["changes"]]
    if changes != CHANGES:
        yield f"joint constraints change as {changes}, not {CHANGES}"
    elif not (late := agreement["count_change_difference_max_s"]) < CHANGE_S:
        yield f"the joint constraint is felt {late:.3f} s off the session's"
    for held in constraints["while_held"]:
        gain = held["force_gain_median"]
        if gain is None or not abs(gain - 1.0) <= FORCE_GAIN:
            seen = f"{number(gain, '.3f')} × the expected one"
            yield f"force with {held['count']} constraints: {seen}"
    for body in ("device", "point"):
        for unit, most in (("mm", POSITION_MM), ("deg", ROTATION_DEG)):
            if not (apart := agreement[f"{body}_deviation_max_{unit}"]) < most:
                yield f"{body}: {apart:.2g} {unit} {APART}"
