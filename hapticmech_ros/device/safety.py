# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The safety envelope limits a device's command before its actuators get it.

A command within all limits passes unchanged, to the bit. Else, in this order: the outward part of
the force is taken away near the end of the workspace; force and torque are shortened to their
limits, which open over a ramp after each start; and neither changes faster than its slew rate. A
command that is not finite, and a stop, are zero at once. Passivity control comes after that: it
takes energy away at once, within the same limits of workspace, force and torque.

The impedance between a device and a commanded pose, and its limits, are here too.

It also checks whether a device's samples can be the motion of something that a hand holds.

A driver whose first samples are not yet the device's, one that restarts with another origin, an
encoder that wraps or stands still, millimetres for metres: each causes a force that the mechanism
does not. Each sample is compared with the one before it and with the limits of the scene's
``device.motion``; poses and twists are compared over two windows of time.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
import pinocchio as pin

from hapticmech_ros.device.motion_kernels import (
    ACCELERATION,
    AWAY,
    ROTATION,
    SOUND,
    SPEED,
    Motion,
    follow_sample,
)
from hapticmech_ros.device.safety_kernels import Reason, Safety
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.scene.device import Device, most_servo_stiffness

# After a fault samples count again once they have been sound for so long, ns.
SOUND_AFTER_NS = NANOSECONDS // 10
# Windows of time for jumps within some samples, and for slow drift, s; and the error allowed at
# rest within the longer one, m and rad.
WINDOWS_S = 0.01, 2.0
SLOW_SLACK = 0.002, 0.02
# An encoder's steps in a difference of two poses; and rounding, m and rad.
_STEPS, _ROUNDING = 2.0, 1e-6
# How many times its radius a workspace is wide at most, from wherever the first sample was.
_ACROSS = 3.0


class MotionCheck:
    """Checks the samples of one device.

    Args:
        device: of the scene: its ``motion``, resolutions, and the radius of its workspace.
        period: s, of a sample; some may be closer together.

    Attributes:
        numbers: limits and the check's state.
        stamp_ns: of the last sample.
        fault: description with numbers; empty if nothing is wrong, and has not been lately.
        faults: samples so far that began a fault.
    """

    def __init__(self, device: Device, period: float) -> None:
        motion = device.motion
        self.numbers = Motion()
        steps = (
            _STEPS * device.position_resolution + _ROUNDING,
            _STEPS * device.angle_resolution + _ROUNDING,
        )
        self.numbers.fill(
            window=WINDOWS_S,
            most_speed=(motion.speed, motion.angular_speed),
            most_acceleration=(motion.acceleration, motion.angular_acceleration),
            slack=np.concatenate((steps, np.add(steps, SLOW_SLACK))),
            reach=_ACROSS * device.workspace.radius or math.inf,
            period=period,
        )
        self.fault = ""
        self.faults = 0
        self.stamp_ns = self._fault_ns = 0

    def restart(self) -> None:
        """Let the next sample be the first one."""
        self.numbers.started = 0.0
        self.fault = ""

    def check(self, sample: Array, stamp_ns: int) -> None:
        """Check a sample; a fault ends once all samples of 0.1 s were sound.

        Args:
            sample: (19,) of the device, see ``layout.DeviceSample``.
            stamp_ns: its time, ns, by the device's clock.
        """
        elapsed = (stamp_ns - self.stamp_ns) / NANOSECONDS
        self.stamp_ns = stamp_ns
        code = follow_sample(self.numbers, DeviceSample(sample), elapsed)
        if code == SOUND:
            if self.fault and stamp_ns - self._fault_ns > SOUND_AFTER_NS:
                self.fault = ""
            return
        self._fault_ns = stamp_ns
        if not self.fault:
            self.faults += 1
            self.fault = self._sentence(code, elapsed)

    def _sentence(self, code: int, elapsed: float) -> str:
        """Return the fault's description."""
        turns, kind = code >= ROTATION, code % ROTATION
        found, most = self.numbers.found, self.numbers.most
        unit, key = ("rad", "angular_") if turns else ("m", "")
        units = "" if turns else "; are these millimetres?"
        if kind == SPEED:
            limit = f"device.motion.{key}speed is {most:g}"
            return f"the device's twist is {found:.3g} {unit}/s, {limit}{units}"
        if kind == ACCELERATION:
            limit = f"device.motion.{key}acceleration is {most:.3g}"
            apart = f"within {1e3 * elapsed:.3g} ms: {found:.3g} {unit}/s², {limit}"
            return f"the device's twist jumps {apart}"
        if kind == AWAY:
            reach = f"{_ACROSS:g} times device.workspace.radius is {most:.3g} m"
            return f"the device is {found:.3g} m from where it was first, {reach}{units}"
        what, scale = ("turned", "mrad") if turns else ("moved", "mm")
        return (
            f"the device has {what} by {1e3 * found:.3g} {scale} more or less than its twist "
            f"implies (to {1e3 * most:.2g} {scale} may be lag or noise): a pose that jumps or "
            "stands still, or a twist that is not the pose's rate"
        )


