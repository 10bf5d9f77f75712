# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live session by a clock of the test's: pace, drags that end, commands, recordings."""

from __future__ import annotations

import numpy as np
import pytest

from hapticmech_ros import Mechanism, Session, load_scene
from hapticmech_ros.errors import SceneError
from hapticmech_ros.live.commands import (
    Drag,
    Draggable,
    DragStiffness,
    Failed,
    Hold,
    Open,
    Pause,
    Record,
    Release,
    Reset,
    Step,
    SwitchClosure,
    Tune,
)
from hapticmech_ros.live.live_session import MOST_BEHIND_S, LiveSession
from hapticmech_ros.live.settings import changes_of
from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.offline import states_from_bag
from live.driven import pull, until

HAND = Draggable("hand", "handle")


def alone(scene="five_bar"):
    return changes_of(load_scene(scene))


def live(scene="five_bar", *changes):
    return LiveSession(Open(scene, (*alone(scene), *changes)), 0.0)


@pytest.fixture
def session():
    return live()


def on_link(name, grip, goal):
    return Drag(Draggable("link", name), grip, goal)


def the_drag(session):
    """Return the only drag that there is."""
    (drag,) = session.state().drags
    return drag


def the_user(session):
    """Return the only user that there is."""
    (user,) = session.state().users
    return user


def test_it_does_the_ticks_of_a_session_none_more_and_none_less(session):
    until(session, 0.0, 1.0)
    plain = Session(load_scene("five_bar", changes=alone()))
    plain.run(round(session.session.time / plain.period))
    assert session.session.time == pytest.approx(1.0, abs=0.02)
    assert (session.session.mechanism.q == plain.mechanism.q).all()
    assert session.state().factor == pytest.approx(1.0, abs=0.02)


def test_a_short_stall_is_caught_up_and_a_long_one_is_not(session):
    until(session, 0.0, 0.5)
    until(session, 0.55, 0.6)
    assert session.session.time == pytest.approx(0.6, abs=0.01)
    until(session, 5.0, 5.5)
    assert session.session.time == pytest.approx(0.6 + MOST_BEHIND_S + 0.5, abs=0.02)


def test_slower_than_real_time_is_said(session):
    for now in np.arange(0.0, 2.0, 0.02):  # 5 ticks every 20 ms
        session.advance(now)
    assert session.is_behind
    assert session.state().factor == pytest.approx(0.25, abs=0.02)


def test_a_drag_of_the_hand_pulls_it_there(session):
    until(session, 0.0, 0.7)
    drag = pull(session, 0.01, 0.005)
    until(session, 0.7, 4.0, drag)
    found = the_drag(session)
    assert (found.body, found.force.shape) == (HAND, (3,))
    assert the_user(session).device[:, 3] == pytest.approx(drag.goal, abs=2e-3)


def test_the_force_of_a_drag_is_the_hands_wrench_and_keeps_to_the_devices_limit(session):
    until(session, 0.0, 0.1)
    until(session, 0.1, 0.12, pull(session, 10.0))
    force = the_drag(session).force
    limit = session.session.scene.device.force_limit
    assert np.linalg.norm(force) == pytest.approx(limit)
    assert the_user(session).hand_wrench[:3] == pytest.approx(force)


def test_a_drag_ends_when_it_is_let_go(session):
    now = until(session, 0.0, 0.1)
    now = until(session, now, 0.3, pull(session, 0.02))
    assert np.linalg.norm(the_drag(session).force) > 0.1
    session.take(Release(HAND), now)
    until(session, now, now + 0.01)
    assert session.state().drags == ()
    assert (the_user(session).hand_wrench == 0.0).all()


@pytest.mark.parametrize("scene", ["five_bar", "spatial_arm", "stewart_platform", "peg_in_hole"])
def test_a_link_is_dragged_by_a_wrench_on_it(scene):
    session = live(scene)
    link = session.session.scene.links[-1]
    until(session, 0.0, 0.3)
    mechanism = session.session.simulator.mechanism
    start = mechanism.frame_pose(session.session.mechanism.q, link.name).translation
    planar = session.session.scene.task_space == "planar"
    goal = start + np.array((0.004, 0.004, 0.0 if planar else 0.004))
    until(session, 0.3, 0.6, on_link(link.name, np.zeros(3), goal))
    state = session.state()
    assert state.error == ""
    drag = the_drag(session)
    assert drag.body == ("link", link.name)
    assert not planar or drag.force[2] == 0.0
    place = mechanism.frame_pose(state.q, link.name).translation
    assert drag.grip == pytest.approx(place, abs=2e-4)


