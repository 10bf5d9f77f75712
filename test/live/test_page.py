# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page in a browser, used as people use it: looked at, dragged, set, closed."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from hapticmech_ros.live.grip import DRAG_TIMEOUT_S
from hapticmech_ros.live.live_picture import LivePicture
from live.in_browser import Browser, Served, drag, sight, wait_until

# A browser without a GPU draws with the processor.
pytestmark = pytest.mark.alone
BIN = Path(sys.prefix) / "bin"
SCENE, SCENES = "five_bar", ("five_bar", "two_link")
# A wrench of a closed tab ends within this, s.
ENDS_S = 0.2


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    found = Browser(tmp_path_factory.mktemp("chromium"))
    yield found
    found.close()


@pytest.fixture(scope="module")
def served():
    with Served(SCENES) as found:
        yield found


@pytest.fixture
def page(browser, served):
    found = browser.page()
    served.opened_in(found)
    yield found
    found.close()
    found.connection.ended()


def drag_hand(page, metres):
    """Pull the hand to the left by some metres; return where (x, y) it is then, px."""
    seen = sight(page, SCENE)
    return drag(page, seen.hand, metres * seen.scale)


def bodies(served):
    """Return what is dragged now."""
    return [drag.body for drag in served.process.states[-1][1].drags]


def force_of(state):
    """Return the wrench (6,) of the first user's hand."""
    return state.users[0].hand_wrench


def reset(page):
    """Begin anew, and wait until the page has heard of it."""
    before = float(page.text("live-time"))
    page.click_text("button", "reset")
    wait_until(lambda: float(page.text("live-time")) < before, "the session to begin anew")


def test_it_shows_numbers_and_asks_nobody_but_this_machine(page, served):
    page.wait_for_text("live-count", "1")
    page.wait_for_text("live-scene", "five_bar")
    place = served.address.partition("//")[2]
    asked = wait_until(
        lambda: {one for one in page.addresses() if one.startswith("ws")} and page.addresses(),
        "the page's websocket",
    )
    assert {one.partition("//")[2].split("/")[0] for one in asked} == {place}
    assert (
        page.ask("[...document.querySelectorAll('*')].some(e => /share/i.test(e.ariaLabel))")
        is False
    )


def test_the_five_bar_is_dragged_until_two_constraints_are_felt(page):
    reset(page)
    x, y = drag_hand(page, 0.05)
    page.wait_for_text("live-dragged", "hand")
    page.wait_for_text("live-count", "2")
    page.mouse("mouseReleased", x, y)
    page.wait_for_text("live-dragged", "nothing")
    page.wait_for_text("live-force", "0")


@pytest.mark.parametrize("link", ["link1", "link4"])
def test_a_link_is_dragged_where_it_is_grabbed(page, served, link):
    reset(page)
    seen = sight(page, SCENE)
    (limb,) = [ends for name, ends in seen.frame.placement.limbs if name == link]
    x, y = drag(page, seen.pixel(limb.mean(axis=0)), 40.0)
    page.wait_for_text("live-dragged", link)
    wait_until(lambda: bodies(served) == [("link", link)], link)
    state = served.process.states[-1][1]
    # On its limb: as far from either end as the limb is long, both together.
    placed = LivePicture(served.process.opened[-1]).draw(state).placement
    (limb,) = [ends for name, ends in placed.limbs if name == link]
    near = np.linalg.norm(limb - state.drags[0].grip * (1, 1, 0), axis=1).sum()
    assert near == pytest.approx(np.linalg.norm(limb[1] - limb[0]), rel=0.05)
    page.mouse("mouseReleased", x, y)
    page.wait_for_text("live-dragged", "nothing")


def test_a_mouse_that_is_held_still_goes_on_pulling(page, served):
    """Such a mouse says nothing; on a busy machine it may be let go for a moment."""
    reset(page)
    x, y = drag_hand(page, 0.05)
    page.wait_for_text("live-dragged", "hand")
    begun = served.process.states[-1][1].time
    wait_until(lambda: served.process.states[-1][1].time > begun + 5.0 * DRAG_TIMEOUT_S, "a while")
    wait_until(lambda: bodies(served) == [("hand", "handle")], "the hand to be dragged")
    page.mouse("mouseReleased", x, y)
    page.wait_for_text("live-dragged", "nothing")


def test_what_is_seen_is_saved_as_a_picture(page):
    page.click_text("p, span, div", "look")
    page.click_text("button", "save a picture")
    wait_until(lambda: "five_bar.png" in page.ask("document.body.innerText"), "the file")


def test_another_scene_is_chosen(page, served):
    for name, count in (("two_link", "1"), ("five_bar", "1")):
        page.click_text("p, span, div, label, input", "scene")
        box = (
            "(() => { const i = [...document.querySelectorAll('input')].filter("
            "e => ['five_bar', 'two_link'].includes(e.value))[0]; i.scrollIntoView();"
            " const r = i.getBoundingClientRect();"
            " return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        page.click(*page.ask(box))
        page.click_text("[role=option]", name)
        page.wait_for_text("live-scene", name)
        page.wait_for_text("live-count", count)
    assert [one.scene.name for one in served.process.opened][-2:] == ["two_link", "five_bar"]


def test_the_wrench_of_a_closed_tab_ends(browser, served, page):
    reset(page)
    page.close()
    tab = browser.page()
    served.opened_in(tab)
    drag_hand(tab, 0.05)
    wait_until(lambda: abs(force_of(served.process.states[-1][1])[0]) > 0.1, "a force")
    begun = time.monotonic()
    tab.close()
    closed = tab.connection.ended()

    def ended():
        after = [one for one in served.process.states if one[0] > begun]
        return [at for at, state in after if not state.drags and not force_of(state).any()]

    assert wait_until(ended, "the wrench to end")[0] - closed < ENDS_S


def test_the_command_serves_until_it_is_interrupted(browser):
    process = subprocess.Popen(
        [BIN / "hapticmech", "live", "two_link", "--port", "8790"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        address = process.stdout.readline().split(";")[0]
        assert address.startswith("http://127.0.0.1:")
        tab = browser.page()
        tab.open(address)
        tab.wait_for_text("live-scene", "two_link")
        tab.close()
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == 0
    finally:
        process.kill()
        process.wait()
