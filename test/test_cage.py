# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Work in a child: its limits hold, and how it ended is told in a sentence."""

import os
import subprocess
from pathlib import Path

import pytest

from hapticmech_ros.files import cage
from hapticmech_ros.files.cage import CageError, Limits, caged
from oracles.caged_work import work

DESCRIPTORS = Path("/proc/self/fd")
LIMITS = Limits(memory=200_000_000, seconds=1, output=10_000)


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_answers_come_from_one_child_in_order():
    found = caged(work, ["echo", 1.5, None, "print", "echo"], LIMITS)
    assert found[1:4] == [1.5, None, "print"]
    assert found[0] == found[4]
    assert found[0]["pid"] != os.getpid()
    assert found[0]["text"] == "größer"


@pytest.mark.parametrize(
    ("item", "rule"),
    [
        ("memory", "needs more than 200000000 bytes of memory"),
        ("segment", r"ends the process that reads it \(SIGSEGV\)"),
        ("turn", "takes more than 1 s"),
        ("output", "becomes more than 10000 bytes"),
        ("file", "File too large"),
        ("error", "cannot be read: two lines"),
        ("exit", "ends the process that reads it"),
    ],
)
def test_what_breaks_a_limit_is_told_with_the_answers_before_it(item, rule):
    with pytest.raises(CageError, match=rule) as caught:
        caged(work, ["a", item, "b"], LIMITS)
    assert caught.value.done == ["a"]
    assert "\n" not in str(caught.value)


def test_a_child_that_waits_ends_by_itself(monkeypatch):
    monkeypatch.setattr(cage, "PATIENCE", 1)
    with pytest.raises(CageError, match="takes more than 1 s"):
        caged(work, ["wait"], LIMITS)


def test_a_child_is_ended_with_the_work_of_its_parent(monkeypatch):
    """Ctrl-C while a child works: it is killed, and waited for."""
    started = []

    class Interrupted(subprocess.Popen):
        def communicate(self, *given, **named):
            started.append(self)
            raise KeyboardInterrupt

    monkeypatch.setattr(subprocess, "Popen", Interrupted)
    with pytest.raises(KeyboardInterrupt):
        caged(work, ["wait"], LIMITS)
    assert started[0].returncode is not None


def test_descriptors_are_closed():
    before = len(list(DESCRIPTORS.iterdir()))
    for _ in range(2):
        with pytest.raises(CageError):
            caged(work, ["exit"], LIMITS)
    assert len(list(DESCRIPTORS.iterdir())) == before
