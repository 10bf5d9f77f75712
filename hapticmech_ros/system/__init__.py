# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What runs this package: processors, processes, the middleware's discovery, what is installed."""
