"""How late a loop is as it runs: found from answers to samples, and what gains bear of it.

A device that finds its sample in the answer knows by its own clock how long the way there and back
took: no two clocks are compared. Gains are made for the delay that is declared; a longer one is
followed, up at once and down only after it has been shorter for a while, so that gains do not pass
to and fro with the traffic.
"""

from __future__ import annotations

import math

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.scene.controller import Connection, Controller
from hapticmech_ros.scene.device import Device
from hapticmech_ros.scene.gain_rule import BORNE, damping_for, lag_of

# Of the round trips in a window; the rest are a machine's hiccups.
QUANTILE = 0.95
WINDOW = 400
# Round trips from one look at the window to the next, and before the first one.
EVERY = 40
# What a graph itself takes, s, beside what is declared.
OWN_S = 0.005
# A delay longer by this counts as another one; shorter ones after so many seconds.
LONGER, LONGER_S = 1.1, 0.001
SHORTER, SHORTER_AFTER_S = 0.7, 2.0


class RoundTripEstimate:
    """A high quantile of the last round trips.

    Attributes:
        value: s; 0 while there are too few.
    """

    def __init__(self) -> None:
        self.value = 0.0
        self._window = np.zeros(WINDOW)
        self._count = 0

    def add(self, round_trip: float) -> None:
        """Count one round trip, s."""
        self._window[self._count % WINDOW] = round_trip
        self._count += 1
        if self._count % EVERY == 0:
            seen = self._window[: min(self._count, WINDOW)]
            index = min(int(QUANTILE * seen.size), seen.size - 1)
            self.value = float(np.partition(seen, index)[index])


class DelayFollower:
    """Says which one-way delay gains are to be made for, as round trips are measured.

    Args:
        connection: what is declared; gains are never made for less.

    Attributes:
        delay: s, one way, that gains are made for.
    """

    def __init__(self, connection: Connection) -> None:
        self._designed = self.delay = connection.designed
        self._tolerated = 2.0 * connection.latest + OWN_S
        self._shorter_since: float | None = None

    def exceeded(self, round_trip: float) -> bool:
        """Return whether a round trip (s) is longer than what is declared and a graph's own."""
        return round_trip > self._tolerated

    def follow(self, round_trip: float, time: float) -> bool:
        """Take a round trip (s) measured at a time (s); return whether ``delay`` has changed."""
        target = 0.5 * round_trip if self.exceeded(round_trip) else self._designed
        if target > LONGER * self.delay + LONGER_S:
            self._shorter_since = None
        elif target < SHORTER * self.delay:
            if self._shorter_since is None:
                self._shorter_since = time
            if time - self._shorter_since < SHORTER_AFTER_S:
                return False
            self._shorter_since = None
        else:
            self._shorter_since = None
            return False
        self.delay = target
        return True


def borne_round_trip(gains: Controller, inertia: Array, period: float) -> float:
    """Return the way there and back (s) that gains bear as they are, with a margin of three.

    By the rule ω τ = 0.3 for what is closed over the connection: the position channel on the
    device, and the joint constraint where the device does not close it.

    Args:
        gains: of the controllers.
        inertia: (6,) diagonal of Λ_d, kg and kg m².
        period: s.
    """
    position, joint = gains.position_channel, gains.joint_constraint
    springs = [(position.stiffness, position.damping, float(inertia[0]))]
    springs.append((position.angular_stiffness, position.angular_damping, float(inertia[3])))
    springs = [(position.to_device * k, position.to_device * b, m) for k, b, m in springs]
    if not joint.local:
        springs.append((joint.stiffness, 0.0, float(inertia[0])))
    pace = max(max(math.sqrt(k / m), b / m) for k, b, m in springs)
    return max(BORNE / pace - 1.5 * period, 0.0) if pace > 0.0 else math.inf


def made_for(gains: Controller, device: Device, period: float, delay: float) -> Controller:
    """Return gains whose joint constraint bears a one-way delay (s), where it crosses it at all.

    The position channel is scaled with the delay by
    :class:`~hapticmech_ros.control.four_channel.FourChannel`.

    Args:
        gains: as they are without it.
        device: whose mass.
        period: s.
        delay: s.
    """
    joint = gains.joint_constraint
    if joint.local:
        return gains
    late = Connection(expected=min(delay, 1.0))
    borne = device.mass * (BORNE / lag_of(device, late, period, local=False)) ** 2
    if joint.stiffness <= borne:
        return gains
    softer = {"stiffness": borne, "damping": min(joint.damping, damping_for(borne, device))}
    return gains.model_copy(update={"joint_constraint": joint.model_copy(update=softer)})
