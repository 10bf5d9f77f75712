# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several users in a live session, and what is drawn and told of each."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from hapticmech_ros import Mechanism, Scene, load_scene
from hapticmech_ros.bag.reader import BagReader
from hapticmech_ros.live.commands import Draggable, Failed, Hold, Open, Record, Reset, Tune
from hapticmech_ros.live.grip import DRAG_TIMEOUT_S
from hapticmech_ros.live.live_picture import LivePicture
from hapticmech_ros.live.live_session import LiveSession, holding
from hapticmech_ros.live.page_controls import History, numbers_html, you_html
from hapticmech_ros.live.settings import HANDS, MOUSE_ALONE, OWN_HAND, changes_of
from hapticmech_ros.scene.hand import STILL_HAND, ConstantWrenchHand
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.state import StateLayout
from live.driven import pull, until
from oracles.users import five_bar_of_two

LEFT, RIGHT = Draggable("hand", "left"), Draggable("hand", "right")
STIFFNESS = "controller.joint_constraint.stiffness"
ARM = {"kind": "arm", "impedance": "firm", "waypoints": [{"time": 0.0}]}


@pytest.fixture
def path(tmp_path):
    return str(five_bar_of_two(tmp_path, {"hand": ARM}, {"device": {"mass": 0.3}}))


@pytest.fixture
def live(path):
    return LiveSession(Open(path, changes_of(load_scene(path))), 0.0)


def test_each_hand_is_dragged_by_a_spring_of_its_own(live):
    now = until(live, 0.0, 0.2)
    drags = pull(live, 0.004), pull(live, 0.0, -0.004, user=1)
    now = until(live, now, now + 0.1, *drags)
    state = live.state()
    assert [drag.body for drag in state.drags] == [LEFT, RIGHT]
    for drag, wanted in zip(state.drags, drags, strict=True):
        user = state.user(drag.body.name)
        assert (drag.goal == wanted.goal).all()
        # The force pulls to its own goal, and is what the hand does to this device alone.
        assert drag.force @ (drag.goal - drag.grip) > 0.0
        assert user.hand_wrench[:3] == pytest.approx(drag.force)
        assert np.linalg.norm(drag.force) > 0.05
    # One goes on when the other is heard no more.
    until(live, now, now + DRAG_TIMEOUT_S + 0.005, drags[1])
    state = live.state()
    assert [drag.body for drag in state.drags] == [RIGHT]
    assert (state.user("left").hand_wrench == 0.0).all()


def test_gains_are_a_users_own_and_kept_by_a_reset(live, path):
    now = until(live, 0.0, 0.1)
    before = live.session.user("left").scene.controller.joint_constraint.stiffness
    assert live.take(Tune("right", STIFFNESS, 123.5), now) is None
    assert live.state().changed == (f"right/{STIFFNESS}=123.5",)
    number = live.opened.number
    told = live.take(Reset(), now)
    assert (told.number, told.asked.scene) == (number + 1, path)
    assert live.session.time == pytest.approx(0.001)
    held = [told.scene.held_at(point).controller for point in ("left", "right")]
    assert [one.joint_constraint.stiffness for one in held] == [before, 123.5]
    refused = live.take(Tune("nobody", STIFFNESS, 1.0), now)
    assert isinstance(refused, Failed)
    assert "must be a point that is held" in refused.reason


def test_a_user_holds_elsewhere_and_the_other_one_does_not(live):
    now = until(live, 0.0, 0.2)
    kept = live.state().user("right").device
    assert live.state().user("left").count == 2
    told = live.take(Hold("left", "link2"), now)
    assert told.scene.operational_point("left").link == "link2"
    assert live.state().number == told.number
    # Its joint to link 1 moves on a circle, and it turns there.
    assert live.state().user("left").count == 1
    assert told.scene.operational_point("right").link == "link3"
    # Held a moment later, both where they are.
    until(live, now, now + 0.5)
    state = live.state()
    assert state.error == ""
    mechanism = live.session.simulator.mechanism
    for point in ("left", "right"):
        terms = mechanism.evaluate(state.q, live.session.mechanism.v, state.active)
        at = terms.points[mechanism.point_index(point)].pose.translation
        assert state.user(point).device[:, 3] == pytest.approx(at, abs=2e-3)
    assert state.user("right").device == pytest.approx(kept, abs=2e-3)


def test_a_recording_has_each_users_contact_at_its_point(live, tmp_path):
    now = until(live, 0.0, 0.2)
    assert live.take(Record(str(tmp_path / "bag")), now) is None
    # A firm push on the left is felt on the right as part of F_c.
    now = until(live, now, now + 0.1, pull(live, 0.05))
    felt = live.state().user("right").contact
    assert live.take(Record(""), now) is None
    layout = StateLayout(Mechanism(live.session.scene))
    with BagReader(tmp_path / "bag") as reader:
        *_, last = [data for *_, data in reader.serialized("/mechanism/state")]
    contacts = layout.unpack(decode(last)).contacts
    assert contacts[1] == pytest.approx(felt, abs=1e-12)
    assert np.linalg.norm(felt) > 1e-3


