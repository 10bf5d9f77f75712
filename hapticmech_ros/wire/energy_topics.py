# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Topics of energies, J."""

from __future__ import annotations

from hapticmech_ros.wire.topic import ARRAY, CONTROLLER, DEVICE, MECHANISM, Topic

DEVICE_ENERGY = Topic(
    "device/energy",
    ARRAY,
    DEVICE,
    "stamp; energy from the hand, absorbed by the actuators, received by the mechanism as far as "
    "known, available, and dissipated by passivity control, J",
)
CONTROLLER_ENERGY = Topic(
    "controller/energy",
    ARRAY,
    CONTROLLER,
    "stamp; energy given to the mechanism, stored in springs, injected by changes of springs, and "
    "dissipated in dampers, J",
)
ENERGY = Topic(
    "mechanism/energy",
    ARRAY,
    MECHANISM,
    "stamp, kinetic and potential energy, work by wrenches, losses (J), closure error (m, rad)",
)
