# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The way of a device's samples to the controller: their order, their age, and how long it is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.loop_delay import DelayFollower, admissible_round_trip, made_for
from hapticmech_ros.nodes.inputs import NEVER, InOrder, SampleAge
from hapticmech_ros.nodes.messages import check_age
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.wire.readings import DeviceReading


class DevicePath(InOrder):
    """What a controller knows of the way to its device.

    Where a network is declared, samples are answered when the analysis comes, which it does evenly:
    a bunch of samples is answered once, by its newest, and the mechanism is told every period. This
    is what a simulated connection does, too.

    Args:
        scene: whose connection and device.
        say: called when gains change to those for another delay.

    Attributes:
        round_trip: s, from the device's samples to their answers, as it says; 0: not known.
        paced: whether samples are answered when the analysis comes.
        obeyed: whether the device obeyed when it took its last sample; a driver that does not tell
            counts as if it did.
    """

    def __init__(self, scene: Scene, say: Callable[[str], object]) -> None:
        super().__init__()
        self.round_trip = 0.0
        self.obeyed = True
        self.paced = scene.connection.networked
        self._scene, self._say = scene, say
        self._follower = DelayFollower(scene.connection)
        self._said_for = scene.connection.designed
        self._age = SampleAge()
        self._sample: tuple[Array, int] | None = None
        self._turn_ns = NEVER

    def heard(self, reading: DeviceReading, now_ns: int, limit_ns: int) -> bool:
        """Return whether a sample is no older than those before it, and take what it tells.

        Raises:
            InvalidInputError: it is older than ``limit_ns``.
        """
        if not self.paced:
            check_age(reading.stamp_ns, now_ns, limit_ns)
        if not self.is_next(reading.stamp_ns, now_ns):
            return False
        if self.paced:
            self._age.check(reading.stamp_ns, limit_ns)
        self.round_trip, self.obeyed = reading.round_trip, reading.obeys
        return True

    def changed(self, time: float) -> bool:
        """Return whether gains are to be made for another delay from a time (s) on."""
        return self.round_trip > 0.0 and self._follower.follow(self.round_trip, time)

    @property
    def is_settled(self) -> bool:
        """Whether further samples that tell the same round trip change nothing."""
        return self.round_trip <= 0.0 or self._follower.is_settled(self.round_trip)

    def tune(
        self, control: ControlArchitecture, gains: Controller, soften: bool, time: float | None
    ) -> None:
        """Change gains to those for the present delay.

        Args:
            control: whose gains.
            gains: as parameters have them.
            soften: whether they are made for what is measured, beyond what is declared.
            time: s, of the gain ramp; None takes them at once.
        """
        if time is not None and self._follower.delay != self._said_for:
            self._said_for = self._follower.delay
            short = f"gains are set for a one-way delay of {1e3 * self._said_for:.0f} ms again"
            self._say(self.warning(gains, soften) or short)
        delay = self._follower.delay if soften else self._scene.connection.designed
        if delay != self._scene.connection.designed:
            period = self._scene.simulation.period
            gains = made_for(gains, self._scene.device, period, delay)
        if time is None:
            control.apply_gains(gains, delay)
        elif (gains, delay) != control.aim:
            control.tune(time, gains, delay)

    def warning(self, gains: Controller, soften: bool) -> str:
        """Return what is wrong with the way for gains (as parameters have them); empty if nothing.

        Args:
            gains: as parameters have them.
            soften: whether they are made for what is measured.
        """
        if not self._follower.exceeded(self.round_trip):
            return ""
        device, designed = self._scene.device, 2.0 * self._scene.connection.designed
        inertia = np.array([device.mass] * 3 + [device.inertia] * 3)
        admissible = admissible_round_trip(gains, inertia, self._scene.simulation.period)
        admissible = max(admissible, designed)
        if self.round_trip <= admissible:
            return ""
        done = "gains are not reduced (parameter soften)"
        if soften:
            done = f"gains are reduced to a one-way delay of {1e3 * self._follower.delay:.0f} ms"
        return (
            f"the round trip to the device takes {1e3 * self.round_trip:.0f} ms, declared are "
            f"{1e3 * designed:.0f} ms, and the gains allow {1e3 * admissible:.0f} ms: {done}; "
            "set network_delay to the one-way delay on all nodes"
        )

    def put(self, sample: Array, stamp_ns: int) -> None:
        """Keep a sample (19,) until the analysis comes.

        Args:
            sample: (19,) of the device, in SI units; see ``layout.DEVICE_SAMPLE``.
            stamp_ns: its stamp, ns.
        """
        self._sample = sample, stamp_ns

    def take(self) -> tuple[Array, int] | None:
        """Return the newest sample (19,) and what its answer is stamped with, ns.

        That is its own stamp the first time; answers that follow are later by a nanosecond each, as
        far as this leaves the microsecond.
        """
        found = self._sample
        if found is not None and (found[1] + 1) % 1000:
            self._sample = found[0], found[1] + 1
        return found

    def turn(self, now_ns: int) -> int:
        """Return how long (ns) it is since the analysis came last, and note that it comes now."""
        before, self._turn_ns = self._turn_ns, now_ns
        return now_ns - before

    def restart(self) -> None:
        """Wait for samples anew: what was heard before counts no more."""
        self.forget()
        self._sample, self._turn_ns, self.obeyed = None, NEVER, True

    def figures(self, gains: Controller, soften: bool, loop_warning: str) -> dict[str, str]:
        """Return what diagnostics say; arguments as of :meth:`warning`, and what the scene says."""
        return {
            "loop_warning": self.warning(gains, soften) or loop_warning,
            "round_trip_ms": f"{1e3 * self.round_trip:.1f}",
            "designed_delay_ms": f"{1e3 * self._scene.connection.designed:.1f}",
            "softened_for_ms": f"{1e3 * self._follower.delay if soften else 0.0:.1f}",
            "overtaken_samples": str(self.overtaken),
        }
