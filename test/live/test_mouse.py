# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One drag a client and a client a body: who has it, where it pulls to, and when it ends."""

from __future__ import annotations

import numpy as np
import pytest

from hapticmech_ros.live.commands import Drag, Draggable, Release
from hapticmech_ros.live.grip import Mice

HAND, OTHER = Draggable("hand", "a"), Draggable("hand", "b")
LINK = Draggable("link", "link2")
EYE = np.array((0.0, 0.0, 1.0))
HELD, GRIP = np.array((0.1, 0.2, 0.0)), np.array((0.01, 0.0, 0.0))


@pytest.fixture
def sent():
    return []


@pytest.fixture
def mice(sent):
    return Mice(sent.append)


def test_what_is_grabbed_beside_its_middle_is_pulled_from_where_it_is(mice, sent):
    seen = HELD + np.array((0.02, 0.0, 0.0))
    mice.grab(1, LINK, GRIP, HELD, EYE, seen, planar=True)
    assert (sent[0].body, sent[0].goal.tolist()) == (LINK, HELD.tolist())
    mice.move(1, EYE, seen + np.array((0.0, 0.05, 0.0)))
    assert isinstance(sent[1], Drag)
    assert sent[1].grip is GRIP
    assert sent[1].goal == pytest.approx(HELD + np.array((0.0, 0.05, 0.0)))


def test_in_a_plane_it_is_pulled_in_the_plane(mice, sent):
    mice.grab(1, HAND, np.zeros(3), HELD, EYE, HELD, planar=True)
    mice.move(1, EYE, EYE + 0.5 * (np.array((0.4, 0.4, 0.0)) - EYE))
    assert sent[-1].goal == pytest.approx((0.4, 0.4, 0.0))


def test_in_space_it_is_pulled_to_what_is_seen(mice, sent):
    mice.grab(1, HAND, np.zeros(3), HELD, EYE, HELD, planar=False)
    mice.move(1, EYE, HELD + np.array((0.0, 0.0, 0.3)))
    assert sent[-1].goal == pytest.approx(HELD + np.array((0.0, 0.0, 0.3)))


def test_a_body_is_dragged_by_one_client_at_a_time(mice, sent):
    assert mice.grab(1, HAND, np.zeros(3), HELD, EYE, HELD, planar=True) == 1
    assert mice.grab(2, HAND, np.zeros(3), HELD, EYE, HELD, planar=True) == 1
    mice.move(2, EYE, HELD)
    mice.let_go(2)
    assert len(sent) == 1
    mice.let_go(1)
    assert sent[1] == Release(HAND)
    assert mice.grab(2, HAND, np.zeros(3), HELD, EYE, HELD, planar=True) == 2
    assert sent[2].body == HAND


def test_clients_drag_bodies_of_their_own_and_let_go_of_these_alone(mice, sent):
    mice.grab(1, HAND, np.zeros(3), HELD, EYE, HELD, planar=True)
    mice.grab(2, OTHER, np.zeros(3), HELD, EYE, HELD, planar=False)
    assert mice.holders() == {HAND: 1, OTHER: 2}
    mice.move(1, EYE, HELD + np.array((0.0, 0.05, 0.0)))
    assert (sent[-1].body, sent[-1].goal.tolist()) == (HAND, [0.1, 0.25, 0.0])
    mice.let_go(1)
    assert sent[-1] == Release(HAND)
    assert mice.holders() == {OTHER: 2}
    mice.repeat()
    assert sent[-1].body == OTHER


def test_who_grabs_something_else_lets_go_of_the_first(mice, sent):
    mice.grab(1, HAND, np.zeros(3), HELD, EYE, HELD, planar=True)
    mice.grab(1, LINK, GRIP, HELD, EYE, HELD, planar=True)
    assert [type(one) for one in sent] == [Drag, Release, Drag]
    assert mice.holders() == {LINK: 1}


def test_a_drag_is_told_again_while_it_lasts_and_no_longer(mice, sent):
    mice.repeat()
    assert sent == []
    mice.grab(1, HAND, np.zeros(3), HELD, EYE, HELD, planar=True)
    mice.repeat()
    assert sent[0] is sent[1]
    mice.let_go()
    mice.repeat()
    mice.let_go()
    mice.move(1, EYE, HELD)
    assert [type(one) for one in sent] == [Drag, Drag, Release]
