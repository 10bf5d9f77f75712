# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A build that fails is told in a sentence; what cannot be kept is used all the same."""

import errno
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from hapticmech_ros.compilation import library
from hapticmech_ros.compilation.cache import is_own, read_own
from hapticmech_ros.compilation.library import LibraryError


@pytest.fixture
def builder(monkeypatch, tmp_path):
    """Return what replaces the builder by a few lines of Python."""

    def replace(lines):
        folder = tmp_path / "modules"
        folder.mkdir()
        (folder / "another_builder.py").write_text(f"import os, sys, time\n{lines}\n")
        monkeypatch.setenv("PYTHONPATH", str(folder))
        monkeypatch.setattr(library, "BUILDER", "another_builder")

    return replace


def children(pid):
    return Path(f"/proc/{pid}/task/{pid}/children").read_text().split()


def gone(pid):
    """Return whether a process has ended, be it that nobody has collected it yet."""
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] == "Z"


def wait_for(condition, timeout=30.0):
    """Return what a condition gives once that is true."""
    until = time.monotonic() + timeout
    while time.monotonic() < until:
        found = condition()
        if found:
            return found
        time.sleep(0.01)
    raise AssertionError("not in time")


@pytest.mark.parametrize(
    ("lines", "patience", "rule"),
    [
        (
            *("print('1 of 2'); print('no such instruction'); sys.exit(1)", 600.0),
            r"cannot be compiled: no such instruction$",
        ),
        ("", 600.0, "nothing was written"),
        ("os.kill(os.getpid(), 9)", 600.0, "ended by signal 9"),
        ("time.sleep(600)", 0.5, r"not done after 0\.5 s"),
    ],
    ids=["says why", "writes nothing", "killed", "hangs"],
)
def test_a_builder_that_fails(builder, alone, monkeypatch, lines, patience, rule):
    monkeypatch.setattr(library, "COMPILE_TIMEOUT_S", patience)
    builder(lines)
    with pytest.raises(LibraryError, match=rule):
        library.library()


def test_a_disk_without_room_for_a_temporary_folder(builder, alone, monkeypatch):
    """As of a disk that is full: there is none that could be written to."""
    builder("")
    missing = alone / "missing"
    monkeypatch.setattr(tempfile, "tempdir", str(missing))
    with pytest.raises(LibraryError, match=f"kernels cannot be compiled: .*{missing}") as refused:
        library.library()
    assert "\n" not in str(refused.value)


def test_what_a_builder_has_started_ends_with_it(builder, alone, monkeypatch, tmp_path):
    """A helper that would go on for minutes, and holds what is read until its end."""
    monkeypatch.setattr(library, "COMPILE_TIMEOUT_S", 2.0)
    told = tmp_path / "helper"
    builder(
        "import subprocess\n"
        "helper = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
        f"open({str(told)!r}, 'w').write(str(helper.pid))\n"
        "os.kill(os.getpid(), 9)"
    )
    with pytest.raises(LibraryError, match=r"not done after 2 s"):
        library.library()
    # Killed, it is gone as soon as the system has come to it.
    wait_for(lambda: gone(told.read_text()))


def test_the_builder_ends_with_who_asked_for_the_library(tmp_path):
    """Killed with SIGKILL, a process can end nothing itself."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [
        sys.executable,
        "-c",
        "from hapticmech_ros.compilation.library import library as l; l()",
    ]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as asks:
        assert "compiling" in asks.stderr.readline()
        (builder,) = wait_for(lambda: children(asks.pid))
        asks.kill()
        wait_for(lambda: gone(builder))


def test_the_time_left_of_a_build_is_shown(alone, monkeypatch, capfd):
    times = iter([100.0, 124.0, 126.0, 184.0, 200.0])
    monkeypatch.setattr(library.time, "monotonic", lambda: next(times))
    # After 24, 26, 84 and 100 s; the second follows the first too closely.
    assert library._followed(["1 of 100", "2 of 100", "50 of 100", "100 of 100"]) == ""
    told = capfd.readouterr().err.splitlines()
    assert "once" in told[0]
    assert [line.rpartition("about ")[2] for line in told[1:]] == [
        "76 s left",
        "16 s left",
        "0 s left",
    ]


def test_what_is_no_library_cannot_be_loaded(alone, builds, monkeypatch):
    monkeypatch.setattr(library, "_made", lambda: b"this is no library")
    with pytest.raises(LibraryError, match="no library of kernels"):
        library.library()


def test_a_disk_that_fills_while_the_library_is_put_in_its_place(alone, builds, monkeypatch, capfd):
    def full(file):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("hapticmech_ros.compilation.cache.os.fsync", full)
        assert library.library().addresses
    told = capfd.readouterr().err.splitlines()[-1]
    assert "not kept" in told
    assert "No space left on device" in told
    left = {path.name for path in library.library_path().parent.iterdir()}
    assert left == {"lock"}
    # There is room again.
    library.library.cache_clear()
    library.library()
    assert library.library_path().exists()
    assert len(builds) == 2


def test_a_folder_that_cannot_be_written_is_no_error(alone, builds, monkeypatch, capfd):
    (alone / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(alone / "file"))
    assert library.library().addresses
    assert "for this process alone" in capfd.readouterr().err


def test_a_user_whom_the_system_has_no_name_for(alone, monkeypatch, tmp_path):
    """As in a container with ``--user 12345``: told what to set; with that, nothing is missing."""

    def nobody(uid):
        raise KeyError(f"getpwuid(): uid not found: {uid}")

    monkeypatch.setattr("pwd.getpwuid", nobody)
    for name in ("HOME", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(OSError, match=r"user \d+ has no home: set XDG_CACHE_HOME"):
        library.library_path()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert library.library_path().is_relative_to(tmp_path / "cache")
    assert is_own(library.library_path().parent)


def test_the_rest_of_builders_that_were_killed_is_removed(alone, builds):
    folder = library.library_path().parent
    folder.mkdir()
    (folder / "being-built-hapticmech_kernels-x.zip").write_bytes(bytes(1000))
    library.library()
    assert not list(folder.glob("being-built-*"))


def test_who_waited_for_a_build_does_not_repeat_it(place, builds, monkeypatch):
    """Another process holds the lock, and puts the library in its place meanwhile."""
    aside = place.with_name("aside")
    place.rename(aside)
    monkeypatch.setattr(library.fcntl, "flock", lambda lock, kind: aside.rename(place))
    assert library.library().addresses
    assert builds == []


@pytest.mark.parametrize(("place", "what"), [("DATA_AT", "arrays"), ("SLOTS_AT", "objects")])
def test_what_is_not_where_kernels_look_for_it_is_told(monkeypatch, good, place, what):
    monkeypatch.setattr(library, place, 0)
    with pytest.raises(LibraryError, match=f"stores {what}"):
        library._loaded(library._unpacked(read_own(good)))
