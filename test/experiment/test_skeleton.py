"""Lines of the mechanism and reach of its loop."""

import numpy as np
import pytest

from hapticmech_ros.experiment.reach import taut_circle
from hapticmech_ros.scene import load_scene
from hapticmech_ros.view.skeleton import skeleton


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
    assert taut_circle(load_scene("spatial_arm")) is None
    assert taut_circle(scene.model_copy(update={"closures": ()})) is None
    moved = scene.operational_points[0].model_copy(update={"link": "link4"})
    assert taut_circle(scene.model_copy(update={"operational_points": (moved,)})) is None
