# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of the mechanism and reach of its loop."""

import numpy as np
import pytest

from hapticmech_ros.experiment.figures import taut_circle
from hapticmech_ros.loading import load_scene
from hapticmech_ros.simulation import Simulator
from hapticmech_ros.view.placement import skeleton
from oracles.running import varied


def test_links_of_the_five_bar_end_to_end(scene):
    q = np.array((1.9, -1.2, -1.84741566, 0.61326591))
    drawing = skeleton(scene, q)
    ends = np.cumsum(q)
    lengths = np.array((0.045, 0.045, 0.045, 0.06))
    corners = np.zeros((5, 3))
    corners[1:, 0] = np.cumsum(lengths * np.cos(ends))
    corners[1:, 1] = np.cumsum(lengths * np.sin(ends))
    found = {}
    for name, line in drawing.links:
        found.setdefault(name, line)
    for index, name in enumerate(("link1", "link2", "link3", "link4")):
        assert found[name] == pytest.approx(corners[index : index + 2], abs=1e-15)
    assert drawing.ground == pytest.approx(np.array(((0, 0, 0), (0.09, 0, 0))), abs=1e-15)


def test_circle_on_which_the_pair_is_taut(scene, session_record):
    circle = taut_circle(scene)
    assert circle.centre.tolist() == [0.09, 0.0]
    assert circle.radius == pytest.approx(0.105, rel=1e-15)
    distance = np.linalg.norm(session_record.point_position[:, :2] - circle.centre, axis=1)
    assert distance.max() <= circle.radius + 1e-12
    assert distance[-1] == pytest.approx(circle.radius, abs=1e-4)


def test_no_circle_where_it_is_not_simple(scene):
    moved = varied(scene.operational_points[0], link="link4")
    for other in ({"closures": ()}, {"operational_points": (moved,)}):
        assert taut_circle(varied(scene, **other)) is None
    assert taut_circle(load_scene("spatial_arm")) is None


def test_ropes_and_slides_are_drawn_from_end_to_end():
    crane = load_scene("crane")
    state = Simulator(crane).initial_state()
    (rope,) = [closure for closure in crane.closures if closure.kind == "rod"]
    lengths = [np.linalg.norm(bar[1] - bar[0]) for bar in skeleton(crane, state.q).bars]
    assert rope.length == pytest.approx(min(lengths, key=lambda found: abs(found - rope.length)))
    platform = load_scene("stewart_platform")
    legs = skeleton(platform, Simulator(platform).initial_state().q)
    assert len(legs.bars) == 6
    assert np.ptp([np.linalg.norm(bar[1] - bar[0]) for bar in legs.bars]) < 1e-9
    for bar in legs.bars:
        assert np.abs(legs.ground - bar[0]).sum(axis=1).min() < 1e-12
