# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ways of a message from one process to another of the same host, compared."""
