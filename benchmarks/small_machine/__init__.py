# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether ``hapticmech demo`` works on two processors: alone, beside others, with less of them."""
