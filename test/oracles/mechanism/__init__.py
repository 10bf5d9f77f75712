# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism in Pinocchio and NumPy, to be read: what kernels are compared with."""
