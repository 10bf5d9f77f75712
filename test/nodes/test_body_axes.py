"""Commands in a device's own axes: said where these are known, and not otherwise."""

from __future__ import annotations

import numpy as np
import yaml

from benchmarks.reliability.fake_graph import ACTORS, FakeGraph, applied_in
from hapticmech_ros.scene import document_of, load_scene


def test_where_no_pose_was_heard_nothing_is_said_in_its_axes(tmp_path):
    """A device with ``device/state`` is not heard by its poses, and is commanded in the world's."""
    document = document_of(load_scene("five_bar"))
    document["device"]["servo_axes"] = "body"
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(document))
    graph = FakeGraph(str(path), actors=ACTORS[:4])
    graph.run(0.5)
    assert np.linalg.norm(applied_in(graph.last["/device/state"])[:3]) > 0.1
    assert "/device/body/servo_cf" not in graph.last
