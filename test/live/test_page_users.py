# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two users on one page, in two browsers' tabs: each drags a hand, and leaving frees it."""

from __future__ import annotations

import numpy as np
import pytest

from live.in_browser import Browser, Served, drag, sight, wait_until
from oracles.users import five_bar_of_two

# A browser without a GPU draws with the processor.
pytestmark = pytest.mark.alone


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return str(five_bar_of_two(tmp_path_factory.mktemp("scene")))


@pytest.fixture(scope="module")
def served(scene):
    with Served((scene,)) as found:
        yield found


@pytest.fixture
def browsers(tmp_path_factory):
    found = [Browser(tmp_path_factory.mktemp("chromium")) for _ in range(2)]
    yield found
    for one in found:
        one.close()


def dragged(served):
    """Return what is dragged now."""
    return {drag.body: drag for drag in served.process.states[-1][1].drags}


def hand(served, seen, point):
    """Return where (x, y) a hand is on a page now."""
    return seen.pixel(served.process.states[-1][1].user(point).device[:, 3])


def test_two_people_drag_a_hand_each_and_who_leaves_frees_it(browsers, served, scene):
    tabs = [browser.page() for browser in browsers]
    for tab in tabs:
        tab.open(served.address)
    one, two = tabs
    for tab in tabs:
        tab.wait_for_text("live-count-left", "2")
        tab.wait_for_text("live-count-right", "1")
        tab.wait_for_text("live-holding-right", "the mouse alone")
    names = [wait_until(lambda tab=tab: tab.text("live-you"), "its name") for tab in tabs]
    assert len(set(names)) == 2

    seen = sight(one, scene)
    drag(one, hand(served, seen, "left"), 30.0)
    one.wait_for_text("live-dragged", "hand left")
    two.wait_for_text("live-holders", names[0])

    # The same hand is refused to the other one, who is told who has it.
    x, y = drag(two, hand(served, seen, "left"), 10.0)
    two.wait_for_text("live-refused", f"hand left: {names[0]} drags it")
    two.mouse("mouseReleased", x, y)
    assert one.text("live-refused") == ""
    assert set(dragged(served)) == {("hand", "left")}

    drag(two, hand(served, seen, "right"), 20.0)
    wait_until(lambda: len(dragged(served)) == 2, "both to be dragged")
    one.wait_for_text("live-dragged", "hand left, hand right")
    one.wait_for_text("live-holders", ", ".join(names))
    wait_until(lambda: two.text("live-refused") == "", "the refusal to go")

    def forces():
        return [np.linalg.norm(one.force) for one in dragged(served).values()]

    wait_until(lambda: len(forces()) == 2 and min(forces()) > 0.01, "two forces")
    one.close()
    wait_until(lambda: set(dragged(served)) == {("hand", "right")}, "the left hand to be free")
    two.wait_for_text("live-dragged", "hand right")


def test_each_user_has_controls_of_its_own(browsers, served):
    tab = browsers[0].page()
    tab.open(served.address)
    wait_until(lambda: tab.text("live-count-right"), "the numbers")
    tab.click_text("p, span, div", "tune")
    tab.click_text("p, span, div", "gains")
    tab.nudge("right constraint stiffness, N/m")
    found = wait_until(lambda: tab.text("live-changed"), "a changed gain")
    assert found.startswith("right/controller.joint_constraint.stiffness=")
    asked = {one.partition("//")[2].split("/")[0] for one in tab.addresses()}
    assert asked == {served.address.partition("//")[2]}
