# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One drag at a time: who has it, where it pulls to, and when it ends."""

from __future__ import annotations

import numpy as np
import pytest

from hapticmech_ros.live.commands import Drag, Release
from hapticmech_ros.live.mouse import Mouse

EYE = np.array((0.0, 0.0, 1.0))
HELD, GRIP = np.array((0.1, 0.2, 0.0)), np.array((0.01, 0.0, 0.0))


@pytest.fixture
def sent():
    return []


@pytest.fixture
def mouse(sent):
    return Mouse(sent.append)


def test_what_is_grabbed_beside_its_middle_is_pulled_from_where_it_is(mouse, sent):
    seen = HELD + np.array((0.02, 0.0, 0.0))
    mouse.grab(1, "link2", GRIP, HELD, EYE, seen, planar=True)
    assert (sent[0].link, sent[0].goal.tolist()) == ("link2", HELD.tolist())
    mouse.move(1, EYE, seen + np.array((0.0, 0.05, 0.0)))
    assert isinstance(sent[1], Drag)
    assert sent[1].grip is GRIP
    assert sent[1].goal == pytest.approx(HELD + np.array((0.0, 0.05, 0.0)))


def test_in_a_plane_it_is_pulled_in_the_plane(mouse, sent):
    mouse.grab(1, "", np.zeros(3), HELD, EYE, HELD, planar=True)
    mouse.move(1, EYE, EYE + 0.5 * (np.array((0.4, 0.4, 0.0)) - EYE))
    assert sent[-1].goal == pytest.approx((0.4, 0.4, 0.0))


def test_in_space_it_is_pulled_to_what_is_seen(mouse, sent):
    mouse.grab(1, "", np.zeros(3), HELD, EYE, HELD, planar=False)
    mouse.move(1, EYE, HELD + np.array((0.0, 0.0, 0.3)))
    assert sent[-1].goal == pytest.approx(HELD + np.array((0.0, 0.0, 0.3)))


def test_a_second_mouse_waits_until_the_first_lets_go(mouse, sent):
    mouse.grab(1, "", np.zeros(3), HELD, EYE, HELD, planar=True)
    mouse.grab(2, "link1", GRIP, HELD, EYE, HELD, planar=True)
    mouse.move(2, EYE, HELD)
    mouse.let_go(2)
    assert len(sent) == 1
    mouse.let_go(1)
    assert isinstance(sent[1], Release)
    mouse.grab(2, "link1", GRIP, HELD, EYE, HELD, planar=True)
    assert sent[2].link == "link1"


def test_a_drag_is_told_again_while_it_lasts_and_no_longer(mouse, sent):
    mouse.repeat()
    assert sent == []
    mouse.grab(1, "", np.zeros(3), HELD, EYE, HELD, planar=True)
    mouse.repeat()
    assert sent[0] is sent[1]
    mouse.let_go()
    mouse.repeat()
    mouse.let_go()
    mouse.move(1, EYE, HELD)
    assert [type(one) for one in sent] == [Drag, Drag, Release]
