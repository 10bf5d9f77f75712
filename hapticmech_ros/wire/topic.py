# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a topic is: name, type, rate, direction of the wrench, and which QoS it has.

Names are relative, so that namespaces and remapping work; ``{point}`` stands for the name of an
operational point of the scene.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

# Stands for CRTK's own message types where they are not installed.
TEXT = "std_msgs/msg/String"
Rate = Literal[
    "control", "body", "view", "shared", "contact", "servo", "marker", "change", "1 Hz", "caller's"
]
Qos = Literal["stream", "latched", "command"]


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic.

    Attributes:
        name: relative name, with ``{point}`` where an operational point's name goes.
        type: ROS message type.
        publisher: node that publishes it, or ``any``.
        subscribers: nodes that subscribe.
        rate: ``control`` is the scene's control rate, ``view`` is for people and slower,
            ``shared`` the same in scenes with several operational points, ``contact`` in those
            with contacts, ``servo`` the same while a device is
            commanded to a pose, ``marker`` the scene viewer's; ``body`` is the control rate with
            ``device.servo_axes: body``.
        qos: name of the profile in nodes/qos.py.
        meaning: what it carries; for wrenches by whom, on whom, at which point, in which axes.
    """

    name: str
    type: str
    publisher: str
    meaning: str
    subscribers: tuple[str, ...] = ()
    rate: Rate = "view"
    qos: Qos = "stream"

    def names(self, absolute: str) -> bool:
        """Return whether an absolute name is this topic's, in any namespace, of any point."""
        own, given = self.name.strip("/").split("/"), absolute.strip("/").split("/")
        pairs = zip(reversed(own), reversed(given), strict=False)
        return len(given) >= len(own) and all(a in (b, "{point}") for a, b in pairs)

    def of(self, point: str, namespace: str = "") -> str:
        """Return the relative name for an operational point.

        Args:
            point: name of the operational point.
            namespace: of its user, see :func:`users_of`: all that is not the mechanism's is in it.
        """
        name = self.name.format(point=point)
        own = namespace and not name.startswith(("mechanism/", "/"))
        return f"{namespace}/{name}" if own else name


def users_of(points: Sequence[str]) -> list[tuple[str, str]]:
    """Return namespace and operational point of each user of one mechanism.

    Device, analyser and controller of one of several users are in a namespace of the point's name;
    one alone has none.

    Args:
        points: names of the operational points that are held.
    """
    return [(point if len(points) > 1 else "", point) for point in points]


POSE, TWIST, WRENCH = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/WrenchStamped",
)
ARRAY = "std_msgs/msg/Float64MultiArray"
DEVICE, MECHANISM = "haptic_device", "mechanism_simulator"
ANALYSER, CONTROLLER = "nullspace_analyser", "teleoperation_controller"
VIEWER, PAGE = "scene_viewer", "live_page"
# A robot that follows the mechanism, and one in MuJoCo in place of a real one.
FOLLOWER, ROBOT = "robot_follower", "simulated_robot"
# Drive devices that are not simulated, by the same topics as DEVICE.
HAPLY, RELAY = "haply_device", "relay_device"
REAL_DEVICES = (HAPLY, RELAY)


def user_prefixes(points: Sequence[str]) -> dict[str, str]:
    """Return what is before the names of a user's topics, nodes and frames, by the point held.

    Of several users each has its point's name as a namespace, in that of the mechanism; one user
    has that of the mechanism.
    """
    return {point: f"{point}/" if len(points) > 1 else "" for point in points}


def crtk_type(name: str) -> str:
    """Return the full name of one of CRTK's message types, or of what stands for it here."""
    return TEXT if importlib.util.find_spec("crtk_msgs") is None else f"crtk_msgs/msg/{name}"
