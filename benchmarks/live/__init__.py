# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live page: pictures a second, and from the mouse to its force."""
