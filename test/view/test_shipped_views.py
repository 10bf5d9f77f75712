# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files for RViz, PlotJuggler and Foxglove: well-formed, and all that they name is published."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from hapticmech_ros.loading import shipped_scenes
from hapticmech_ros.wire.messages import MechanismEnergy
from hapticmech_ros.wire.topics import TOPICS

CONFIG = Path(__file__).resolve().parents[2] / "config"
RVIZ = YAML(typ="safe", pure=True).load(CONFIG / "rviz" / "hapticmech.rviz")
PLOTJUGGLER = ElementTree.parse(CONFIG / "plotjuggler" / "hapticmech.xml").getroot()
FOXGLOVE = json.loads((CONFIG / "foxglove" / "hapticmech.json").read_text(encoding="utf-8"))
PUBLISHED = {f"/{topic.of('handle').lstrip('/')}": topic.type for topic in TOPICS}
# How PlotJuggler calls what diagnostics say, and how long spectra and flags are at most.
DIAGNOSTICS = re.compile(r"/diagnostics/(\w+)/(\w+)/(\w+)")
LONGEST_ARRAY = 6
TYPES = get_typestore(Stores.ROS2_JAZZY).fielddefs


def check_path(topic, path):
    """Check that a message of the topic has the field ``path``, such as ``wrench.force.x``."""
    kind = PUBLISHED[topic]
    for part in path:
        field, index = re.fullmatch(r"(\w+)(?:\[(\d+|:)\])?", part).groups()
        fields = dict(TYPES[kind][1])
        assert field in fields, f"{topic}: {kind} has no {field}"
        node, what = fields[field]
        if node in (Nodetype.SEQUENCE, Nodetype.ARRAY):
            assert index is not None, f"{topic}: {field} is an array"
            node, what = what[0]
            limit = (
                sum(MechanismEnergy.layout.values()) if topic.endswith("/energy") else LONGEST_ARRAY
            )
            assert index == ":" or int(index) < limit
        else:
            assert index is None, f"{topic}: {field} is no array"
        kind = what if node == Nodetype.NAME else None
    assert kind is None, f"{topic}: {'.'.join(path)} is not a number"


def topics_in(node):
    """Yield every value of a key Value below a key that names a topic."""
    if isinstance(node, dict):
        for key, value in node.items():
            if key in ("Topic", "Description Topic"):
                yield value
            else:
                yield from topics_in(value)
    elif isinstance(node, list):
        for value in node:
            yield from topics_in(value)


def test_rviz_subscribes_to_what_is_published():
    topics = list(topics_in(RVIZ))
    assert len(topics) == 6
    assert {topic["Value"] for topic in topics} <= set(PUBLISHED)
    latched = {topic.name for topic in TOPICS if topic.qos == "latched"}
    for topic in topics:
        expected = "Transient Local" if topic["Value"].lstrip("/") in latched else "Volatile"
        assert topic["Durability Policy"] == expected, topic["Value"]


def test_rviz_shows_each_type_by_its_display():
    assert RVIZ["Visualization Manager"]["Global Options"]["Fixed Frame"] == "world"
    kinds = {
        "rviz_default_plugins/MarkerArray": "visualization_msgs/msg/MarkerArray",
        "rviz_default_plugins/RobotModel": "std_msgs/msg/String",
        "rviz_default_plugins/Wrench": "geometry_msgs/msg/WrenchStamped",
    }
    displays = RVIZ["Visualization Manager"]["Displays"]
    seen = set()
    for display in displays:
        for topic in topics_in(display):
            assert PUBLISHED[topic["Value"]] == kinds[display["Class"]]
            seen.add(display["Class"])
    assert seen == set(kinds)
    assert "rviz_default_plugins/TF" in {display["Class"] for display in displays}


def test_plotjuggler_plots_numbers_that_are_published():
    names = [curve.get("name") for curve in PLOTJUGGLER.iter("curve")]
    assert len(names) > 20
    for name in names:
        if told := DIAGNOSTICS.fullmatch(name):
            scene, node, _ = told.groups()
            assert scene in shipped_scenes()
            assert node in {topic.publisher for topic in TOPICS}
            continue
        (topic,) = [t for t in PUBLISHED if name.startswith(f"{t}/")]
        check_path(topic, name[len(topic) + 1 :].split("/"))


def test_plotjuggler_subscribes_to_what_it_plots():
    (selected,) = PLOTJUGGLER.iter("selected_topics")
    topics = selected.get("value").split(";")
    assert set(topics) <= set(PUBLISHED)
    for curve in PLOTJUGGLER.iter("curve"):
        assert any(curve.get("name").startswith(f"{topic}/") for topic in topics)


def test_plotjuggler_counts_its_children_right():
    for splitter in PLOTJUGGLER.iter("DockSplitter"):
        sizes = [float(size) for size in splitter.get("sizes").split(";")]
        assert len(splitter) == int(splitter.get("count")) == len(sizes)
        assert sum(sizes) == pytest.approx(1.0, abs=1e-5)  # written with six digits
    for tab in PLOTJUGGLER.iter("Tab"):
        assert len(tab.findall("Container")) == int(tab.get("containers"))


def test_foxglove_plots_numbers_that_are_published():
    paths = [
        p["value"] for panel in FOXGLOVE["configById"].values() for p in panel.get("paths", [])
    ]
    assert len(paths) > 20
    for path in paths:
        topic, *fields = re.sub(r"\{[^}]*\}", "", path).split(".")
        if topic == "/diagnostics":
            assert fields == ["status[:]", "values[:]", "value"]
            assert set(re.findall(r'name=="(\w+)"', path)) <= {t.publisher for t in TOPICS}
        else:
            check_path(topic, fields)


def test_foxglove_lays_out_every_panel_once():
    def panels(node):
        if isinstance(node, str):
            return [node]
        assert node["direction"] in ("row", "column")
        assert 0 < node["splitPercentage"] < 100
        return [*panels(node["first"]), *panels(node["second"])]

    assert sorted(panels(FOXGLOVE["layout"])) == sorted(FOXGLOVE["configById"])
    kinds = {name.split("!")[0] for name in FOXGLOVE["configById"]}
    assert kinds == {"3D", "Plot", "StateTransitions", "DiagnosticSummary"}


def test_foxglove_shows_the_picture():
    panel = FOXGLOVE["configById"]["3D!picture"]
    assert set(panel["topics"]) <= set(PUBLISHED)
    assert panel["topics"]["/view/markers"]["visible"]
    assert panel["followTf"] == "world"
