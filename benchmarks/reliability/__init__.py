# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The reliability campaign: clocks, doubles, kills, networks, files and bytes against the graph."""
