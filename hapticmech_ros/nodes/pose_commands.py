# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""CRTK's servo_cp, hold and free: a device that is commanded to a pose."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pinocchio as pin
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Empty

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.inputs import NEVER
from hapticmech_ros.nodes.messages import check_in_world, checked_stamp, read_framed_pose
from hapticmech_ros.nodes.qos import STREAM_PUBLISHER
from hapticmech_ros.nodes.sources import Sources
from hapticmech_ros.quaternions import quaternion_of
from hapticmech_ros.wire.stamped import encode_pose
from hapticmech_ros.wire.topics import (
    DEVICE_FREE,
    DEVICE_HOLD,
    DEVICE_POSE_COMMAND,
    DEVICE_POSE_SETPOINT,
)

SERVO, HOLD = "servo_cp", "hold"
ONE_KIND = "one kind of command at a time"


class PoseCommands:
    """The pose to which a device is commanded, if it is to one.

    A ``servo_cp`` stands for the device's timeout of commands, a ``hold`` until another command.
    Wrenches and poses exclude each other: whatever is obeyed keeps the other kind out, apart from
    a ``hold``, which a wrench ends.

    Args:
        actor: the device's.
        pose: returns where it is.
        wrenches: returns whether ``servo_cf`` is obeyed at a time, ns.
        refusal: returns why nothing may be obeyed at a time, ns; empty if it may.
        ended: called when no pose is commanded any more, with the reason; empty if that was wanted.

    Attributes:
        sources: who commands poses.
        timeout_ns: how long a ``servo_cp`` stands, ns.
    """

    def __init__(
        self,
        actor: Actor[Any],
        pose: Callable[[], pin.SE3],
        wrenches: Callable[[int], bool],
        refusal: Callable[[int], str],
        ended: Callable[[str], None],
    ) -> None:
        self._actor, self._pose, self._ended = actor, pose, ended
        self._wrenches, self._refusal = wrenches, refusal
        self.timeout_ns = 0
        self.sources: Sources = actor.sources(DEVICE_POSE_COMMAND.name)
        self._goal: pin.SE3 | None = None
        self._kind = ""
        self._received_ns = NEVER
        self._setpoint = actor.view(DEVICE_POSE_SETPOINT, PoseStamped)
        qos, name = actor.control_input, DEVICE_POSE_COMMAND.name
        actor.input_stream(name, PoseStamped, qos, self._on_servo, self.sources)
        actor.input(DEVICE_HOLD.name, Empty, STREAM_PUBLISHER, self._on_hold)
        actor.input(DEVICE_FREE.name, Empty, STREAM_PUBLISHER, self._on_free)

    @property
    def kind(self) -> str:
        """``servo_cp`` or ``hold``, whichever acts; empty if neither does."""
        return self._kind

    def goal(self, now_ns: int) -> pin.SE3 | None:
        """Return the pose that is commanded at a time (ns), or None."""
        if self._kind == SERVO and now_ns - self._received_ns > self.timeout_ns:
            self.end(f"{SERVO} is lost")
        return self._goal

    def end(self, reason: str = "") -> None:
        """Command no pose any more."""
        if self._goal is not None:
            self.forget()
            self._ended(reason)

    def forget(self) -> None:
        """Command no pose any more, without telling the device."""
        self._goal, self._kind = None, ""

    def give_way(self, now_ns: int) -> None:
        """Let a ``servo_cf`` that has come be obeyed.

        Raises:
            InvalidInputError: ``servo_cp`` is obeyed.
        """
        if self.goal(now_ns) is None:
            return
        if self._kind == SERVO:
            raise InvalidInputError("servo_cf", f"while {SERVO} is obeyed", ONE_KIND)
        self.end()

    def publish(self, stamp_ns: int) -> None:
        """Publish where the device is commanded to, if it is."""
        if self._goal is not None and self._setpoint.wanted:
            place = self._goal.translation.tolist(), quaternion_of(self._goal.rotation).tolist()
            self._setpoint.publish(encode_pose((*place[0], *place[1]), stamp_ns))

    def _on_servo(self, message: PoseStamped, now_ns: int) -> None:
        self._check_kind(SERVO, now_ns)
        self._check_allowed(SERVO, now_ns)
        check_in_world(message.header.frame_id)
        checked_stamp(message.header, now_ns, self._actor.age_limit_ns, unstamped_is_now=True)
        self._goal, self._kind = read_framed_pose(message, self._actor.limits), SERVO
        self._received_ns = now_ns

    def _on_hold(self, message: Empty, now_ns: int) -> None:
        del message
        self._check_kind(HOLD, now_ns)
        self._check_allowed(HOLD, now_ns)
        if self._kind != HOLD:
            self._goal, self._kind = self._pose(), HOLD

    def _on_free(self, message: Empty, now_ns: int) -> None:
        del message
        self._check_kind("free", now_ns)
        self.end()

    def _check_kind(self, word: str, now_ns: int) -> None:
        if self._actor.lockstep:
            rule = "cannot be told in lockstep, whose runs repeat"
            raise InvalidInputError(word, "a command", rule)
        if self._wrenches(now_ns):
            raise InvalidInputError(word, "while servo_cf is obeyed", ONE_KIND)

    def _check_allowed(self, word: str, now_ns: int) -> None:
        reason = self._refusal(now_ns)
        if reason:
            raise InvalidInputError(word, "a command", f"cannot be obeyed: {reason}")
