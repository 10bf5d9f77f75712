# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of Eq. 1, and the arrays that they take.

A mechanism's constants and terms at a configuration are in :mod:`model`, and a step's data in
:mod:`step_kernels`.
"""
