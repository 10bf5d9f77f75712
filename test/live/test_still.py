# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A file without any mass: the page draws it as it is written, says why, and moves nothing."""

import itertools
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from hapticmech_ros.cli import app
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.live.commands import Drag, Draggable, LiveState, Open, Opened
from hapticmech_ros.live.live_picture import LivePicture
from hapticmech_ros.live.page import LivePage
from hapticmech_ros.live.page_controls import numbers_html
from hapticmech_ros.live.still import StillScene
from hapticmech_ros.mechanism.inertia import NO_MASS
from oracles.generator import blank

URDF = """<robot name="bare"><link name="base"/><link name="arm"/>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.3"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture
def still(tmp_path):
    (tmp_path / "bare.urdf").write_text(URDF, encoding="utf-8")
    return StillScene(Open(str(tmp_path / "bare.urdf")))


def test_it_is_drawn_and_no_number_of_it_is_told(still):
    opened, state = still.news(0.0)
    assert isinstance(opened, Opened)
    assert isinstance(state, LiveState)
    picture = LivePicture(opened)
    drawn = picture.drawn(state, frozenset())
    meanings = {shape.meaning for shape in drawn.frame.shapes}
    assert "joints" in meanings
    assert not meanings & {"mass", "rigid_directions", "free_directions", "device"}
    told = numbers_html(state, drawn.frame, "bare", picture.hues, {}, "")
    assert NO_MASS in told
    assert "mass felt" not in told
    assert drawn.body_at(np.ones(3), np.zeros(3), None) is None
    still.send(Drag(Draggable("link", "arm"), np.zeros(3), np.ones(3)))
    assert still.news(0.0) == []


def test_the_page_opens_it(still):
    page = LivePage(still, "bare", (), [], "127.0.0.1", 8123)
    try:
        turns = itertools.count()
        page.serve(lambda: next(turns) > 2)
        assert page.address.startswith("http://127.0.0.1:")
    finally:
        page.close()


def test_a_mass_that_is_given_lets_it_move(tmp_path, monkeypatch):
    def begun(asked):
        raise HapticMechError(f"begun with {asked.changes[-1]}")

    def drawn(scene):
        raise AssertionError(scene)

    monkeypatch.setattr("hapticmech_ros.live.process.LiveProcess", begun)
    monkeypatch.setattr("hapticmech_ros.live.still.StillScene", drawn)
    none = dict.fromkeys(("ixx", "iyy", "izz"), 0.0)
    scene = blank() | {
        "links": [
            {
                "name": "arm",
                "joint": {"name": "j", "type": "revolute"},
                "inertial": {"mass": 0.0, "inertia": none},
            }
        ],
        "operational_points": [
            {"name": "tip", "link": "arm", "metric": {"mass": 1.0, "length": 0.1}}
        ],
    }
    (tmp_path / "bare.yaml").write_text(json.dumps(scene), encoding="utf-8")
    given = "links.arm.inertial={mass: 1.0, inertia: {ixx: 0.1, iyy: 0.1, izz: 0.1}}"
    command = ["live", str(tmp_path / "bare.yaml"), "--set", given]
    with pytest.raises(HapticMechError, match=r"begun with links\.arm"):
        CliRunner().invoke(app, command, catch_exceptions=False)
