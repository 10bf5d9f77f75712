# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of any driver of a haptic device by its topics, while nothing else commands it.

A person holds the device, or a simulated arm: a force acts on it for half a second.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Joy
from std_srvs.srv import SetBool

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.nodes.messages import LATCHED, WORLD, set_stamp, seven_of, stamp_ns, three_of
from hapticmech_ros.nodes.sources import Info, WithInfo
from hapticmech_ros.nodes.timeouts import ZERO_FORCE
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.scene.device import Motion
from hapticmech_ros.wire.topics import (
    DEVICE_BUTTONS,
    DEVICE_COMMAND,
    DEVICE_FORCE,
    DEVICE_POSE,
    DEVICE_TWIST,
    EMERGENCY_STOP,
)

# s: until the first pose or a force, of each look, of a command, how long before a force ends it
# was given, between commands, and how old a stamp may be.
_PATIENCE, _LOOK, _PUSH, _BEFORE, _EVERY, _OLD = 10.0, 1.0, 0.5, 0.1, 0.002, 0.25
# Lowest rate of poses, Hz, largest force that counts as none (N), and relative and absolute
# tolerances: of forces (N), and of velocities (m/s).
_SLOWEST, _NONE, _SHARE, _SLACK, _CRAWL = 50.0, 0.02, 0.1, 0.05, 0.003
# How far, m, and how fast, m/s, a hand moves a device.
_FARTHEST, _FASTEST = 2.0, Motion().speed
_QOS = QoSProfile(depth=200)
_Received = list[tuple[float, Any]]


@dataclass(frozen=True, slots=True)
class Check:
    """One rule, and its result.

    Attributes:
        rule: in words.
        found: in words.
        kept: whether the rule is kept; None: it could not be checked.
    """

    rule: str
    found: str
    kept: bool | None


