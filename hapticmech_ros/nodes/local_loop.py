# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loops closed in the device: commands are corrected for its motion since their sample.

Answers to its samples are taken in order, and timed by the device's own clock.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import NamedTuple

import numpy as np

from hapticmech_ros.control.account_kernels import remember
from hapticmech_ros.control.loop_delay import RoundTripEstimate
from hapticmech_ros.control.loop_layout import HandMemory
from hapticmech_ros.control.other_hands import NO_OTHERS, OtherHands
from hapticmech_ros.control.passivity import corrected
from hapticmech_ros.nodes.device_kernels import MICROSECOND, find_sample
from hapticmech_ros.nodes.inputs import NEVER, InOrder, Latest
from hapticmech_ros.nodes.messages import check_age
from hapticmech_ros.nodes.timeouts import ByRate
from hapticmech_ros.nodes.turn import FOR_EVER
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample, LocalModel
from hapticmech_ros.numerics.times import NANOSECONDS, nanoseconds
from hapticmech_ros.wire.bounds import Bounds, message_bounds, read
from hapticmech_ros.wire.layouts import CouplingMatrices
from hapticmech_ros.wire.messages import LocalFeedbackGain

_HAND = DeviceSample.layout.slice("hand_wrench")
# An older gain does not fit the mechanism's present state.
FRESH_NS = NANOSECONDS // 10
# Samples that are remembered: a loop of so many periods can be corrected.
REMEMBERED = 2048
# Gains that wait for their commands; and how much newer a command without its own may be than the
# one that is obeyed instead.
WAITING, PAIRED = 64, ByRate(20, 0.02)
NO_GAIN = LocalModel().values


class Pair(NamedTuple):
    """A command (6,), the stamp (ns) of the sample that it answers, and how it depends on it."""

    command: Array
    answered_ns: int
    gain: LocalFeedbackGain