def test_hands_are_chosen_for_each_user(path):
    written = load_scene(path)
    assert written.held_at("left").hand.kind == "arm"
    alone = load_scene(path, changes=changes_of(written))
    kinds = [alone.held_at(point).hand.kind for point in ("left", "right")]
    assert kinds == ["constant_wrench"] * 2
    own = load_scene(path, changes=changes_of(written, [OWN_HAND, "a relaxed arm"], 20.0))
    assert own.held_at("left").hand == written.held_at("left").hand
    assert own.held_at("right").hand.impedance == "relaxed"
    assert own.held_at("right").connection.delay == pytest.approx(0.02)
    # One choice is of all; a delay also of those who have a connection of their own.
    hands = [{"point": "left", "connection": {"expected": 0.01}}, {"point": "right"}]
    other = written.with_(hands=hands)
    changed = other.with_(*changes_of(other, [MOUSE_ALONE], 30.0))
    assert {changed.held_at(p).connection.delay for p in ("left", "right")} == {0.03}
    assert isinstance(changed, Scene)
    assert len(HANDS) == 4


def test_the_picture_has_every_hand_and_knows_which_is_meant(live):
    until(live, 0.0, 0.3)
    picture, state = LivePicture(live.opened), live.state()
    drawn = picture.drawn(state, frozenset())
    shown = {shape.namespace for shape in drawn.frame.shapes}
    for name in ("left", "right"):
        assert {f"{one}/{name}" for one in ("device", "mass", "free_directions")} <= shown
        place = state.user(name).device[:, 3]
        eye = place + np.array((0.0, 0.0, 1.0))
        assert drawn.body_at(eye, place, "link1") == ("hand", name)
        assert (drawn.held(Draggable("hand", name), place + 1.0)[0] == place).all()
    far = state.user("left").device[:, 3] + np.array((0.0, 0.3, 0.0))
    eye = far + np.array((0.0, 0.0, 1.0))
    assert drawn.body_at(eye, far, "link1") == ("link", "link1")
    assert drawn.body_at(eye, far, None) is None
    assert set(drawn.picture.hues) == {"left", "right"}
    hidden = picture.drawn(state, frozenset({"mass felt", "forces", "rigid and free directions"}))
    assert not {"mass", "free_directions"} & {s.meaning for s in hidden.frame.shapes}


def test_numbers_and_histories_are_each_users(live):
    now = until(live, 0.0, 0.2)
    until(live, now, now + 0.1, pull(live, 0.004))
    state, picture = live.state(), LivePicture(live.opened)
    text = numbers_html(state, picture.draw(state), "two", picture.hues, {LEFT: 3}, "")
    for user in state.users:
        assert f'<b id="live-count-{user.point}">{user.count}</b>' in text
        (shown,) = re.findall(f'<b id="live-force-{user.point}">(.*?)</b>', text)
        force = np.linalg.norm(user.hand_wrench[:3])
        assert float(shown) == pytest.approx(force, rel=5e-3, abs=5e-4)
    assert '<b id="live-dragged">hand left</b>' in text
    assert '<b id="live-holders">browser 4</b>' in text
    assert text.count("<span") == 2
    history = History()
    history.begin(picture.users, picture.directions)
    history.add(state)
    plots = {one.title: one.columns() for one in history.plots()}
    for user in state.users:
        assert plots[f"joint constraints felt ({user.point})"][1] == [user.count]
        forces = [np.linalg.norm(one[:3]) for one in (user.hand_wrench, user.on_hand)]
        assert [f[0] for f in plots[f"force ({user.point})"][1:]] == pytest.approx(forces)
        s = [column[0] for column in plots[f"response ({user.point})"][1:]]
        assert s == user.observation[: picture.directions].tolist()
    assert len(plots) == 7


def test_what_holds_a_device_is_told():
    assert holding(None, 3.0) == "the mouse alone"
    assert holding(ConstantWrenchHand(kind="constant_wrench"), 3.0) == "the mouse alone"
    pushing = ConstantWrenchHand(kind="constant_wrench", force=(0.3, 0.4, 0.0))
    assert holding(pushing, 3.0) == "a hand that pushes with 0.5 N and 0 N m"
    still = holding(STILL_HAND, 3.0)
    most = 1e3 * 3.0 / STILL_HAND.stiffness
    assert still.startswith(f"an arm of {STILL_HAND.stiffness:.3g} N/m: the mouse's 3 N")
    assert f"{most:.3g} mm at most" in still
    assert "cannot" not in still


def test_why_a_hand_is_not_dragged_is_told_in_its_row_and_to_the_browser_that_tried(live):
    state, picture = live.state(), LivePicture(live.opened)
    left, right = state.users
    stuck = replace(state, users=(left, replace(right, immovable="a <real> device")))
    text = numbers_html(stuck, picture.draw(stuck), "two", picture.hues, {}, "")
    assert '<b id="live-holding-right">cannot be dragged: a &lt;real&gt; device</b>' in text
    assert f'<b id="live-holding-left">{left.holding}</b>' in text
    paused = numbers_html(replace(state, paused=True), picture.draw(state), "two", {}, {}, "")
    assert "nothing moves while paused" in paused
    assert '<b id="live-you">browser 1</b>' in you_html(0, "")
    assert '<b id="live-refused">hand: browser 1 drags it</b>' in you_html(
        1, "hand: browser 1 drags it"
    )
