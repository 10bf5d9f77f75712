# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The page as it is sent to a browser: what to do, the panel's words, legend, ground, plots."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from hapticmech_ros.live.commands import COMMANDS, Open
from hapticmech_ros.live.live_picture import LivePicture
from hapticmech_ros.live.live_session import LiveSession
from hapticmech_ros.live.page import LivePage
from hapticmech_ros.live.page_controls import COLOUR_WORDS, numbers_html
from hapticmech_ros.live.settings import changes_of
from hapticmech_ros.loading import load_scene
from hapticmech_ros.operational.results import felt_masses
from hapticmech_ros.view.drawn import scale_of
from hapticmech_ros.view.palette import MEANING
from hapticmech_ros.view.shapes import MASS

pytest.importorskip("viser")


class Backend:
    """A session that stands still."""

    takes = COMMANDS

    def __init__(self, scene):
        self.session = LiveSession(Open(scene, changes_of(load_scene(scene))), 0.0)
        for now in np.arange(0.0, 0.5, 0.005):
            self.session.advance(now)

    def send(self, command):
        raise AssertionError(command)

    def news(self, _timeout_s):
        return [self.session.opened, self.session.state()]


class Sent:
    """What a page has sent, by type."""

    def __init__(self, scene):
        self.backend = Backend(scene)
        page = LivePage(self.backend, scene, (), [], "127.0.0.1", 8130)
        try:
            turns = itertools.count()
            page.serve(lambda: next(turns) > 1)
            self.picture = page._picture
            self.drawn = self.picture.drawn(self.backend.session.state(), frozenset())
            page._with_viser(lambda: page._show(self.drawn))
            buffer = page._server._websock_server._broadcast_buffer
            self.messages = list(buffer.message_from_id.values())
        finally:
            page.close()

    def of(self, kind):
        return [one for one in self.messages if type(one).__name__ == kind]

    def named(self, name):
        (found,) = [
            one
            for one in self.messages
            if name == getattr(one, "name", "") and hasattr(one, "props")
        ]
        return found.props


@pytest.fixture(scope="module")
def sent():
    return Sent("five_bar")


def test_the_first_line_says_what_to_drag(sent):
    root = [one for one in sent.of("GuiHtmlMessage") if one.container_uuid == "root"]
    first = min(root, key=lambda one: one.props.order)
    assert "Drag the yellow ball (your hand) or any link." in first.props.content
    red, green, blue, _ = MEANING["device"]
    assert min(red, green) > 2.0 * blue


def test_of_the_panels_folders_one_is_open(sent):
    folders = [one for one in sent.of("GuiFolderMessage") if one.container_uuid == "root"]
    found = {one.props.label: one.props.expand_by_default for one in folders}
    assert found == {"legend and help": False, "feel": True, "look": False, "tune": False}


def test_colours_have_the_names_that_the_legend_gives_them():
    """Of the legend's colours each is nearest to that of its name: what is pale is seen through."""
    names = {meaning: name.removeprefix("pale ") for meaning, name in COLOUR_WORDS.items()}
    assert {meaning for meaning in names if names[meaning] != COLOUR_WORDS[meaning]} == {MASS}
    for meaning, name in names.items():
        colour = np.array(MEANING[meaning][:3])
        far = {one: np.linalg.norm(colour - to_rgb(f"xkcd:{one}")) for one in names.values()}
        assert min(far, key=far.get) == name
    assert MEANING[MASS][3] < 0.3


def test_a_button_says_how_long_a_period_is(sent):
    labels = [one.props.label for one in sent.of("GuiButtonMessage")]
    (said,) = [
        re.fullmatch(r"step one period \((.*) ms\)", one) for one in labels if "period" in one
    ]
    assert 1e-3 * float(said[1]) == sent.backend.session.session.period