class LocalLoop:
    """Remembers samples, and corrects commands that answer them.

    Args:
        period: T, s, over which a command is held.
        bounds: of the gains that it receives.
        paired: whether a gain comes with every command, as it does over a declared network. There a
            command whose gain was lost would be corrected by an outdated one: the last command that
            has its own is obeyed instead, for a while.
        others: wrenches of other users' hands; none of them if left out.

    Attributes:
        stamps, samples, count: those that are remembered; see ``device_kernels.find_sample``.
        hand: (22,) the hand's last wrenches, a ``HandMemory``.
        newest_ns: stamp of the last sample, ns.
        gains, couplings: by stamp, in lockstep.
        others: wrenches of other users' hands.
        order: of gains; overtaken ones are dropped.
    """

    def __init__(
        self,
        period: float,
        bounds: Bounds | None = None,
        paired: bool = False,
        others: OtherHands | None = None,
    ) -> None:
        self._period = period
        self.hand = HandMemory().values
        self.stamps = np.full(REMEMBERED, -1, dtype=np.int64)
        self.samples = np.zeros((REMEMBERED, DeviceSample.layout.size))
        self.count = 0
        self.others = others or OtherHands((), nanoseconds(period))
        self.forget_coupling()
        self.couplings: dict[int, CouplingMatrices] = {}
        self.newest_ns = NEVER
        self._bounds = bounds or message_bounds(LocalFeedbackGain)
        self._paired, self._paired_ns = paired, nanoseconds(PAIRED.at(period))
        self._pair: Pair | None = None
        self._unpaired: OrderedDict[int, LocalFeedbackGain] = OrderedDict()
        self.gains: dict[int, LocalFeedbackGain] = {}
        self.order = InOrder()
        # E_m as received, and its value at the start of obeying, J; NaN while no controller sends
        # it.
        self.energies = np.full(2, np.nan)
        self.from_ns = NEVER
        self._gain: Latest[LocalFeedbackGain] = Latest()

    def measured(self, sample: Array, stamp_ns: int) -> None:
        """Remember a sample (19,).

        Args:
            sample: (19,) of the device, in SI units; see ``layout.DeviceSample``.
            stamp_ns: its stamp, ns.
        """
        row = self.count % REMEMBERED
        self.stamps[row], self.samples[row] = stamp_ns // MICROSECOND, sample
        remember(HandMemory(self.hand), (stamp_ns - self.newest_ns) / NANOSECONDS, sample[_HAND])
        self.went_on(self.count + 1, stamp_ns)

    def went_on(self, count: int, stamp_ns: int) -> None:
        """Note how many samples are remembered now, and the stamp of the last one, ns."""
        self.count, self.newest_ns = count, stamp_ns

    def remembers(self, stamp_ns: int) -> bool:
        """Return whether a stamp is of a sample of this device."""
        return self._row_of(stamp_ns) >= 0

    def _row_of(self, stamp_ns: int) -> int:
        return int(find_sample(self.stamps, self.count, stamp_ns))

    @property
    def plain_gain(self) -> tuple[Array, int] | None:
        """How commands depend on the device (108,), and since when that is known, ns.

        None over a declared network, where each command has its own.
        """
        if self._paired:
            return None
        gain = self._gain.value
        return (NO_GAIN if gain is None else gain.model.values), self._gain.stamp_ns

    def can_correct(self, answered_ns: int, now_ns: int) -> bool:
        """Return whether a command may be obeyed: over a network none that lacks its correction.

        Walls are as stiff as the device's local loop allows; over the network they would diverge.
        """
        needs = self._paired and self.remembers(answered_ns)
        return not needs or self._gain.fresh(now_ns, FRESH_NS)

    def take(
        self, values: Array, now_ns: int, lockstep: bool, age_limit_ns: int = FOR_EVER
    ) -> None:
        """Take a ``local_feedback_gain`` message's data.

        Both of its stamps are of the device's own samples, as a command's is: over a network, too,
        their age is by one clock.

        Args:
            values: (113,) the data.
            now_ns: present time, ns.
            lockstep: whether the graph runs in lockstep.
            age_limit_ns: how far, ns, its stamps may be from now.

        Raises:
            InvalidInputError: as :func:`~hapticmech_ros.wire.bounds.read`, or a stamp
                that is too far from now.
        """
        gain = read(LocalFeedbackGain, values, self._bounds)
        for stamp_ns in (gain.stamp_ns, gain.answered_ns):
            check_age(stamp_ns, now_ns, age_limit_ns)
        if lockstep:
            self.gains[gain.stamp_ns] = gain
            return
        if self._paired and gain.answered_ns > self.from_ns:
            self._unpaired[gain.stamp_ns] = gain
            if len(self._unpaired) > WAITING:
                self._unpaired.popitem(last=False)
        if self.order.is_next(gain.stamp_ns, now_ns):
            self.energies[0] = gain.to_mechanism
            if math.isnan(self.energies[1]):
                self.begin()
            if gain.answered_ns > self.from_ns:
                self._gain.put(gain, now_ns)

    def took(self, model: Array, taken_ns: int, newest: tuple[int, int]) -> None:
        """Note the gains that the device's kernel has taken, whose energies are here already.

        Args:
            model: (108,) how commands depend on the device.
            taken_ns: when the gain with that came, ns.
            newest: the newest gain's stamp, and when it came, ns.
        """
        gain = LocalFeedbackGain()
        gain.model.values[:] = model
        self._gain.put(gain, taken_ns)
        self.order.last = newest

    def take_coupling(
        self, found: CouplingMatrices, now_ns: int, lockstep: bool, age_limit_ns: int = FOR_EVER
    ) -> None:
        """Take a ``coupling_gain`` message.

        Args:
            found: the message.
            now_ns: present time, ns.
            lockstep: whether the graph runs in lockstep.
            age_limit_ns: how far, ns, its stamp may be from now.

        Raises:
            InvalidInputError: its stamp is too far from now.
        """
        check_age(found.stamp_ns, now_ns, age_limit_ns)
        if lockstep:
            self.couplings[found.stamp_ns] = found
        elif found.stamp_ns > self.from_ns:
            self.others.couple(found.by_point, now_ns)

    def forget_coupling(self) -> None:
        """Correct nothing for other hands until the next ``coupling_gain``."""
        self.others.couple({}, NEVER)

    def knows_others(self, answered_ns: int, sampled_ns: int) -> bool:
        """Return whether all is there, in lockstep, that corrects a command for other hands.

        Args:
            answered_ns: stamp of the sample that the command answers, ns.
            sampled_ns: of the samples from which it acts, ns.
        """
        others = self.others
        if not others.names:
            return True
        if answered_ns not in self.couplings:
            return False
        gains = self.couplings[answered_ns].by_point
        return all(others.known_at(name, sampled_ns) for name in gains)

    @property
    def to_mechanism(self) -> float | None:
        """E_m as it was received last, J, since the device began to obey; None before."""
        received, before = self.energies.tolist()
        return None if math.isnan(received) else received - before

    def begin(self) -> None:
        """Count the mechanism's energy from now on."""
        self.energies[1] = self.energies[0]

    def forget(self, now_ns: int) -> None:
        """Correct nothing until there is a gain that answers a sample later than now."""
        self._gain, self.from_ns = Latest(), now_ns
        self.forget_coupling()
        self.energies[:] = np.nan
        self._pair = None
        self._unpaired.clear()

    def correct(self, command: Array, answered_ns: int, now_ns: int) -> Array:
        """Return a command (6,) corrected by the gain that stands, if its sample is remembered.

        A command that answers no sample, such as a controller's last zero, is returned unchanged.

        Args:
            command: (6,) N and N m, world axes at the point held.
            answered_ns: stamp of the sample that it answers.
            now_ns: present time, ns.
        """
        if not self.remembers(answered_ns):
            return command
        own = self._unpaired.pop(answered_ns, None)
        if own is not None:
            self._pair = Pair(command, answered_ns, own)
        pair = self._pair
        if pair is not None and answered_ns - pair.answered_ns <= self._paired_ns:
            return self._corrected(pair.command, pair.gain, pair.answered_ns)
        gain = self._gain.value
        if gain is None or not self._gain.fresh(now_ns, FRESH_NS):
            return command
        notes, others = self.others.data.notes, NO_OTHERS
        if now_ns - notes.coupled <= FRESH_NS:
            others = self.others.correction(answered_ns, self.newest_ns)
        else:
            notes.uncorrected += len(self.others.names) > 0
        return self._corrected(command, gain, answered_ns, others)

    def correct_in_lockstep(self, command: Array, stamp_ns: int) -> Array:
        """Return a command (6,) corrected by the gain that goes with it.

        Args:
            command: (6,) N and N m, world axes at the point held.
            stamp_ns: of the sample that it answers.
        """
        gain = self.gains.pop(stamp_ns)
        self.energies[:] = gain.to_mechanism, 0.0
        if self.others.names:
            self.others.couple(self.couplings.pop(stamp_ns).by_point, self.newest_ns)
        others = self.others.correction(gain.answered_ns, self.newest_ns)
        return self._corrected(command, gain, gain.answered_ns, others)

    def _corrected(
        self,
        command: Array,
        gain: LocalFeedbackGain,
        answered_ns: int,
        others: Array = NO_OTHERS,
    ) -> Array:
        row = self._row_of(answered_ns)
        if row < 0:
            return command
        then, now = self.samples[row], self.samples[(self.count - 1) % REMEMBERED]
        return corrected(command, gain.model.values, then, now, self.hand, self._period, others)


