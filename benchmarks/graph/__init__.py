# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph beside a bare one: same processes, topics, messages and rates, empty callbacks."""
