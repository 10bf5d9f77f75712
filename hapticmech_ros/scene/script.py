# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wrenches over time from a CSV file, for a hand that follows a script."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from io import StringIO
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hapticmech_ros.errors import FileError, InvalidInputError
from hapticmech_ros.files import read_text
from hapticmech_ros.scene.part import LARGEST

COLUMNS = ("time", "fx", "fy", "fz", "tx", "ty", "tz")
FILE_SIZE_LIMIT = 16_000_000


def read_script(file: str) -> npt.NDArray[np.float64]:
    """Return a script's rows, (n, 7): time (s, increasing), force (N) and torque (N m).

    Raises:
        InvalidInputError: not there, too large, or not such a table; the message names the line,
            what stands there, and the rule.
    """
    try:
        stream = StringIO(read_text(file, FILE_SIZE_LIMIT), newline="")
        lines = [(i, line) for i, line in enumerate(csv.reader(stream), start=1) if any(line)]
    except FileError as error:
        raise InvalidInputError("script", file, f"{error.rule} ({error.value})") from None
    except csv.Error as error:
        raise InvalidInputError("script", file, f"cannot be read: {error}") from None
    if not lines or tuple(word.strip() for word in lines[0][1]) != COLUMNS:
        where = f"line {lines[0][0]}" if lines else "line 1"
        given = lines[0][1] if lines else ""
        raise InvalidInputError(where, given, f"the heading must be {','.join(COLUMNS)}")
    if len(lines) == 1:
        raise InvalidInputError("script", file, "must have at least one row of numbers")
    rows: list[list[float]] = []
    for number, words in lines[1:]:
        row = _numbers(number, words)
        if row[0] < 0.0 or (rows and row[0] <= rows[-1][0]):
            rule = "times must be 0 or more, and increase from row to row"
            raise InvalidInputError(f"line {number}", words[0], rule)
        rows.append(row)
    return np.array(rows)


def with_script_path(document: object, folder: Path) -> object:
    """Return a scene's document with relative paths of its hands' scripts taken from ``folder``."""
    if not isinstance(document, Mapping):
        return document
    found = _with_whole_path(document, folder)
    hands = document.get("hands")
    if isinstance(hands, list | tuple):
        entries = [_with_whole_path(e, folder) if isinstance(e, Mapping) else e for e in hands]
        found = {**found, "hands": entries}
    return found


def _with_whole_path(holder: Mapping[str, object], folder: Path) -> Mapping[str, object]:
    """Return what has a hand with the path of the hand's script taken from ``folder``."""
    hand = holder.get("hand")
    if not isinstance(hand, Mapping):
        return holder
    file = hand.get("file")
    if hand.get("kind") != "scripted" or not isinstance(file, str) or not file:
        return holder
    return {**holder, "hand": {**hand, "file": str(folder / file)}}


def _numbers(number: int, words: list[str]) -> list[float]:
    """Return a row's seven numbers."""
    if len(words) != len(COLUMNS):
        rule = f"must have {len(COLUMNS)} columns, {','.join(COLUMNS)}"
        raise InvalidInputError(f"line {number}", words, rule)
    row = []
    for column, word in zip(COLUMNS, words, strict=True):
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not abs(value) <= LARGEST:
            rule = f"must be a finite number, not above {LARGEST:g} in size"
            raise InvalidInputError(f"line {number}, {column}", word, rule)
        row.append(value)
    return row
