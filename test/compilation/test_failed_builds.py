"""A build that failed is remembered no longer than its cause lasts."""

import errno
import json
import subprocess
from collections import namedtuple

import pytest

from hapticmech_ros.compilation import attempt, library

Usage = namedtuple("Usage", "total used free")


@pytest.fixture
def failing(monkeypatch, alone):
    """Let builds fail with what is said here; return those that were begun."""
    begun = []

    def run(command, **options):
        begun.append(command)
        code, words = failing_with[-1]
        return subprocess.CompletedProcess(command, code, "", words)

    failing_with = [(1, "error: no such instruction")]
    begun_and_reasons = begun, failing_with
    monkeypatch.setattr(library.subprocess, "run", run)
    return begun_and_reasons


def asked():
    library.library.cache_clear()
    return library.library()


def mark():
    return library.library_path().with_suffix(".failed")


def test_a_compiler_that_refuses_is_asked_once(failing, capfd):
    begun, _ = failing
    assert asked() is None
    assert json.loads(mark().read_text())["reason"] == "error: no such instruction"
    assert str(mark()) in capfd.readouterr().err
    assert asked() is None
    assert len(begun) == 1


@pytest.mark.parametrize("changed", ["numba", "compiler", "time", "clock", "nonsense"])
def test_with_another_compiler_or_later_it_is_tried_again(changed, failing, monkeypatch, tmp_path):
    begun, _ = failing
    asked()
    told = json.loads(mark().read_text())
    if changed == "numba":
        mark().write_text(json.dumps({**told, "with": {**told["with"], "numba": "0.1"}}))
    elif changed == "compiler":
        other = tmp_path / "another-cc"
        other.write_text("#!/bin/sh\n")
        other.chmod(0o755)
        monkeypatch.setenv("CC", str(other))
    elif changed == "time":
        mark().write_text(json.dumps({**told, "time": told["time"] - attempt.REFUSED_S - 1.0}))
    elif changed == "clock":
        mark().write_text(json.dumps({**told, "time": told["time"] + 3600.0}))
    else:
        mark().write_text("no JSON")
    asked()
    assert len(begun) == 2


def test_a_build_that_succeeds_forgets(failing, good, monkeypatch, builds):
    library.library_path().parent.mkdir()
    mark().write_text("no JSON")
    assert asked() is not None
    assert not mark().exists()


@pytest.mark.parametrize(
    "words",
    [
        "OSError: [Errno 28] No space left on device: '/x'",
        "ld: final link failed: No space left on device",
        "OSError: [Errno 122] Disk quota exceeded",
    ],
)
def test_a_disk_that_was_full_is_not_remembered(words, failing, capfd):
    begun, reasons = failing
    reasons.append((1, f"Traceback\n{words}"))
    assert asked() is None
    told = capfd.readouterr().err.splitlines()[-1]
    assert words in told
    assert not mark().exists()
    asked()
    assert len(begun) == 2


def test_a_builder_that_was_killed_is_remembered_for_minutes(failing):
    begun, reasons = failing
    reasons.append((-9, ""))
    asked()
    told = json.loads(mark().read_text())
    assert "signal 9" in told["reason"]
    assert told["counts_s"] == attempt.BUSY_S
    asked()
    assert len(begun) == 1


def test_a_disk_that_fills_while_the_library_is_put_in_its_place(alone, builds, monkeypatch, capfd):
    def full(file):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("hapticmech_ros.compilation.sealed.os.fsync", full)
        assert asked() is None
    told = capfd.readouterr().err.splitlines()[-1]
    assert "No space left on device" in told
    left = {path.name for path in library.library_path().parent.iterdir()}
    assert left == {"lock"}
    # There is room again.
    assert asked() is not None


def test_without_room_nothing_is_begun(alone, builds, monkeypatch, capfd):
    with monkeypatch.context() as patched:
        patched.setattr(attempt.shutil, "disk_usage", lambda place: Usage(10**9, 10**9, 5 << 20))
        assert asked() is None
    assert "5 MB left" in capfd.readouterr().err
    assert builds == []
    assert asked() is not None
    assert len(builds) == 1


def test_the_rest_of_builders_that_were_killed_is_removed(alone, builds):
    folder = library.library_path().parent
    folder.mkdir()
    (folder / "being-built-hapticmech_kernels-x.so").write_bytes(bytes(1000))
    assert asked() is not None
    assert not list(folder.glob("being-built-*"))


@pytest.mark.parametrize("missing", ["compiler", "headers"])
def test_what_is_missing_is_told_and_not_remembered(missing, alone, builds, monkeypatch, capfd):
    with monkeypatch.context() as patched:
        if missing == "compiler":
            patched.setenv("CC", "no-such-compiler")
        else:
            patched.setattr(attempt.sysconfig, "get_path", lambda name: str(alone))
        assert asked() is None
    assert missing in capfd.readouterr().err
    assert builds == []
    assert asked() is not None
