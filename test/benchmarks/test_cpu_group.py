# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Groups with a quota of processor time, in a folder that behaves as Linux' control groups do."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.small_machine.cpu_group import cpu_group, places
from hapticmech_ros.graph.processes import start_process

FILES = {1: ("cpu.cfs_period_us", "cpu.cfs_quota_us"), 2: ("cpu.max",)}
SLEEP = [sys.executable, "-I", "-S", "-c", "import time; print('in', flush=True); time.sleep(600)"]


class Hierarchy:
    """A folder whose new folders have the kernel's files, and stay while processes are in them.

    Attributes:
        version: of control groups.
    """

    def __init__(self, root: Path, version: int, monkeypatch: pytest.MonkeyPatch) -> None:
        self.root, self.version = root, version
        make, remove = Path.mkdir, Path.rmdir

        def mkdir(path: Path, *given: Any, **named: Any) -> None:
            make(path, *given, **named)
            if path.parent == root:
                self._fill(path)

        def rmdir(path: Path) -> None:
            if path.parent == root:
                self._empty(path)
            remove(path)

        monkeypatch.setattr(Path, "mkdir", mkdir)
        monkeypatch.setattr(Path, "rmdir", rmdir)

    def _fill(self, folder: Path) -> None:
        for name in ("cgroup.procs", *FILES[self.version]):
            (folder / name).touch()

    def _empty(self, folder: Path) -> None:
        procs = folder / "cgroup.procs"
        if procs.exists() and any(map(is_running, procs.read_text().split())):
            raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
        for file in folder.iterdir():
            file.unlink()

    @property
    def groups(self) -> list[str]:
        return sorted(path.name for path in self.root.iterdir())


def is_running(pid: str) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    except (FileNotFoundError, ProcessLookupError):
        return False
    return not stat.rpartition(") ")[2].startswith("Z")


@pytest.fixture(params=[1, 2], ids=["v1", "v2"])
def hierarchy(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Hierarchy:
    root = tmp_path / "cpu"
    root.mkdir()
    return Hierarchy(root, request.param, monkeypatch)


def test_a_group_has_its_quota_and_is_gone_afterwards(hierarchy: Hierarchy) -> None:
    with cpu_group(1.2, [hierarchy.root]) as group:
        limits = [(group.folder / name).read_text() for name in FILES[hierarchy.version]]
        assert limits == {1: ["5000", "6000"], 2: ["6000 5000"]}[hierarchy.version]
        assert hierarchy.groups == [group.folder.name]
    assert hierarchy.groups == []


def test_what_is_still_in_a_group_is_ended_with_it_also_after_an_error(
    hierarchy: Hierarchy,
) -> None:
    started: list[subprocess.Popen[str]] = []

    def interrupted() -> None:
        with cpu_group(1.2, [hierarchy.root]) as group:
            process = start_process(group.within(SLEEP), os.environ, pipe_output=True)
            started.append(process)
            assert process.stdout is not None
            assert process.stdout.readline() == "in\n"
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    (process,) = started
    process.communicate(timeout=60.0)
    assert process.returncode == -signal.SIGKILL
    assert hierarchy.groups == []


@pytest.mark.parametrize(
    ("cgroup", "mounts", "expected"),
    [
        (
            "3:memory:/b\n1:cpu,cpuacct:/a\n0::/\n",
            "cgroup {0}/memory cgroup rw,memory 0 0\ncgroup {0}/cpu cgroup rw,cpu,cpuacct 0 0\n",
            ["cpu/a", "cpu"],
        ),
        ("0::/user/me\n", "cgroup2 {0}/all cgroup2 rw 0 0\n", ["all/user/me", "all/user", "all"]),
        # A container may know the path of its host only.
        ("0::/host/me\n", "cgroup2 {0}/all cgroup2 rw 0 0\n", ["all"]),
        ("", "tmpfs {0}/cpu tmpfs rw 0 0\n", []),
    ],
    ids=["v1", "v2", "container", "none"],
)
def test_places_are_the_groups_that_a_process_is_in(
    tmp_path: Path, cgroup: str, mounts: str, expected: list[str]
) -> None:
    for folder in ("cpu/a", "memory/b", "all/user/me"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "cgroup").write_text(cgroup)
    (tmp_path / "mounts").write_text(mounts.format(tmp_path))
    assert places(tmp_path) == [tmp_path / name for name in expected]