class DriverTest:
    """Tests one driver.

    Args:
        namespace: of its topics, ``device/...`` below it.
        force: N, that is commanded along x of the world.
        rate: Hz, its control rate, by which a force has to end.
    """

    def __init__(self, namespace: str = "", force: float = 0.5, rate: float = 1000.0) -> None:
        self._force, self._zero = force, ZERO_FORCE.at(1.0 / rate)
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = Node("driver_test", context=self._context, namespace=namespace)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        # Messages with the times at which the middleware got them, s by the monotonic clock.
        self._poses = self._listen(DEVICE_POSE.name, PoseStamped)
        self._twists = self._listen(DEVICE_TWIST.name, TwistStamped)
        self._forces = self._listen(DEVICE_FORCE.name, WrenchStamped)
        self._buttons = self._listen(DEVICE_BUTTONS.name, Joy, LATCHED)
        self._commands = self._node.create_publisher(WrenchStamped, DEVICE_COMMAND.name, _QOS)
        self._stop = self._node.create_client(SetBool, EMERGENCY_STOP)

    def run(self) -> Iterator[Check]:
        """Yield each check as it is done.

        Raises:
            HapticMechError: there is no driver, or another node commands it.
        """
        self._wait_for_driver()
        start = time.monotonic()
        self._spin(_LOOK)
        yield from self._check_poses(start)
        yield self._check_twists(start)
        yield self._check_motion(start)
        yield self._check_buttons()
        yield self._check_no_force("no force without a command", start)
        yield self._check_obedience()
        yield self._check_end()
        yield self._check_refused("a command that is not a number is not obeyed", np.nan, 0.0)
        yield self._check_refused("a command of 10 s ago is not obeyed", self._force, 10.0)
        yield self._check_stop()

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _listen(self, name: str, kind: Any, qos: QoSProfile = _QOS) -> _Received:
        received: _Received = []

        def keep(message: Any, info: Info) -> None:
            now = time.time_ns()
            waited = now - (int(info["received_timestamp"]) or now)
            received.append((time.monotonic() - waited / NANOSECONDS, message))

        self._node.create_subscription(kind, name, WithInfo(keep), qos)
        return received

    def _wait_for_driver(self) -> None:
        end = time.monotonic() + _PATIENCE
        name = self._node.resolve_topic_name(DEVICE_COMMAND.name)
        while not self._poses or not self._commands.get_subscription_count():
            if time.monotonic() > end:
                what = "subscribes to it" if self._poses else "publishes measured_cp beside it"
                raise HapticMechError(f"{name}: no node {what}")
            self._spin(0.05)
        if self._node.count_publishers(name) > 1:
            raise HapticMechError(f"{name}: another node commands the device: end the controller")

    def _spin(self, seconds: float, each: Callable[[], None] | None = None) -> None:
        """Handle messages for a while, and do something every now and then."""
        end, again = time.monotonic() + seconds, 0.0
        while (now := time.monotonic()) < end:
            if each is not None and now >= again:
                each()
                again = now + _EVERY
            self._executor.spin_once(timeout_sec=min(_EVERY, max(end - now, 0.0)))

    def _command(self, force: float, age: float = 0.0) -> None:
        """Command a force along x, stamped so many s ago."""
        message = WrenchStamped()
        message.header.frame_id = WORLD
        now = self._node.get_clock().now().nanoseconds
        set_stamp(message.header.stamp, now - round(age * NANOSECONDS))
        message.wrench.force.x = force
        self._commands.publish(message)

    def _check_poses(self, start: float) -> Iterator[Check]:
        received = _since(self._poses, start)
        poses = [message for _, message in received]
        rate = len(poses) / _LOOK
        yield Check(f"measured_cp at {_SLOWEST:g} Hz or more", f"{rate:.0f} Hz", rate >= _SLOWEST)
        numbers = np.array([seven_of(message.pose) for message in poses]).reshape(-1, 7)
        away = np.abs(np.linalg.norm(numbers[:, 3:], axis=1) - 1.0)
        norm = float(away.max()) if len(poses) else np.nan
        sound = bool(np.isfinite(numbers).all()) and norm < 1e-3
        yield Check("poses are finite, quaternions of norm 1", f"norm within {norm:.1e}", sound)
        frames = {message.header.frame_id for message in poses}
        yield Check(f"frame_id is {WORLD}", ", ".join(sorted(frames)) or "none", frames == {WORLD})
        stamps = np.array([stamp_ns(message.header) for message in poses])
        rising = bool((np.diff(stamps) > 0).all()) and len(stamps) > 1
        yield Check("stamps rise", "yes" if rising else "no", rising)
        came = np.array([at for at, _ in received]) + time.time() - time.monotonic()
        age = float(np.median(came - stamps / NANOSECONDS)) if len(received) else np.inf
        rule = f"stamps are within {_OLD:g} s of this machine's clock as they come"
        yield Check(rule, f"{age:.3f} s old", abs(age) < _OLD)

    def _check_twists(self, start: float) -> Check:
        rule = "measured_cv is the rate of measured_cp"
        twists = [three_of(message.twist.linear) for _, message in _since(self._twists, start)]
        poses = [(stamp_ns(m.header), seven_of(m.pose)[:3]) for _, m in _since(self._poses, start)]
        if not twists or len(poses) < 2:
            return Check(rule, "there is no measured_cv: it is made from the poses", None)
        velocity = np.mean(twists, axis=0)
        (first, place), (last, end) = poses[0], poses[-1]
        moved = (np.array(end) - place) / max((last - first) / NANOSECONDS, 1e-9)
        speed, off = float(np.linalg.norm(moved)), float(np.linalg.norm(velocity - moved))
        if not np.isfinite(off):
            return Check(rule, "it is not finite", False)
        if max(speed, float(np.linalg.norm(velocity))) < _CRAWL:
            return Check(rule, "it did not move: move it during the first second", None)
        found = f"{off:.4f} m/s off at {speed:.4f} m/s"
        return Check(rule, found, off < _CRAWL + _SHARE * speed)

    def _check_motion(self, start: float) -> Check:
        """Check positions and speeds against a hand's, to detect other units."""
        rule = f"it moves within {_FARTHEST:g} m, at {_FASTEST:g} m/s at most"
        poses = np.array([seven_of(m.pose)[:3] for _, m in _since(self._poses, start)]).reshape(
            -1, 3
        )
        twists = [three_of(message.twist.linear) for _, message in _since(self._twists, start)]
        if not len(poses):
            return Check(rule, "there are no poses", None)
        moved = float(np.linalg.norm(poses - poses[0], axis=1).max())
        speed = float(np.linalg.norm(np.array(twists).reshape(-1, 3), axis=1).max(initial=0.0))
        kept = moved <= _FARTHEST and speed <= _FASTEST
        found = f"{moved:.3g} m, {speed:.3g} m/s"
        return Check(rule, found if kept else f"{found}: are these millimetres?", kept)

    def _check_buttons(self) -> Check:
        rule = "buttons are 0 or 1, and of one handle"
        if not self._buttons:
            return Check(rule, f"nothing on {DEVICE_BUTTONS.name}: no buttons", None)
        pressed = [list(message.buttons) for _, message in self._buttons]
        numbers = {len(buttons) for buttons in pressed}
        values = {one for buttons in pressed for one in buttons}
        kept = len(numbers) == 1 and values <= {0, 1} and 0 not in numbers
        counted = ", ".join(map(str, sorted(numbers)))
        return Check(rule, f"{counted} buttons, now {pressed[-1]}", kept)

    def _check_no_force(self, rule: str, start: float) -> Check:
        forces = self._forces_since(start)
        if not len(forces):
            return Check(rule, "there is no measured_cf", None)
        largest = float(np.linalg.norm(forces, axis=1).max())
        return Check(rule, f"{largest:.3f} N", largest < _NONE)

    def _check_obedience(self) -> Check:
        rule = f"servo_cf of {self._force:g} N along x is given"
        start = time.monotonic()
        self._spin(_PUSH, lambda: self._command(self._force))
        forces = self._forces_since(start + 0.6 * _PUSH)
        if not len(forces):
            return Check(rule, "there is no measured_cf", None)
        mean = forces.mean(axis=0)
        off = float(np.linalg.norm(mean - (self._force, 0.0, 0.0)))
        found = "({:.3f}, {:.3f}, {:.3f}) N".format(*mean)
        return Check(rule, found, off < _SLACK + _SHARE * self._force)

    def _check_end(self) -> Check:
        """Measure how long a force lasts when commands end."""
        self._push()
        end = time.monotonic()
        self._spin(_LOOK)
        return self._ended(f"no force {1e3 * self._zero:g} ms after the last command", end)

    def _push(self) -> None:
        """Command the force for a while, and until it is given: it may have been held just now."""
        patience = time.monotonic() + _PATIENCE
        self._spin(_PUSH, lambda: self._command(self._force))
        while not self._given_lately() and time.monotonic() < patience:
            self._spin(self._zero, lambda: self._command(self._force))

    def _given_lately(self) -> bool:
        """Return whether a recent enough force was received."""
        if not self._forces:
            return False
        at, message = self._forces[-1]
        return time.monotonic() - at < _BEFORE and _is_force(message)

    def _check_refused(self, rule: str, force: float, age: float) -> Check:
        start = time.monotonic()
        self._spin(_PUSH, lambda: self._command(force, age))
        return self._check_no_force(rule, start)

    def _check_stop(self) -> Check:
        rule = f"no force {1e3 * self._zero:g} ms after {EMERGENCY_STOP}"
        if not self._stop.wait_for_service(timeout_sec=1.0):
            return Check(rule, "there is no such service", None)
        self._push()
        end = time.monotonic()
        answer = self._stop.call_async(SetBool.Request(data=True))
        # Commands go on: it must not obey them.
        self._spin(_PUSH, lambda: self._command(self._force))
        found = self._ended(rule, end)
        self._stop.call_async(SetBool.Request(data=False))
        self._spin(0.1)
        return found if answer.done() else Check(rule, "the service did not answer", False)

    def _ended(self, rule: str, end: float) -> Check:
        """Check that a force until a time has ended soon after it, for good."""
        received = [(at, _is_force(m)) for at, m in self._forces]
        before = [at for at, given in received if given and at < end]
        if not before or end - before[-1] > _BEFORE:
            return Check(rule, "there was no force before", None)
        last = max((at for at, given in received if given and at >= end), default=end)
        after = [at for at, given in received if not given and at > last]
        if not after:
            return Check(rule, "it did not end", False)
        took = after[0] - end
        # Up to a message earlier than it was seen.
        spacing = float(np.median(np.diff([at for at, _ in received])))
        return Check(rule, f"{1e3 * took:.0f} ms, by arrival", took < self._zero + spacing)

    def _forces_since(self, start: float) -> Array:
        return np.array([_force(m) for _, m in _since(self._forces, start)]).reshape(-1, 3)


def _since(received: _Received, start: float) -> _Received:
    return [one for one in received if one[0] >= start]


def _force(message: WrenchStamped) -> Array:
    return np.array(three_of(message.wrench.force))


def _is_force(message: WrenchStamped) -> bool:
    return bool(np.linalg.norm(_force(message)) > _NONE)
