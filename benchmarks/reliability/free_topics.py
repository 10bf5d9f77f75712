# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Topics on which anybody may speak: pushes, and where an operational point is.

On the others a stranger is a second publisher, and the device is at zero for that alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped

from hapticmech_ros.nodes.external_wrenches import PERSISTENT
from hapticmech_ros.nodes.messages import message_class
from hapticmech_ros.scene import Scene
from hapticmech_ros.wire.topics import DEVICE_BODY_FORCE, TOPICS, WRENCH

# Numbers of a wrench, 8 bytes each, are its last.
_WRENCH_BYTES = 48
# Links that are pushed, beside the points.
_LINKS = 2


def free_topics(scene: Scene, who: str) -> dict[str, Any]:
    """Return relative names and message types of a scene's topics that have no owner.

    Args:
        scene: whose points and links are pushed.
        who: name below those of pushes, which are summed.
    """
    points = [point.name for point in scene.operational_points]
    links = [link.name for link in scene.links][:_LINKS]
    found: dict[str, Any] = {}
    for topic in TOPICS:
        # Nobody hears a driver's wrench in its own axes but with ``device.servo_axes``.
        if topic.publisher != "any" or topic is DEVICE_BODY_FORCE:
            continue
        kind = message_class(topic.type)
        pushes = topic.type == WRENCH
        for name in dict.fromkeys(topic.of(body) for body in (*points, *(links if pushes else ()))):
            below = (f"/{who}", f"{PERSISTENT}/{who}") if pushes else ("",)
            found.update({f"{name}{one}": kind for one in below})
    return found


def gentler(kind: Any, message: bytes, force: float, torque: float) -> bytes:
    """Return a message whose push, where it is one of numbers, is at most so large.

    Args:
        kind: the message type; other than wrenches stay as they are.
        message: its bytes.
        force: N, of each axis.
        torque: N m, of each axis.
    """
    if kind is not WrenchStamped or len(message) < _WRENCH_BYTES:
        return message
    values, most = np.frombuffer(message[-_WRENCH_BYTES:]), np.repeat((force, torque), 3)
    if not np.isfinite(values).all():
        return message
    # Not by one factor: what is small beside an extreme would be nothing.
    return message[:-_WRENCH_BYTES] + np.clip(values, -most, most).tobytes()
