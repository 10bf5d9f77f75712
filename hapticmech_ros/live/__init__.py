# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live page: a session in real time in a process of its own, seen and moved in a browser."""
