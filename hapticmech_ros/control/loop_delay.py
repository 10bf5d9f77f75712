# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measurement of the loop's delay at run time, and gains adapted to it.

The device measures the round trip with its own clock, from sending a sample to receiving the
command that refers to it, so clocks need not be synchronised. Gains are designed for the declared
delay. If the measured delay is longer, the design delay is raised at once; it is lowered only after
the delay has been shorter for some time, so that gains do not follow fluctuations of the traffic.

``operational/observe_kernels`` compensates for a delay τ of the whole loop. A command computed from
a state acts d periods later, on average half a period longer for being held. Where the device
closes the force channel, the mechanism's state is late by as much again: the mechanism gets F_h
that much later than the device, and in held samples. A controller that closes the channel commands
both at once. A connection between device and controller lengthens both delays.
"""

from __future__ import annotations

import math
from math import ceil

import numpy as np

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.controller import (
    DESIGN_PHASE_LAG,
    Connection,
    Controller,
    damping_for,
    lag_of,
)
from hapticmech_ros.scene.device import Device

# Quantile of the round trips in a window; longer ones are outliers of scheduling.
QUANTILE = 0.95
WINDOW = 400
# Round trips between two updates of the quantile, and before the first one.
EVERY = 40
# Delay of the graph itself, s, in addition to the declared one.
OWN_S = 0.005
# The design delay rises if the measured one exceeds it by this factor and time (s); it falls after
# the measured one has been below this factor of it for so many seconds.
LONGER, LONGER_S = 1.1, 0.001
SHORTER, SHORTER_AFTER_S = 0.7, 2.0


class RoundTripEstimate:
    """High quantile of the latest round trips.

    Attributes:
        value: s; 0 until there are enough of them.
    """

    def __init__(self) -> None:
        self.value = 0.0
        self._window = np.zeros(WINDOW)
        self._count = 0

    def add(self, round_trip: float) -> None:
        """Add one round trip, s."""
        self.extend(np.array((round_trip,)))

    def extend(self, round_trips: Array) -> None:
        """Add round trips, in their order.

        Args:
            round_trips: (n,) s.
        """
        # Those up to the last update of the quantile, and those after it.
        updated = max((self._count + round_trips.size) // EVERY * EVERY - self._count, 0)
        self._put(round_trips[:updated])
        if updated:
            seen = self._window[: min(self._count, WINDOW)]
            index = min(int(QUANTILE * seen.size), seen.size - 1)
            self.value = float(np.partition(seen, index)[index])
        self._put(round_trips[updated:])

    def _put(self, round_trips: Array) -> None:
        self._count += round_trips.size
        kept = round_trips[-WINDOW:]
        self._window[np.arange(self._count - kept.size, self._count) % WINDOW] = kept


class DelayFollower:
    """Choice of the one-way delay that gains are designed for, from measured round trips.

    Args:
        connection: declared connection; its delay is the least that gains are designed for.

    Attributes:
        delay: design delay, s, one way.
        tolerated: longest round trip, s, of the declared delay and of the graph.
    """

    def __init__(self, connection: Connection) -> None:
        self._designed = self.delay = connection.designed
        self.tolerated = 2.0 * connection.latest + OWN_S
        self._shorter_since: float | None = None

    def exceeded(self, round_trip: float) -> bool:
        """Return whether a round trip (s) exceeds the declared delay plus that of the graph."""
        return round_trip > self.tolerated

    def is_settled(self, round_trip: float) -> bool:
        """Return whether the same round trip (s) would change nothing, however often it came."""
        target = self._target(round_trip)
        return SHORTER * self.delay <= target <= LONGER * self.delay + LONGER_S

    def _target(self, round_trip: float) -> float:
        return 0.5 * round_trip if self.exceeded(round_trip) else self._designed

    def follow(self, round_trip: float, time: float) -> bool:
        """Process a measured round trip.

        Args:
            round_trip: s.
            time: of the measurement, s.

        Returns:
            Whether ``delay`` changed.
        """
        target, since = self._target(round_trip), self._shorter_since
        self._shorter_since = None
        if target < SHORTER * self.delay:
            since = time if since is None else since
            if time - since < SHORTER_AFTER_S:
                self._shorter_since = since
                return False
        elif target <= LONGER * self.delay + LONGER_S:
            return False
        self.delay = target
        return True


def admissible_round_trip(gains: Controller, inertia: Array, period: float) -> float:
    """Return the largest round trip (s) for which gains keep a delay margin of three.

    It follows from ω τ = 0.3 for the loops that are closed over the connection: the position
    channel on the device, and the joint constraint unless the device closes it.

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
    return max(DESIGN_PHASE_LAG / pace - 1.5 * period, 0.0) if pace > 0.0 else math.inf


def made_for(gains: Controller, device: Device, period: float, delay: float) -> Controller:
    """Return gains whose joint constraint is designed for a one-way delay.

    They are unchanged if the device closes the joint constraint itself. The position channel is
    scaled with the delay by :class:`~hapticmech_ros.control.architecture.PositionChannels`.

    Args:
        gains: without that delay.
        device: whose mass is used.
        period: control period, s.
        delay: one way, s.
    """
    joint = gains.joint_constraint
    if joint.local:
        return gains
    late = Connection(expected=min(delay, 1.0))
    admissible = device.mass * (DESIGN_PHASE_LAG / lag_of(device, late, period, local=False)) ** 2
    if joint.stiffness <= admissible:
        return gains
    softer = {
        "stiffness": admissible,
        "damping": min(joint.damping, damping_for(admissible, device)),
    }
    return gains.model_copy(update={"joint_constraint": joint.model_copy(update=softer)})


# Longest silence, s, that jitter may add to a timeout: the hand must be without force soon after
# the last command, whichever node falls silent.
MOST_ALLOWED_S = 0.005


def jitter_allowance(connection: Connection) -> float:
    """Return how much longer (s) than a timeout a network may be silent: its jitter, to 5 ms."""
    return min(connection.expected_jitter * connection.expected, MOST_ALLOWED_S)


def compensated_loop_delay(scene: Scene, delay: int = 1) -> float:
    """Return τ in s: 2 t_c + (2 d + 1) T with the force channel closed in the device.

    Closed in the controller it is half of that, t_c the delay of the connection.

    Args:
        scene: its period, and what closes the force channel.
        delay: whole periods d from measuring to acting.

    Raises:
        InvalidInputError: a negative delay.
    """
    if delay < 0:
        raise InvalidInputError("delay", delay, "must be 0 or more periods")
    times = 2 if scene.controller.force_channel.local else 1
    return times * (scene.connection.designed + (delay + 0.5) * scene.simulation.period)


def periods_before(scene: Scene, delay: int = 1) -> int:
    """Return the age, in periods before a state, of the past rates that its compensation uses.

    As many as τ has, rounded up. Over a connection it is none: rates that old do not predict a
    hand's wrench.

    Args:
        scene: as of :func:`compensated_loop_delay`.
        delay: likewise.
    """
    if scene.connection.designed > 0.0:
        return 0
    return ceil(compensated_loop_delay(scene, delay) / scene.simulation.period - 1e-6)
