# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The four nodes, their messages and their loop: the only folder that imports rclpy."""
