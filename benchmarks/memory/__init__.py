# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Memory: whether session and nodes stay as large as they are, for an hour and for good."""
