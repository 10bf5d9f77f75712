# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The graph as processes, in real time or in lockstep, and the experiment over it."""
