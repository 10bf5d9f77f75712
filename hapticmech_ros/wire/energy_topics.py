"""Topics of what flows where, in J."""

from __future__ import annotations

from hapticmech_ros.wire.topic import ARRAY, CONTROLLER, DEVICE, MECHANISM, Topic

DEVICE_ENERGY = Topic(
    "device/energy",
    ARRAY,
    DEVICE,
    "stamp; J from the hand, taken by the actuators, and got by the mechanism as far as is known; "
    "what may be given, and what passivity control has taken",
)
CONTROLLER_ENERGY = Topic(
    "controller/energy",
    ARRAY,
    CONTROLLER,
    "stamp; J given to the mechanism, held in springs, come by springs that changed, lost in "
    "dampers",
)
ENERGY = Topic(
    "mechanism/energy",
    ARRAY,
    MECHANISM,
    "stamp, kinetic and potential energy, work by wrenches, losses (J), closure error (m, rad)",
)
