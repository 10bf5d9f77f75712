# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Speed: simulators side by side, on the same mechanism, checked first and timed then."""
