# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What real-time scheduling and pinned processors bring to the graph."""
