# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A study's rows on disk as they come, so that one that was interrupted goes on where it was.

``study.json`` says of what the study is, ``rows.bin`` has a record for each scene, in the order of
their arrival: its number and whether it was measured (0) or failed (1), little-endian int64; its
numbers, float64; and the CRC-32 of all that, uint64. ``failures.jsonl`` says why scenes failed. A
record that was not written to its end is cut off when the study goes on, and its scene is measured
again; none is ever written twice.
"""

from __future__ import annotations

import fcntl
import json
import os
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError

DEFINITION, ROWS, FAILURES = "study.json", "rows.bin", "failures.jsonl"
# Of what a study's folder says; more is none.
MOST_BYTES = 64_000_000
MEASURED, FAILED = 0, 1


class StudyError(HapticMechError):
    """A study that cannot go on: its folder has another one, or somebody is at it."""


@dataclass(slots=True)
class Rows:
    """Rows of a study, by the number of their scene.

    Attributes:
        measured: (m,) numbers of each scene that was measured.
        failed: why each other one was not, in words.
    """

    measured: dict[int, Array] = field(default_factory=dict)
    failed: dict[int, str] = field(default_factory=dict)

    def __contains__(self, index: int) -> bool:
        return index in self.measured or index in self.failed

    def __len__(self) -> int:
        return len(self.measured) + len(self.failed)


class Journal:
    """Writes rows, and knows those that are there; a context, in which no other process writes.

    Args:
        folder: of the study, created if needed.
        definition: of what the study is, as JSON has it.
        columns: names of the numbers of each row.

    Attributes:
        rows: those that were there when it was opened.

    Raises:
        StudyError: the folder has another study, or another process is at it.
    """

    def __init__(self, folder: Path, definition: Mapping[str, Any], columns: Sequence[str]) -> None:
        numbers = ("numbers", "<f8", (len(columns),))
        self._record = np.dtype([("index", "<i8"), ("status", "<i8"), numbers, ("crc", "<u8")])
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._file = os.open(folder / ROWS, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        self._failures = None
        try:
            self._begin({**definition, "columns": list(columns)})
            self.rows = self._read()
            self._failures = (folder / FAILURES).open("a", encoding="utf-8")
        except BaseException:
            os.close(self._file)
            raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        if self._failures is not None:
            self._failures.close()
        os.fsync(self._file)
        os.close(self._file)

    def write(self, rows: Rows) -> None:
        """Add rows of scenes that have none; when this process ends they are not lost."""
        if self._failures is not None and rows.failed:
            for index, why in rows.failed.items():
                said = json.dumps({"index": index, "why": why}, ensure_ascii=False)
                self._failures.write(said + "\n")
            self._failures.flush()
        records = np.zeros(len(rows), self._record)
        records["numbers"] = np.nan
        for at, (index, numbers) in enumerate(rows.measured.items()):
            records[at]["index"], records[at]["numbers"] = index, numbers
        for at, index in enumerate(rows.failed, len(rows.measured)):
            records[at]["index"], records[at]["status"] = index, FAILED
        for at in range(len(records)):
            records[at]["crc"] = self._crc(records[at])
        left = memoryview(records.tobytes())
        while left:
            left = left[os.write(self._file, left) :]

    def _crc(self, record: Any) -> int:
        return zlib.crc32(record.tobytes()[: -self._record["crc"].itemsize])

    def _begin(self, definition: dict[str, Any]) -> None:
        """Say of what the study is, or see that it is the one that is there.

        Raises:
            StudyError: it is another one, or another process is at it.
        """
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StudyError(f"{self._folder}: another process is at this study") from None
        path = self._folder / DEFINITION
        text = json.dumps(definition, indent=1, ensure_ascii=False)
        if not path.exists():
            if os.fstat(self._file).st_size:
                raise StudyError(f"{self._folder} has rows of a study, but no {DEFINITION}")
            # Whole or not at all: a study begins with a definition.
            new = path.with_name(f".{path.name}")
            new.write_text(text + "\n", encoding="utf-8")
            new.replace(path)
            return
        there = _definition(path)
        wanted = json.loads(text)
        others = [key for key in {**wanted, **there} if wanted.get(key) != there.get(key)]
        if others:
            raise StudyError(
                f"{self._folder} has another study, which differs in {', '.join(others)}: choose"
                " another folder, or remove this one"
            )

    def _read(self) -> Rows:
        """Return the rows that are there, and cut off what is none."""
        size = self._record.itemsize
        data = np.fromfile(self._folder / ROWS, dtype=np.uint8)
        records = data[: data.size // size * size].view(self._record)
        whole = 0
        for record in records:
            if int(record["crc"]) != self._crc(record):
                break
            whole += 1
        os.ftruncate(self._file, whole * size)
        os.lseek(self._file, 0, os.SEEK_END)
        kept, why, rows = records[:whole], self._reasons(), Rows()
        for record in kept:
            index = int(record["index"])
            if record["status"] == MEASURED:
                rows.measured[index] = record["numbers"].copy()
            else:
                rows.failed[index] = why.get(index, "")
        return rows

    def _reasons(self) -> dict[int, str]:
        """Return why scenes failed; a line that is not whole is left out."""
        path, found = self._folder / FAILURES, dict[int, str]()
        if not path.exists():
            return found
        with path.open(encoding="utf-8", errors="replace") as file:
            for line in file:
                try:
                    said = json.loads(line)
                    found[int(said["index"])] = str(said["why"])
                except (ValueError, KeyError, TypeError):
                    continue
        return found


def _definition(path: Path) -> dict[str, Any]:
    if path.stat().st_size > MOST_BYTES:
        raise StudyError(f"{path} is no definition of a study")
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise StudyError(f"{path} is no definition of a study")
    return found
