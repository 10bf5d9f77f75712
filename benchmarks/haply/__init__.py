# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The driver of a Haply Inverse3, against the emulated service in a process of its own."""
