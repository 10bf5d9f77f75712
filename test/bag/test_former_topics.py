# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bags recorded before topics were renamed are refused, and the present names said."""

from __future__ import annotations

from pathlib import Path

import pytest

from bag.record import Bytes
from hapticmech_ros.bag import BagReader, BagWriter
from hapticmech_ros.bag.reader import FORMER, present_name, refuse_former_topics
from hapticmech_ros.errors import BagError
from hapticmech_ros.experiment.from_bag import record_from_bag
from hapticmech_ros.graph.lockstep import LockstepRun, replay
from hapticmech_ros.loading import load_scene
from hapticmech_ros.wire.topics import TOPICS


@pytest.mark.parametrize(
    ("former", "present"),
    [
        ("/device/held_cf", "/device/hand_cf/persistent"),
        ("/device/held_cf/me", "/device/hand_cf/persistent/me"),
        ("/left/device/servo_gain", "/left/device/local_feedback_gain"),
        ("/mechanism/link2/held_cf/x", "/mechanism/link2/external_cf/persistent/x"),
        ("/a/b/mechanism/tip/grasp", "/a/b/mechanism/tip/set_operational_point"),
        ("/mechanism/tip/grasped", "/mechanism/tip/operational_point"),
        ("/analysis/handle/rendering", "/analysis/handle/operational_model"),
    ],
)
def test_a_former_name_has_a_present_one(former: str, present: str) -> None:
    assert present_name(former) == present
    assert present_name(present) == ""


def test_no_present_topic_has_a_former_name() -> None:
    names = {topic.name for topic in TOPICS}
    assert not any(present_name("/" + name.strip("/").format(point="handle")) for name in names)
    # Suffixes such as /persistent are no topics of their own in the table.
    presents = {
        name.replace(r"\1", "{point}").removesuffix("/persistent") for name in FORMER.values()
    }
    assert presents <= names


def recorded(path: Path, topic: str, data: bytes) -> Path:
    with BagWriter(path) as bag:
        bag.add_topic("/chatter", "geometry_msgs/msg/WrenchStamped")
        bag.add_topic(topic, "geometry_msgs/msg/WrenchStamped")
        bag.write(topic, 10**18, data)
    return path


def test_a_bag_with_a_former_topic_is_refused(tmp_path: Path, wrench_bytes: Bytes) -> None:
    path = recorded(tmp_path / "bag", "/mechanism/tip/held_cf", wrench_bytes(10**18, 1.0))
    rule = r"/mechanism/tip/held_cf is /mechanism/tip/external_cf/persistent now"
    with BagReader(path) as bag, pytest.raises(BagError, match=rule):
        refuse_former_topics(bag)
    with pytest.raises(BagError, match=rule):
        record_from_bag(path, load_scene("five_bar"))
    with pytest.raises(BagError, match=rule):
        replay(LockstepRun("", feed_from=path), {}, lambda: False)


def test_a_topic_of_another_package_is_accepted(tmp_path: Path, wrench_bytes: Bytes) -> None:
    with BagReader(recorded(tmp_path / "bag", "/rendering", wrench_bytes(10**18, 1.0))) as bag:
        refuse_former_topics(bag)
