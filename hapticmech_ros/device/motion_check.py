# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the samples of a device can be the motion of something that a hand holds.

A driver whose first samples are not yet the device's, one that restarts with another origin, an
encoder that wraps or stands still, millimetres for metres: each makes a force that the mechanism
has no part in. Each sample is held against the one before it and against what the scene's
``device.motion`` allows; poses and twists are compared over two windows of time.
"""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.device.motion_kernels import (
    ACCELERATION,
    AWAY,
    FOUND,
    MOST,
    MOTION,
    ROTATION,
    SOUND,
    SPEED,
    check_sample,
)
from hapticmech_ros.scene.device import Device
from hapticmech_ros.times import NANOSECONDS

# After a fault samples count again once they have been sound for so long, ns.
SOUND_AFTER_NS = NANOSECONDS // 10
# Windows of time: what happens within some samples, and what adds up slowly, s; and how much may be
# wrong at rest within the longer one, m and rad.
WINDOWS_S = 0.01, 2.0
SLOW_SLACK = 0.002, 0.02
# An encoder's steps in a difference of two poses; and rounding, m and rad.
_STEPS, _ROUNDING = 2.0, 1e-6
# How many times its radius a workspace is wide at most, from wherever the first sample was.
_ACROSS = 3.0
_MOTION_STARTED = MOTION.start("started")


class MotionCheck:
    """Checks the samples of one device.

    Args:
        device: of the scene: its ``motion``, resolutions, and the radius of its workspace.
        period: s, of a sample; some may be closer together.

    Attributes:
        numbers: (numbers,) limits and what is known, see ``motion_kernels.MOTION``.
        stamp_ns: of the last sample.
        fault: what is wrong, in words with numbers; empty if nothing is, and has not been lately.
        faults: samples so far that began a fault.
    """

    def __init__(self, device: Device, period: float) -> None:
        motion = device.motion
        self.numbers = np.zeros(MOTION.size)
        steps = (
            _STEPS * device.position_resolution + _ROUNDING,
            _STEPS * device.angle_resolution + _ROUNDING,
        )
        self.numbers[MOTION.slice("window", "period")] = (
            *WINDOWS_S,
            *(motion.speed, motion.angular_speed),
            *(motion.acceleration, motion.angular_acceleration),
            *steps,
            *(step + slack for step, slack in zip(steps, SLOW_SLACK, strict=True)),
            _ACROSS * device.workspace.radius or math.inf,
            period,
        )
        self._radius = device.workspace.radius
        self.fault = ""
        self.faults = 0
        self.stamp_ns = self._fault_ns = 0

    def restart(self) -> None:
        """Let the next sample be the first one."""
        self.numbers[_MOTION_STARTED] = 0.0
        self.fault = ""

    def look(self, sample: Array, stamp_ns: int) -> None:
        """Look at a sample; a fault ends once all samples of 0.1 s were sound.

        Args:
            sample: (19,) of the device, see ``layout.DEVICE_SAMPLE``.
            stamp_ns: its time, ns, by the device's clock.
        """
        elapsed = (stamp_ns - self.stamp_ns) / NANOSECONDS
        self.stamp_ns = stamp_ns
        code = check_sample(self.numbers, sample, elapsed)
        if code == SOUND:
            if self.fault and stamp_ns - self._fault_ns > SOUND_AFTER_NS:
                self.fault = ""
            return
        self._fault_ns = stamp_ns
        if not self.fault:
            self.faults += 1
            self.fault = self._said(code, elapsed)

    def _said(self, code: int, elapsed: float) -> str:
        """Return what is wrong, in words."""
        turns, kind = code >= ROTATION, code % ROTATION
        found, most = self.numbers[FOUND], self.numbers[MOST]
        unit, key = ("rad", "angular_") if turns else ("m", "")
        units = "" if turns else "; are these millimetres?"
        if kind == SPEED:
            limit = f"device.motion.{key}speed is {most:g}"
            return f"the device's twist says {found:.3g} {unit}/s, {limit}{units}"
        if kind == ACCELERATION:
            limit = f"device.motion.{key}acceleration is {most:.3g}"
            apart = f"within {1e3 * elapsed:.3g} ms: {found:.3g} {unit}/s², {limit}"
            return f"the device's twist jumps {apart}"
        if kind == AWAY:
            reach = f"{_ACROSS:g} times device.workspace.radius is {most:.3g} m"
            return f"the device is {found:.3g} m from where it was first, {reach}{units}"
        what, scale = ("turned", "mrad") if turns else ("moved", "mm")
        return (
            f"the device has {what} by {1e3 * found:.3g} {scale} more or less than its twist says "
            f"(to {1e3 * most:.2g} {scale} may be lag or noise): a pose that jumps or stands "
            "still, or a twist that is not the pose's rate"
        )
