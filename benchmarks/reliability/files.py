# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mutants of every kind of file that the package reads: crashes, hangs, tracebacks, memory."""

from __future__ import annotations

import json
import math
import shutil
import tempfile
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.reliability.figure import Figure
from benchmarks.reliability.file_worker import Case, Mutants, read_mutant
from benchmarks.reliability.usage import blocks, grown
from hapticmech_ros.compilation.library import compile_ahead
from hapticmech_ros.system.workers import Lost, WorkerPool

QUICK, FULL = 300, 100_000
WORKERS = 2
SEED = 15
# s of the processor that a file may take, and of real time: the machine may have other work.
HANG_S, PATIENCE_S = 5.0, 60.0
# s that a file may take without its process running or waiting for the processor. Where a child of
# it reads the file, the child's waiting counts.
BLOCKED_S = 10.0
# MB above what a worker had that a file may take, well below where allocations fail (file_worker);
# and by how much a worker may grow in its share of the full campaign, 50,000 files.
MOST_MB, GROWTH_MB = 1000.0, 20.0
# Medians of so many parts of a worker's life are compared; it needs so many files to tell.
PARTS, LEAST_FILES = 400, 40
WORST = ("seconds", "real_s", "blocked_s", "memory_mb")


@dataclass(slots=True)
class Tally:
    """What became of mutants.

    Attributes:
        outcomes: how many were read and refused, by kind.
        crashes, hangs, foreign: what was found, by the mutant's number.
        worst: the largest of what workers say: ``seconds`` of the processor for one file;
            ``real_s`` and ``blocked_s``, of real time, and without what it ran or was queued for;
            ``memory_mb`` that a worker, or a child of it, took above what it had.
        resident_mb: in memory after each file, by process.
    """

    outcomes: Counter[tuple[str, str]] = field(default_factory=Counter)
    crashes: dict[int, str] = field(default_factory=dict)
    hangs: dict[int, str] = field(default_factory=dict)
    foreign: dict[int, str] = field(default_factory=dict)
    worst: dict[str, float] = field(default_factory=lambda: dict.fromkeys(WORST, 0.0))
    resident_mb: dict[int, list[float]] = field(default_factory=lambda: defaultdict(list))

    def add(self, number: int, said: dict[str, Any]) -> None:
        """Count what a worker says of a mutant."""
        kind, outcome = str(said["kind"]), str(said["outcome"])
        self.outcomes[kind, outcome.split(":")[0]] += 1
        self.worst = {name: max(before, said[name]) for name, before in self.worst.items()}
        self.resident_mb[said["process"]].append(said["resident_mb"])
        if outcome.startswith("foreign"):
            self.foreign[number] = f"{kind}: {outcome}"
        if said["seconds"] > HANG_S:
            self.hangs[number] = f"{kind}: {said['seconds']:.1f} s"
        elif said["blocked_s"] > BLOCKED_S:
            self.hangs[number] = f"{kind}: blocked for {said['blocked_s']:.1f} s"

    def silent(self, number: int) -> None:
        """Count a mutant of which nothing was heard until patience ended."""
        self.hangs[number] = f"nothing for {PATIENCE_S:g} s"
        for name in ("real_s", "blocked_s"):
            self.worst[name] = max(self.worst[name], PATIENCE_S)

    @property
    def growth_mb(self) -> float:
        """By how much a worker grew after its first quarter; NaN if none read enough to tell."""
        lives = [one for one in self.resident_mb.values() if len(one) >= LEAST_FILES]
        medians = [blocks(life, PARTS) for life in lives]
        return max((grown(range(len(one)), one.tolist()) for one in medians), default=math.nan)


def read_mutants(number: int, folder: Path, patience_s: float = PATIENCE_S) -> Tally:
    """Read so many mutants, shared by processes that write into a folder."""
    tally = Tally()
    cases = [Case(folder, SEED, index, patience_s) for index in range(number)]
    with WorkerPool(WORKERS) as pool:
        for index, said in pool.completed(read_mutant, cases):
            if not isinstance(said, Lost):
                tally.add(index, said)
            elif cases[index].hang.exists() and cases[index].hang.stat().st_size:
                tally.silent(index)
            else:
                tally.crashes[index] = "its process ended, twice"
    return tally


def run(quick: bool, out: Path) -> list[Figure]:
    """Read mutants; keep those that did harm in ``out/files``; return the figures."""
    return measured(QUICK if quick else FULL, out)


def measured(number: int, out: Path) -> list[Figure]:
    """Do what :func:`run` says with so many mutants."""
    # Else the first mutants of each worker would wait as long as compiling takes.
    compile_ahead()
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        tally = read_mutants(number, Path(folder))
        _keep(tally, Path(folder) / "again", out / "files")
    there = sum(tally.outcomes.values()) + len(tally.crashes)
    read = sum(count for (_, what), count in tally.outcomes.items() if what == "read")
    # Mutants that are all alike, or all refused at their first byte, would test nothing.
    share, note = read / max(1, there), "the others are refused"

    def figure(name: str, value: float, unit: str = "", most: float | None = 0.0) -> Figure:
        return Figure(name, float(value), unit, most=most, trials=number)

    return [
        figure("mutants that ended the process", len(tally.crashes)),
        figure("mutants that hung", len(tally.hangs)),
        figure("mutants that raised an error that is not the package's", len(tally.foreign)),
        figure("slowest mutant, time of the processor", tally.worst["seconds"], "s", HANG_S),
        figure("slowest mutant, real time", tally.worst["real_s"], "s", None),
        figure("slowest mutant, blocked", tally.worst["blocked_s"], "s", BLOCKED_S),
        figure("memory taken by one mutant at most", tally.worst["memory_mb"], "MB", MOST_MB),
        figure("growth of a worker's resident memory", tally.growth_mb, "MB", GROWTH_MB),
        Figure("share of mutants read", share, "", 0.9, 0.05, number, note),
    ]


def _keep(tally: Tally, folder: Path, out: Path) -> None:
    """Write mutants that did harm, and what they did."""
    found = {**tally.foreign, **tally.hangs, **tally.crashes}
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    report = {
        "outcomes": {f"{kind} {what}": n for (kind, what), n in sorted(tally.outcomes.items())},
        "found": {str(k): found[k] for k in sorted(found)},
    }
    (out / "report.json").write_text(json.dumps(report, indent=1), "utf-8")
    for number in sorted(found)[:200]:
        _, path = Mutants(folder, SEED).make(number)
        shutil.copy(path, out / f"{number}{path.suffix}")
