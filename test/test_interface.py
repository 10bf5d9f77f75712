# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a user has is what ``test/interface.txt`` lists: nothing goes, or comes, unseen."""

from pathlib import Path

from interface import interface

LIST = Path(__file__).with_name("interface.txt")
REMEDY = "python test/interface.py > test/interface.txt, and the CHANGELOG"


def test_what_a_user_has_is_what_is_listed():
    listed, found = set(LIST.read_text(encoding="utf-8").splitlines()), set(interface())
    assert not listed - found, f"gone; if it is meant: {REMEDY}"
    assert not found - listed, f"new; if it is meant: {REMEDY}"
