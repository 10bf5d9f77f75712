# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A disk that is full: one sentence, and what was written before can be read."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bag.record import Bytes, record
from hapticmech_ros import cli
from hapticmech_ros.bag import BagReader
from hapticmech_ros.bag.repair import repair

# A limit on the size of files stands for the end of the disk: both are an OSError while writing.
RECORDING = """
import resource, sys
from hapticmech_ros.bag import BagWriter
from hapticmech_ros.errors import BagError
path, storage, limit = sys.argv[1], sys.argv[2], int(sys.argv[3])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
written = 0
try:
    with BagWriter(path, storage) as bag:
        bag.add_topic("/a", "std_msgs/msg/UInt8MultiArray")
        for number in range(5000):
            bag.write("/a", number * 1_000_000, bytes((0, 1, 0, 0)) + bytes(1000))
            written = number
except BagError as error:
    print(written)
    sys.exit(f"error: {error}")
"""


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("limit", [0, 6000, 2_000_000])
def test_a_recording_ends_in_a_sentence_and_stays_readable(
    tmp_path: Path, storage: str, limit: int
) -> None:
    bag = tmp_path / "bag"
    command = [sys.executable, "-c", RECORDING, str(bag), storage, str(limit)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith(("error: cannot write bag", "error: cannot finish bag"))
    if limit > 1_000_000:
        # What is older than half a second was with the system.
        report = repair(bag)
        assert report.counts["/a"] >= int(done.stdout) - 1000 > 0
        with BagReader(report.path) as found:
            assert sum(1 for _ in found.serialized()) == report.counts["/a"]


@pytest.fixture
def sound(tmp_path: Path, wrench_bytes: Bytes) -> Path:
    return record(tmp_path / "sound", [("/f", 1, wrench_bytes(1, 1.0))])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("bag", "check", "{sound}", "--json", "/dev/full"), "No space left on device"),
        (("bag", "check", "{sound}", "--json", "/nowhere/x"), "No such file or directory"),
        (("scene", "show", "two_link", "--out", "/dev/full/x.png"), "/dev/full: File exists"),
        (("bag", "check", "{sound}/" + "x" * 300), "no bag at"),
        (("scene", "check", "x" * 300), "no such file"),
        (("scene", "check", "/dev/zero"), "no such file"),
        (("run", "--set", "scene=[", "five_bar"), "not valid YAML"),
        (("run", "--params-file", "/dev/zero", "five_bar"), "must be a regular file"),
    ],
)
def test_the_command_line_says_it_in_a_sentence(
    sound: Path,
    arguments: tuple[str, ...],
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given = [argument.format(sound=sound) for argument in arguments]
    monkeypatch.setattr(sys, "argv", ["hapticmech", *given])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 1
    said = capsys.readouterr().err
    assert said.startswith("error: ")
    assert words in " ".join(said.split())
    assert "Traceback" not in said
