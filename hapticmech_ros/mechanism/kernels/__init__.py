# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of Eq. 1, and the arrays that they take.

A mechanism's constants are in :mod:`model`, terms at a configuration in :mod:`data`, and what a
step works on in :mod:`step_kernels`.
"""
