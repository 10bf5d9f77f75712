# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a parameter study gains from workers, of this machine and of a cluster."""