def test_a_drag_of_a_link_is_to_the_links_point_that_was_grabbed(session):
    """Its wrench at the link's origin is the force with the lever arm of the grip."""
    until(session, 0.0, 0.1)
    grip = np.array((0.02, 0.01, 0.0))
    link = session.session.simulator.mechanism.frame_pose(session.session.mechanism.q, "link3")
    goal = link.act(grip) + np.array((0.01, 0.0, 0.0))
    until(session, 0.1, 0.15, on_link("link3", grip, goal))
    moved = session.session.simulator.mechanism.frame_pose(session.state().q, "link3")
    assert the_drag(session).grip == pytest.approx(moved.act(grip), abs=1e-4)


def test_a_stiffer_mouse_pulls_harder():
    forces = []
    for factor in (0.5, 1.0):
        session = live()
        until(session, 0.0, 0.1)
        assert session.take(DragStiffness(factor), 0.1) is None
        until(session, 0.1, 0.106, pull(session, 0.02))
        forces.append(np.linalg.norm(the_drag(session).force))
    assert forces[0] < 0.7 * forces[1]


def test_pause_step_and_go_on(session):
    now = until(session, 0.0, 0.2)
    session.take(Pause(True), now)
    stood = session.session.time
    now = until(session, now, now + 1.0)
    assert session.session.time == stood
    assert (session.state().paused, session.state().factor) == (True, 0.0)
    session.take(Step(3), now)
    now = until(session, now, now + 0.1)
    assert session.session.time == pytest.approx(stood + 0.003)
    session.take(Pause(False), now)
    until(session, now, now + 0.5)
    assert session.session.time == pytest.approx(stood + 0.003 + 0.5, abs=0.02)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (Tune("handle", "device.mass", 1.0), "must begin with controller"),
        (Tune("handle", "controller.joint_constraint.stiffness", -1.0), "stiffness"),
        (Tune("handle", "controller.nothing", 1.0), "nothing"),
        (DragStiffness(0.0), "factor on the stiffness of the drag: must be"),
        (Drag(HAND, np.zeros(3), np.full(3, np.nan)), "goal of a drag: must be three finite"),
        (on_link("link1", np.zeros(2), np.zeros(3)), "grip of a drag: must be three finite"),
        (on_link("nobody", np.zeros(3), np.zeros(3)), "link: must be one of"),
        (Drag(Draggable("hand", "link1"), *np.zeros((2, 3))), "hand: must be one of"),
        (SwitchClosure("nobody", True), "nobody"),
        (Hold("handle", "nobody"), "must be one of"),
        (Open("nobody"), "no such file, nor a shipped scene"),
        (Open("five_bar", ("device.mass=-1",)), "device.mass"),
    ],
    ids=str,
)
def test_what_cannot_be_had_is_refused_and_all_goes_on(session, command, words):
    now = until(session, 0.0, 0.1)
    told = session.take(command, now)
    assert isinstance(told, Failed)
    assert words in told.reason
    before = session.session.time
    until(session, now, now + 0.2)
    assert session.session.time == pytest.approx(before + 0.2, abs=0.02)
    assert session.state().error == ""


def test_loops_are_opened_and_shut(session):
    now = until(session, 0.0, 0.1)
    assert session.take(SwitchClosure("ground_pin", False), now) is None
    now = until(session, now, now + 0.01)
    assert session.state().active == (False,)
    assert session.take(SwitchClosure("ground_pin", True), now) is None
    until(session, now, now + 0.01)
    assert session.state().active == (True,)


def test_an_error_ends_the_session_with_its_reason_until_a_reset(session, monkeypatch):
    now = until(session, 0.0, 0.1)

    def failing(*_args, **_more):
        raise SceneError("five_bar", [])

    monkeypatch.setattr(session.session, "tick", failing)
    now = until(session, now, now + 0.1)
    state = session.state()
    assert "five_bar" in state.error
    assert state.paused
    session.take(Pause(False), now)
    assert session.state().paused
    session.take(Reset(), now)
    until(session, now, now + 0.1)
    assert session.state().error == ""


def test_a_recording_has_every_tick(session, tmp_path):
    now = until(session, 0.0, 0.1)
    folder = tmp_path / "bag"
    assert session.take(Record(str(folder)), now) is None
    assert isinstance(session.take(Record(str(folder)), now), Failed)
    assert session.take(Record(str(tmp_path / "other")), now) is None
    begun = session.session.time
    now = until(session, now, now + 0.2)
    assert session.state().recording == str(tmp_path / "other")
    ended = session.session.time
    assert session.take(Record(""), now) is None
    states = states_from_bag(tmp_path / "other", Mechanism(load_scene("five_bar")))
    assert len(states.q) == round((ended - begun) / 0.001)
    assert np.diff(states.stamps_ns) == pytest.approx(np.full(len(states.q) - 1, 1_000_000))


@pytest.mark.parametrize("scene", shipped_scenes())
def test_every_scene_of_the_library_runs_and_is_dragged_and_let_go(scene):
    session = live(scene)
    now = until(session, 0.0, 0.2)
    now = until(session, now, now + 0.3, pull(session, 0.01, 0.01))
    until(session, now, now + 0.3)
    assert session.state().error == ""
    assert np.isfinite(session.state().q).all()
