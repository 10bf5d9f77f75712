# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package's environment: processors, processes, discovery, installed packages."""
