"""The campaign of mutated files, in a form of a few seconds."""

import os
import signal
import sys
from pathlib import Path

import pytest

# What is not installed is found beside the tests.
sys.path.append(str(Path(__file__).resolve().parents[1]))

from benchmarks.reliability import files
from benchmarks.reliability.files import Tally, Worker

MUTANTS = 120


def test_mutants_are_read_or_refused(tmp_path):
    figures = files.measured(MUTANTS, tmp_path)
    report = (tmp_path / "files" / "report.json").read_text()
    assert len(figures) == 6
    assert [one.name for one in figures if not one.kept] == [], report


def test_what_a_worker_does_wrong_is_counted(tmp_path, monkeypatch):
    """An end by a signal, and silence; the next mutant has a new worker."""
    worker = Worker(tmp_path)
    try:
        assert isinstance(worker.read(0), dict)
        first = worker._process
        os.kill(first.pid, signal.SIGSEGV)
        assert worker.read(1) == f"exit code {-signal.SIGSEGV}"
        assert isinstance(worker.read(2), dict)
        assert worker._process is not first
        os.kill(worker._process.pid, signal.SIGSTOP)
        monkeypatch.setattr(files, "PATIENCE_S", 0.01)
        assert worker.read(3) == "hang"
    finally:
        worker.close()


@pytest.mark.parametrize(
    ("outcome", "seconds", "counted"),
    [("read", 0.1, (0, 0)), ("foreign: ValueError: x", 0.1, (0, 1)), ("refused", 5.1, (1, 0))],
)
def test_what_a_worker_says_is_counted(outcome, seconds, counted):
    tally = Tally()
    tally.add(7, {"kind": "scene", "outcome": outcome, "seconds": seconds, "memory_mb": 1.0})
    assert (len(tally.hangs), len(tally.foreign)) == counted
