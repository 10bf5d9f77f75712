# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Wrenches on links in a session: the same as elsewhere where both can be had."""

from __future__ import annotations

import numpy as np
import pytest

from hapticmech_ros import InvalidInputError, Session, load_scene
from hapticmech_ros.loading import shipped_scenes
from oracles.running import varied

PUSH = np.array([0.3, -0.2, 0.0, 0.0, 0.0, 0.01])


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_wrench_of_nothing_on_a_link_changes_no_bit_beside_a_push(name):
    scene = load_scene(name)
    plain, pushed = Session(scene), Session(scene)
    link = scene.links[-1].name
    for _ in range(20):
        one, other = plain.tick(PUSH), pushed.tick(PUSH, on_links={link: np.zeros(6)})
    assert (one.mechanism.q == other.mechanism.q).all()
    assert (one.device.flat == other.device.flat).all()
    assert (one.wrenches == other.wrenches).all()


def test_a_wrench_on_the_held_link_moves_as_one_at_the_point():
    """The lever arm from the link's origin is held over a period, in which the link turns a bit."""
    scene = load_scene("five_bar")
    at_point, on_link = Session(scene), Session(scene)
    point = scene.operational_point()
    gains = varied(scene.controller, force_channel={"contact": 0.0})
    for session in (at_point, on_link):
        session.tune(gains)
        session.run(400)
    for _ in range(200):
        q = on_link.mechanism.q
        mechanism = on_link.simulator.mechanism
        link, there = mechanism.frame_pose(q, point.link), mechanism.frame_pose(q, point.name)
        arm = there.translation - link.translation
        wrench = np.concatenate((PUSH[:3], PUSH[3:] + np.cross(arm, PUSH[:3])))
        one, other = at_point.tick(PUSH), on_link.tick(on_links={point.link: wrench})
    assert np.abs(one.mechanism.q - at_point.simulator.initial_state().q).max() > 1e-3
    assert other.mechanism.q == pytest.approx(one.mechanism.q, abs=2e-5)


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