class Answers(InOrder):
    """The commands that answer a device's samples.

    Args:
        loop: remembers these samples.

    Attributes:
        obeys: whether the device obeys them.
        answered_ns: stamp of the sample that the newest of them answers.
    """

    def __init__(self, loop: LocalLoop) -> None:
        super().__init__()
        self.obeys = False
        self.answered_ns = 0
        self._let_go_ns = NEVER
        self._loop = loop
        self._estimate = RoundTripEstimate()

    @property
    def round_trip(self) -> float:
        """Time (s) from a sample to its answer, 95 in 100 of late; 0 while it is not known."""
        return self._estimate.value

    def is_next(self, stamp_ns: int, now_ns: int) -> bool:
        """Return whether an answer is no older than those before it, and take its time."""
        if not super().is_next(stamp_ns, now_ns):
            return False
        self.answered_ns = stamp_ns
        if self._loop.remembers(stamp_ns):
            self._estimate.add((now_ns - stamp_ns) / NANOSECONDS)
        return True

    def went_on(self, newest: tuple[int, int], trips: Array) -> None:
        """Note answers.

        Args:
            newest: stamp of the newest one, and when it came, ns.
            trips: (n,) s, that they took, of those that answer samples.
        """
        self.last = newest
        self.answered_ns = newest[0]
        self._estimate.extend(trips)

    def lost(self, now_ns: int) -> str:
        """Return the input that is lost while it obeys, at a time (ns); empty if none is."""
        well = not self.obeys or self._loop.can_correct(self.answered_ns, now_ns)
        return "" if well else "local_feedback_gain is lost"

    def begin(self, answered_ns: int, now_ns: int) -> bool:
        """Return whether to obey a command from now on, or already.

        A command that answers a sample from before the device let go was meant for a hand that held
        it. Commands that answer no sample are from a controller that closes no loop.

        Args:
            answered_ns: stamp of the sample that it answers, ns.
            now_ns: present time, ns.
        """
        late = answered_ns <= self._let_go_ns and self._loop.remembers(answered_ns)
        if not (self.obeys or late) and self._loop.can_correct(answered_ns, now_ns):
            self.obeys = True
            self._loop.begin()
        return self.obeys

    def let_go(self, now_ns: int) -> None:
        """Obey nothing that answers a sample up to now (ns)."""
        if self.obeys:
            self._let_go_ns = now_ns
        self.obeys = False
        self._loop.forget(self._let_go_ns)

    def figures(self) -> dict[str, str]:
        """Return entries for diagnostics."""
        return {
            "round_trip_ms": f"{1e3 * self.round_trip:.1f}",
            "overtaken_commands": str(self.overtaken),
            "overtaken_gains": str(self._loop.order.overtaken),
        }
