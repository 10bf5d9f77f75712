# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files of strangers are opened only where they are regular, and of bounded size."""

import os
from pathlib import Path

import pytest

from hapticmech_ros.errors import FileError
from hapticmech_ros.files import check_file, exists, is_file, open_file, read_file, read_text

DESCRIPTORS = Path("/proc/self/fd")
READERS = (lambda p: read_file(p, 100), lambda p: check_file(p, 100), open_file)


def strange(folder):
    """Return paths that are no regular files, and the rule that refuses each."""
    os.mkfifo(folder / "pipe")
    (folder / "link").symlink_to("/dev/zero")
    (folder / "loop").symlink_to("loop")
    regular = "must be a regular file"
    return [
        (folder / "pipe", regular),
        ("/dev/zero", regular),
        (folder / "link", regular),
        (folder, regular),
        (folder / "loop", "cannot be read"),
        (folder / "gone", "cannot be read"),
        (folder / ("x" * 300), "cannot be read"),
        ("a\0b", "cannot be read"),
    ]


@pytest.mark.parametrize("read", READERS, ids=["read", "check", "open"])
def test_what_is_no_regular_file_is_refused_at_once(tmp_path, read):
    for path, rule in strange(tmp_path):
        with pytest.raises(FileError, match=rule):
            read(path)


def test_descriptors_are_closed_when_a_file_is_refused(tmp_path):
    (tmp_path / "large").write_bytes(b"x" * 101)
    before = len(list(DESCRIPTORS.iterdir()))
    for _ in range(5):
        with pytest.raises(FileError, match="at most 100 bytes"):
            read_file(tmp_path / "large", 100)
    assert len(list(DESCRIPTORS.iterdir())) == before


def test_files_within_the_limit_are_read(tmp_path):
    path = tmp_path / "small"
    path.write_bytes("é".encode() * 50)
    assert read_file(path, 100) == path.read_bytes()
    assert read_text(path, 100) == "é" * 50
    assert check_file(path, 100) == 100
    with open_file(path) as file:
        assert file.read(2) == "é".encode()


def test_a_file_that_says_it_is_empty_and_is_not_is_bounded_as_well():
    assert read_file("/proc/self/stat", 100_000)
    with pytest.raises(FileError, match="at most 10 bytes"):
        read_file("/proc/self/stat", 10)


def test_text_that_is_none_is_refused(tmp_path):
    (tmp_path / "bytes").write_bytes(b"\xff")
    with pytest.raises(FileError, match="cannot be read"):
        read_text(tmp_path / "bytes", 100)


@pytest.mark.parametrize("name", ["x" * 300, "a\0b", "gone", "x" * 5000])
def test_names_that_cannot_be_name_nothing(tmp_path, name):
    assert not exists(tmp_path / name)
    assert not is_file(tmp_path / name)
