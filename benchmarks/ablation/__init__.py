# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ablation: what each feature of a scene costs in a tick, and what one that is not used costs."""