__all__ = ["Reason", "SafetyEnvelope", "SafetyLimits", "safety_limits"]


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Limits of a device's wrench.

    Attributes:
        force: N.
        torque: N m.
        force_slew: N/s.
        torque_slew: N m/s.
        ramp: s, over which force and torque limit open after a start.
        radius: m, of the workspace about where the device started; infinite for none.
    """

    force: float
    torque: float
    force_slew: float = math.inf
    torque_slew: float = math.inf
    ramp: float = 0.0
    radius: float = math.inf


def safety_limits(device: Device) -> SafetyLimits:
    """Return the limits of a scene's device."""
    safety = device.safety
    return SafetyLimits(
        force=device.force_limit,
        torque=device.torque_limit,
        force_slew=safety.force_slew,
        torque_slew=safety.torque_slew,
        ramp=safety.start_ramp,
        radius=safety.workspace_radius or math.inf,
    )


class SafetyEnvelope:
    """Applies :class:`SafetyLimits` sample by sample.

    Args:
        period: s, of a sample.
        limits: to keep; :meth:`limit` sets others.

    Attributes:
        numbers: its limits and state.
    """

    def __init__(self, period: float, limits: SafetyLimits) -> None:
        self.numbers = Safety()
        self.numbers.period = period
        self.limit(limits)

    @property
    def counts(self) -> dict[Reason, int]:
        """Samples in which each reason changed the command."""
        return {reason: int(getattr(self.numbers, reason.counted_as)) for reason in Reason}

    def limit(self, limits: SafetyLimits) -> None:
        """Keep these limits from now on."""
        self.numbers.fill(**asdict(limits))

    def place(self, centre: Array) -> None:
        """Put the workspace's centre (3,), m.

        Args:
            centre: (3,) m, world axes.
        """
        self.numbers.centre[:] = centre

    def stop(self) -> None:
        """Stop: the wrench is zero now, and the next command is a start."""
        self.numbers.last[:] = 0.0
        self.numbers.started = 0.0


# N/m and N m/rad: a finger's push of 1 N moves the device by 5 mm.
STIFFNESS, ANGULAR_STIFFNESS = 200.0, 0.1


class PositionServo:
    """Pulls a device to a pose, by a spring and damper in translation and one in rotation.

        F = K e - B ẋ,  e = (p_d - p, log(R_d Rᵀ)),  K = diag(k, k_r),  B = 2 ζ sqrt(K M)

    in the axes of the world at the point held, M the device's mass and inertia. It is passive: its
    energy is ½ eᵀ K e, which only a change of the commanded pose puts in.

    Args:
        device: of the scene, with ``servo``.
        period: of the device's samples, s.
        limits: that hold now; where they allow less stiffness than the scene's, it is less.
    """

    def __init__(self, device: Device, period: float, limits: SafetyLimits) -> None:
        servo = device.servo
        linear = min(
            servo.stiffness or STIFFNESS,
            most_servo_stiffness(device.mass, period, limits.force, limits.force_slew),
        )
        angular = min(
            servo.angular_stiffness or ANGULAR_STIFFNESS,
            most_servo_stiffness(device.inertia, period, limits.torque, limits.torque_slew),
        )
        stiffness = [linear] * 3 + [angular] * 3
        ratio = 2.0 * servo.damping_ratio
        self._stiffness = np.array(stiffness)
        pairs = zip(stiffness, device.inertias, strict=True)
        self._damping = np.array([ratio * math.sqrt(k * m) for k, m in pairs])

    def wrench(self, goal: pin.SE3, pose: pin.SE3, twist: Array) -> Array:
        """Return the wrench (6,) on the device, N and N m, world axes at the point held.

        Args:
            goal: the commanded pose, in the world.
            pose: of the device, in the world.
            twist: (6,) of the device, m/s and rad/s, world axes at the point held.
        """
        away = np.concatenate(
            (goal.translation - pose.translation, pin.log3(goal.rotation @ pose.rotation.T))
        )
        return np.asarray(self._stiffness * away - self._damping * twist)
