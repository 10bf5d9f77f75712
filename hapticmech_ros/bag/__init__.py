# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading, writing, checking, comparing and repairing rosbag2 files without ROS."""

from hapticmech_ros.bag.reader import BagMessage, BagReader, BagTopic, read_topic
from hapticmech_ros.bag.writer import BagWriter

__all__ = ["BagMessage", "BagReader", "BagTopic", "BagWriter", "read_topic"]