def test_the_legend_names_all_that_is_drawn_and_the_grounds_squares(sent):
    (text,) = [
        one.props.content for one in sent.of("GuiHtmlMessage") if "live-legend" in one.props.content
    ]
    for meaning in {shape.meaning for shape in sent.drawn.frame.shapes} - {"count", "point"}:
        colour = "".join(f"{round(255 * part):02x}" for part in MEANING[meaning][:3])
        assert f"#{colour}" in text, meaning
    assert "spring" not in text.split("Λ")[0]
    # The distance of neighbouring lines.
    cell = np.diff(np.unique(sent.named("/ground").points[:, 0, 0].round(6))).min()
    length, words = scale_of(1.001 * cell)
    assert length == pytest.approx(cell, rel=1e-4)
    assert f"is {words} wide" in text
    assert "inverse inertia" in text


def test_the_ellipsoid_is_smooth_and_seen_through_and_drawn_after_what_is_opaque(sent):
    ellipsoid = sent.named("/seen/translucent/sphere")
    assert max(ellipsoid.batched_opacities) <= 0.3
    # Within 1 % of the sphere, in the middle of a triangle as well.
    middles = ellipsoid.vertices[ellipsoid.faces].mean(axis=1)
    assert 2.0 * np.linalg.norm(middles, axis=1).min() > 0.99
    assert ellipsoid.side == "back"
    nodes = {one.name: one.props for one in sent.of("BatchedMeshesMessage")}
    assert any("/opaque/" in name for name in nodes)
    for name, props in nodes.items():
        assert (props.batched_opacities is None) == ("/opaque/" in name)


def test_background_ground_and_axes_are_there(sent):
    texts = [one.props.content for one in sent.of("GuiHtmlMessage")]
    (style,) = [one for one in texts if one.startswith("<style>canvas")]
    colour = [int(part) for part in re.findall(r"\d+", style)]
    assert len(colour) == 3
    assert 200 < max(colour) < 248
    # Of a grid's lines both colours are seen against it, and those of a fifth line better.
    ground = sent.named("/ground")
    assert len(ground.points) > 10
    kinds = np.unique(ground.colors[:, 0], axis=0).astype(int)
    assert len(kinds) == 2
    assert (kinds.max(axis=0) < np.array(colour) - 20).all()
    shown = {one.name: one.visible for one in sent.of("SetSceneNodeVisibilityMessage")}
    assert shown["/WorldAxes"]


def test_plots_have_titles_with_units_and_room_for_their_numbers(sent):
    plots = {one.props.title: one.props for one in sent.of("GuiUplotMessage")}
    assert set(plots) == {"joint constraints felt", "response", "force", "speed"}
    for plot in plots.values():
        assert plot.axes[0]["label"] == plot.series[0]["label"] == "time, s"
        assert plot.padding[0] > 0
        # The page writes three decimals.
        assert min(plot.axes[1]["incrs"]) >= 1e-3
        assert plot.scales["y"]["range"]["max"]["soft"] > 0.0
    assert plots["force"].axes[1]["label"] == "N"
    labels = [one["label"] for plot in plots.values() for one in plot.series]
    assert not any(re.match(r"s\d*$", one) for one in labels)


def test_a_mass_in_a_rigid_direction_is_said_without_a_number():
    """Of an arm that is nearly straight: along it the mass is finite, and no one feels it."""
    nearly = "initial_state={q: {joint1: 0.5, joint2: 0.002}}"
    session = LiveSession(Open("two_link", (*changes_of(load_scene("two_link")), nearly)), 0.0)
    state, picture = session.state(), LivePicture(session.opened)
    frame = picture.draw(state)
    light, heavy = felt_masses(frame.analyses["handle"])[0]
    assert 1e4 < heavy < np.inf
    assert state.users[0].count == 1
    shown = re.search('id="live-mass">(.*?)<', numbers_html(state, frame, "two", {}, {}, ""))
    first, second = shown[1].split(", ")
    assert (float(first), second) == (pytest.approx(light, rel=5e-3), "rigid")
