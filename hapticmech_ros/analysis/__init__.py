# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Transparency, stability limits and passivity of the closed loop of a scene, device and hand.

Studies for a laboratory's own device and scene: felt impedance, Z-width and M-width, energy over
delayed connections, and a comparison of the architecture with a virtual coupling. ``offline/``
analyses the mechanism alone, over a recording or over a grid of joint positions.
"""
