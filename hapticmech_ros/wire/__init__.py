# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages between nodes, without ROS: topic names and layouts of multi-array messages.

Nodes, bags, experiments and docs/topics.md all take names and layouts from here.
"""
