# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Haply's Inverse3: its service's protocol, a driver of it, and an emulator of both.

Written from the protocol's documentation (docs.haply.co, Inverse service 3.5), not yet tried on
hardware.
"""
