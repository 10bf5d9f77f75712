# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The live page: a session in real time in a separate process, shown and moved in a browser."""
