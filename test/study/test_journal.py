# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of a study survive what ends it, each once."""

import numpy as np
import pytest

from hapticmech_ros.study.parameter_study import (
    DEFINITION,
    ROWS,
    Journal,
    StudyError,
)

WHAT = {"scene": "five_bar", "seed": 3}


def opened(folder, definition=WHAT, columns=("a", "b")):
    return Journal(folder, definition, columns)


def row(*numbers):
    return np.array(numbers, dtype=float)


def filled(folder):
    with opened(folder) as journal:
        journal.write({4: row(1.5, np.inf), 0: row(-0.0, np.nan), 2: "loops open"})
        journal.write({1: row(1e-300, 2.0)})
    return folder


def check(rows):
    assert sorted(rows) == [0, 1, 2, 4]
    assert rows[4].tolist() == [1.5, np.inf]
    assert rows[1].tolist() == [1e-300, 2.0]
    assert np.signbit(rows[0][0])
    assert np.isnan(rows[0][1])
    assert rows[2] == "loops open"


def test_rows_are_found_again_to_the_bit(tmp_path):
    with opened(filled(tmp_path)) as journal:
        check(journal.rows)


@pytest.mark.parametrize("cut", [1, 9, 49])
def test_a_record_that_was_not_written_to_its_end_is_cut_off(tmp_path, cut):
    path = filled(tmp_path) / ROWS
    whole = path.read_bytes()
    assert len(whole.splitlines()[0]) == 49
    path.write_bytes(whole + whole[:cut])
    with opened(tmp_path) as journal:
        check(journal.rows)
        journal.write({7: row(3.0, 4.0)})
    with opened(tmp_path) as journal:
        assert journal.rows[7].tolist() == [3.0, 4.0]
        assert len(journal.rows) == 5


def test_no_damaged_record_is_believed_nor_what_follows_it(tmp_path):
    path = filled(tmp_path) / ROWS
    data = bytearray(path.read_bytes())
    data[data.index(b"\n") + 17] ^= 1
    path.write_bytes(data)
    with opened(tmp_path) as journal:
        assert sorted(journal.rows) == [4]
    assert path.read_bytes() == bytes(data).partition(b"\n")[0] + b"\n"


@pytest.mark.parametrize(
    ("definition", "columns", "what"),
    [
        ({**WHAT, "seed": 4}, ("a", "b"), "seed"),
        ({**WHAT, "more": 1}, ("a", "b"), "more"),
        ({"seed": 3}, ("a", "b"), "scene"),
        (WHAT, ("a", "c"), "columns"),
    ],
)
def test_another_study_is_refused_by_what_differs(tmp_path, definition, columns, what):
    filled(tmp_path)
    before = (tmp_path / ROWS).read_bytes()
    with pytest.raises(StudyError, match=f"differs in {what}:"):
        opened(tmp_path, definition, columns)
    assert (tmp_path / ROWS).read_bytes() == before


def test_two_processes_are_not_at_one_study(tmp_path):
    with opened(tmp_path), pytest.raises(StudyError, match="another process is at this study"):
        opened(tmp_path)
    with opened(tmp_path):
        pass


@pytest.mark.parametrize(
    ("spoil", "rule"),
    [
        (lambda file: file.write_text("[1, 2", encoding="utf-8"), "is no definition"),
        (lambda file: file.unlink(), "has rows of a study, but no"),
    ],
)
def test_a_folder_with_rows_of_nobody_knows_what_is_refused(tmp_path, spoil, rule):
    spoil(filled(tmp_path) / DEFINITION)
    with pytest.raises(StudyError, match=rule):
        opened(tmp_path)
