"""The way of a device's samples to the controller: their order, their age, and how long it is."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.control.loop_delay import DelayFollower, borne_round_trip, made_for
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.nodes.inputs import NEVER
from hapticmech_ros.nodes.ordering import InOrder
from hapticmech_ros.nodes.sample_age import SampleAge
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.document import Scene


class DevicePath(InOrder):
    """What a controller knows of the way to its device.

    Where a network is declared, samples are answered when the analysis comes, which it does evenly:
    a bunch of samples is answered once, by its newest, and the mechanism is told every period. This
    is what a simulated connection does, too.

    Args:
        scene: whose connection and device.

    Attributes:
        round_trip: s, from the device's samples to their answers, as it says; 0: not known.
        paced: whether samples are answered when the analysis comes.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__()
        self.round_trip = 0.0
        self.paced = scene.connection.networked
        self._scene = scene
        self._follower = DelayFollower(scene.connection)
        self._age = SampleAge(relative=self.paced)
        self._sample: tuple[Array, int] | None = None
        self._fresh = False
        self._turn_ns = NEVER

    def in_order(self, stamp_ns: int, now_ns: int, limit_ns: int) -> bool:
        """Return whether a sample is no older than those before it.

        Raises:
            InvalidInputError: it is older than ``limit_ns``.
        """
        if not self.is_next(stamp_ns, now_ns):
            return False
        self._age.check(stamp_ns, now_ns, limit_ns)
        return True

    def follow(self, round_trip: float, time: float) -> bool:
        """Take a round trip (s) that the device tells at a time (s); return whether to retune."""
        self.round_trip = round_trip
        return round_trip > 0.0 and self._follower.follow(round_trip, time)

    def made_for(self, gains: Controller, soften: bool) -> tuple[Controller, float]:
        """Return gains that bear the way as it is, and the one-way delay (s) that they are for."""
        designed = self._scene.connection.designed
        delay = self._follower.delay
        if not soften or delay == designed:
            return gains, designed
        period = self._scene.simulation.period
        return made_for(gains, self._scene.device, period, delay), delay

    def warning(self, gains: Controller, soften: bool) -> str:
        """Return what is wrong with the way for gains (as tuned); empty if nothing is."""
        if not self._follower.exceeded(self.round_trip):
            return ""
        device, designed = self._scene.device, self._scene.connection.designed
        inertia = np.array([device.mass] * 3 + [device.inertia] * 3)
        borne = borne_round_trip(gains, inertia, self._scene.simulation.period)
        if self.round_trip <= max(borne, 2.0 * designed):
            return ""
        what = f"softened for {1e3 * self._follower.delay:.0f} ms each way" if soften else "not"
        what = what if soften else "nothing is softened (parameter soften)"
        return (
            f"the way to the device and back takes {1e3 * self.round_trip:.0f} ms; gains are made "
            f"for {2e3 * designed:.0f} ms and bear {1e3 * max(borne, 2.0 * designed):.0f} ms: "
            f"{what}; declare it by network_delay"
        )

    def put(self, sample: Array, stamp_ns: int) -> None:
        """Keep a sample (19,) until the analysis comes."""
        self._sample, self._fresh = (sample, stamp_ns), True

    def take(self) -> tuple[Array, int, bool] | None:
        """Return the newest sample (19,), its stamp (ns) and whether it was not taken before."""
        if self._sample is None:
            return None
        fresh, self._fresh = self._fresh, False
        return (*self._sample, fresh)

    def turn(self, now_ns: int) -> int:
        """Return how long (ns) it is since the analysis came last, and note that it comes now."""
        before, self._turn_ns = self._turn_ns, now_ns
        return now_ns - before

    def restart(self) -> None:
        """Wait for samples anew: what was heard before counts no more."""
        self.forget()
        self._sample, self._fresh, self._turn_ns = None, False, NEVER

    def figures(self) -> dict[str, str]:
        """Return what diagnostics say."""
        return {
            "round_trip_ms": f"{1e3 * self.round_trip:.1f}",
            "delay_ms": f"{1e3 * self._follower.delay:.1f}",
            "overtaken_samples": str(self.overtaken),
        }
