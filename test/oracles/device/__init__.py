# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The readable device, in plain NumPy and Pinocchio, that kernels are compared with."""
