# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Robots through singular poses and against a wall, by three laws, in MuJoCo."""
