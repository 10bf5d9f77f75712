# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Topics of contacts, in scenes that have some."""

from __future__ import annotations

from hapticmech_ros.wire.topic import ARRAY, MECHANISM, PAGE, VIEWER, WRENCH, Topic

CONTACTS = Topic(
    "mechanism/contacts",
    ARRAY,
    MECHANISM,
    "stamp, then for each point of contact its pair, position, normal, depth and force. Also "
    "`mechanism/contacts/<contact>/measured_cf`, the wrench of one pair: by shape b, on shape a, "
    "at the origin of a's frame, axes of `world`",
    (VIEWER, PAGE),
    rate="contact",
)
# One for each declared pair, whose name takes the place of the point's.
CONTACT_FORCE = Topic(
    "mechanism/contacts/{point}/measured_cf",
    WRENCH,
    MECHANISM,
    "by shape b, on shape a, at the origin of a's frame, axes of `world`",
    rate="contact",
)
