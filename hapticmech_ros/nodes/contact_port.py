# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Topics of what touches what: every point of contact, and each declared pair's own wrench."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import WrenchStamped
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.parameters import MechanismParameters
from hapticmech_ros.wire.contact_points import ContactLayout
from hapticmech_ros.wire.topics import CONTACT_FORCE, CONTACTS
from hapticmech_ros.wire.wrench import encode_wrench

if TYPE_CHECKING:
    from hapticmech_ros.contact.touching import Touching


_NONE = np.zeros(6)


class ContactPort:
    """Publishes what touches, of a scene with contacts or without, to those who subscribe.

    Args:
        actor: the mechanism's.
        names: of the scene's contacts; without any there are no topics.
    """

    def __init__(self, actor: Actor[MechanismParameters], names: Sequence[str]) -> None:
        self._layout = ContactLayout(names)
        self._points = [actor.view(CONTACTS, Float64MultiArray)] if names else []
        self._pairs = [actor.view(CONTACT_FORCE, WrenchStamped, name) for name in names]

    def publish(self, touching: Touching | None, time_ns: int) -> None:
        """Publish the points of contact of the step that led to a time; None: nothing touches."""
        for outlet in self._points:
            if outlet.wanted:
                outlet.publish(self._layout.encode(touching, time_ns))
        for pair, outlet in enumerate(self._pairs):
            if outlet.wanted:
                wrench = _NONE if touching is None else touching.wrench(pair)
                outlet.publish(encode_wrench(wrench, time_ns))
