# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wrenches on links in a session: the same as elsewhere where both can be had."""

from __future__ import annotations

import numpy as np
import pytest

from hapticmech_ros import InvalidInputError, Session, load_scene
from hapticmech_ros.loading import shipped_scenes


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_wrench_of_nothing_on_a_link_changes_no_bit(name):
    scene = load_scene(name)
    plain, pushed = Session(scene), Session(scene)
    link = scene.links[-1].name
    for _ in range(20):
        one, other = plain.tick(), pushed.tick(on_links={link: np.zeros(6)})
    assert (one.mechanism.q == other.mechanism.q).all()
    assert (one.device.flat == other.device.flat).all()
    assert (one.wrenches == other.wrenches).all()


@pytest.mark.parametrize(
    ("link", "wrench", "rule"),
    [
        ("nobody", np.zeros(6), "link: must be one of"),
        ("link4", np.zeros(3), "wrench on link4"),
        ("link4", np.full(6, np.nan), "must be finite"),
    ],
)
def test_unknown_links_and_bad_wrenches_are_refused_before_anything_moves(link, wrench, rule):
    session = Session(load_scene("five_bar"))
    session.tick()
    before = session.time
    with pytest.raises(InvalidInputError, match=rule):
        session.tick(on_links={link: wrench})
    assert session.time == before
