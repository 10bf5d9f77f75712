# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Topics of one operational point of the mechanism: what it is told, and what it tells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from sensor_msgs.msg import JointState

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.evaluation import PointKinematics
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.inputs import NEVER, ExpiringWrench, Stamped
from hapticmech_ros.nodes.ordering import InOrder
from hapticmech_ros.nodes.parameters import MechanismParameters
from hapticmech_ros.quaternions import quaternion_of
from hapticmech_ros.wire.bounds import pose_bounds, twist_bounds
from hapticmech_ros.wire.stamped import encode_pose, encode_twist
from hapticmech_ros.wire.topics import (
    EXTERNAL_WRENCH,
    POINT_COMMAND,
    POINT_FORCE,
    POINT_JOINTS,
    POINT_POSE,
    POINT_TWIST,
)
from hapticmech_ros.wire.wrench import encode_wrench


class PointPort:
    """One operational point's commands, and its CRTK topics.

    Args:
        actor: the mechanism's.
        name: of the operational point.
        go_on: called when something came that a tick in lockstep may have waited for.

    Attributes:
        name: as given.
        command: the controller's wrench, which runs out.
        order: of commands; what was overtaken is dropped.
        controllers: who commands.
        since_ns: commands that answer no later sample count as zero.
        commands, awaited: the same, and ``external_cf``, by stamp, in lockstep.
    """

    def __init__(
        self, actor: Actor[MechanismParameters], name: str, go_on: Callable[[int], None]
    ) -> None:
        self.name = name
        self._actor = actor
        self._go_on = go_on
        self.since_ns = NEVER
        self._pose_bounds = pose_bounds(actor.limits)
        self._twist_bounds = twist_bounds(actor.limits)
        self.order = InOrder()
        self.command = ExpiringWrench(0, 0)
        self.commands: Stamped[Array] = Stamped()
        self.awaited: Stamped[Array] = Stamped()
        self._publish_pose = actor.view(POINT_POSE, PoseStamped, name)
        self._publish_twist = actor.view(POINT_TWIST, TwistStamped, name)
        self._publish_force = actor.view(POINT_FORCE, WrenchStamped, name)
        self._publish_joints = actor.view(POINT_JOINTS, JointState, name)
        qos, commands = actor.control_input, POINT_COMMAND.of(name)
        self.controllers = actor.sources(commands)
        actor.input_command(commands, qos, self._on_command, sources=self.controllers)
        if actor.parameters.require_external_wrench:
            topic = EXTERNAL_WRENCH.of(name)
            actor.input_command(topic, qos, self._on_awaited, unstamped_is_now=False)

    def set_timeout(self, timeout_ns: int) -> None:
        """Set how long a command stands, and how long it then takes to reach zero."""
        self.command.timeout_ns = self.command.ramp_ns = timeout_ns

    def heard(self, now_ns: int) -> bool:
        """Return whether one controller commands, and its commands are heard."""
        return self.command.heard(now_ns) and not self.fault(now_ns)

    def fault(self, now_ns: int) -> str:
        """Return which two command where one may; empty if none do."""
        return self.controllers.fault(now_ns)

    def forget(self) -> None:
        """Forget what was commanded, and by whom."""
        self.command.clear()
        self.order.forget()
        self.controllers.forget()

    def let_go(self, now_ns: int) -> None:
        """Hold the mechanism no more where it was: what answers earlier samples is heard as zero.

        Args:
            now_ns: the time of the mechanism's last sample.
        """
        self.since_ns = now_ns
        self.command.clear()
        self.command.put(np.zeros(6), now_ns)

    @property
    def wants_joints(self) -> bool:
        """Whether anybody reads the point's own copy of the joint states."""
        return self._publish_joints.wanted

    def check(self, point: PointKinematics) -> None:
        """Hold the point's pose and twist to the scene's limits.

        Raises:
            OutputError: one is beyond them.
        """
        self._pose_bounds.check_output((*point.pose.translation.tolist(), 0.0, 0.0, 0.0))
        self._twist_bounds.check_output(point.twist.tolist())

    def publish(self, point: PointKinematics, force: Array, joints: bytes, time_ns: int) -> None:
        """Publish what people and CRTK clients read.

        Args:
            point: its kinematics.
            force: (6,) F_c, N and N m, world axes at the operational point.
            joints: joint states, serialized; empty if nobody reads them.
            time_ns: their stamp, ns.
        """
        if self._publish_force.wanted:
            self._publish_force.publish(encode_wrench(force, time_ns))
        if self._publish_twist.wanted:
            self._publish_twist.publish(encode_twist(point.twist.tolist(), time_ns))
        if self.wants_joints and joints:
            self._publish_joints.publish(joints)
        if self._publish_pose.wanted:
            pose = point.pose
            place = *pose.translation.tolist(), *quaternion_of(pose.rotation).tolist()
            self._publish_pose.publish(encode_pose(place, time_ns))

    def _on_command(self, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        self._actor.ages.add(now_ns - stamp_ns)
        if self.fault(now_ns):
            self.command.clear()
        elif self._actor.lockstep or self.order.is_next(stamp_ns, now_ns):
            self.command.put(wrench if stamp_ns > self.since_ns else np.zeros(6), now_ns)
        if self._actor.lockstep:
            self.commands.put(wrench, stamp_ns)
            self._go_on(now_ns)

    def _on_awaited(self, wrench: Array, stamp_ns: int, now_ns: int) -> None:
        self.awaited.put(wrench, stamp_ns)
        self._go_on(now_ns)
