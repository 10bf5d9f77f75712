# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of Eq. 1, and the arrays that they take.

A mechanism's constants and terms at a configuration are in :mod:`model`, and what a
step works on in :mod:`step_kernels`.
"""
