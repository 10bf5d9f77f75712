# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Visualisation: the scene viewer, as messages, and the live page, in a browser."""
