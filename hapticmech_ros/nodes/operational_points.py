# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where users hold the mechanism while it runs: told by topic or parameter, announced to all."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pinocchio as pin
from geometry_msgs.msg import PoseStamped

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.mechanism.grasp import flat_grasp, flat_grasps, grasp_posed
from hapticmech_ros.mechanism.model import se3
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.exchange import Outlet
from hapticmech_ros.nodes.messages import WORLD, read_framed_pose, write_pose
from hapticmech_ros.nodes.parameters import MechanismParameters
from hapticmech_ros.nodes.qos import COMMAND_SUBSCRIBER, LATCHED
from hapticmech_ros.scene.mechanism import OperationalPoint
from hapticmech_ros.wire.topics import OPERATIONAL_POINT, SET_OPERATIONAL_POINT


class OperationalPoints:
    """Moves operational points, and announces where they are.

    Subscribes to ``mechanism/<point>/set_operational_point`` and publishes
    ``mechanism/<point>/operational_point``.

    Args:
        actor: the mechanism's.
        mechanism: whose operational points they are.
        configuration: returns the present q (nq,).
        take: puts a point elsewhere, between two ticks; may refuse with InvalidInputError.

    Attributes:
        numbers: (points, 7) where every point is.
    """

    def __init__(
        self,
        actor: Actor[MechanismParameters],
        mechanism: Mechanism,
        configuration: Callable[[], Array],
        take: Callable[[OperationalPoint], None],
    ) -> None:
        self._actor = actor
        self._mechanism = mechanism
        self._configuration = configuration
        self._take = take
        self.numbers: Array = flat_grasps(mechanism.scene)
        self._outlets: list[Outlet] = []
        for name in mechanism.point_names:
            self._outlets.append(actor.output(OPERATIONAL_POINT, PoseStamped, LATCHED, point=name))
            accept = partial(self._on_grasp, name)
            actor.input(SET_OPERATIONAL_POINT.of(name), PoseStamped, COMMAND_SUBSCRIBER, accept)

    def announce(self) -> None:
        """Tell where every operational point is."""
        for point in self._mechanism.scene.operational_points:
            self._announce(point)

    def moved(self, point: OperationalPoint) -> None:
        """Tell everyone that an operational point is elsewhere."""
        self.numbers = self.numbers.copy()
        self.numbers[self._mechanism.point_index(point.name)] = flat_grasp(
            self._mechanism.scene, point
        )
        self._announce(point)

    def _on_grasp(self, name: str, message: PoseStamped, now_ns: int) -> None:
        del now_ns
        frame, pose = message.header.frame_id, read_framed_pose(message, self._actor.limits)
        scene = self._mechanism.scene
        if frame == WORLD:
            frame = scene.operational_point(name).link
            held = self._mechanism.frame_pose(self._configuration(), frame)
            pose = held.actInv(pose)
        if not frame:
            rule = f"must be a link, an operational point, or '{WORLD}'"
            raise InvalidInputError("frame_id", frame, rule)
        self._take(grasp_posed(scene, name, frame, pose))

    def _announce(self, point: OperationalPoint) -> None:
        message = PoseStamped()
        pose: pin.SE3 = se3(point.origin)
        write_pose(message, pose, self._actor.now_ns())
        message.header.frame_id = point.link
        self._outlets[self._mechanism.point_index(point.name)].publish(message)
