# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The controller gets a sample through the connection, and sends its answer back through it.

For tests, the connection can delay messages, with jitter, and lose some:
:mod:`~hapticmech_ros.control.kernels` computes which arrive when.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hapticmech_ros.control.account_kernels import (
    PREDICTION_LIMIT_S,
    command_mechanism,
    control_sample,
    impulse_in_flight,
    lateness,
    number_in_flight,
)
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.clutch import Clutch
from hapticmech_ros.control.kernels import (
    SLOT_SIZE,
    STATE_SIZE,
    mixed,
    receive,
    send,
    slot_of,
)
from hapticmech_ros.control.loop_layout import (
    Answer,
    ChannelState,
    ControllerAccount,
    ControllerSettings,
    Locality,
)
from hapticmech_ros.control.measurements import InFlight
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import DeviceSample, OperationalModelSample
from hapticmech_ros.scene.controller import Connection


class Channel:
    """One direction of a connection.

    Args:
        connection: its delay, jitter and loss.
        direction: 0 or 1, each with its own random numbers.
        size: n, numbers of a message.
        period: s, between messages.

    Attributes:
        state: whole numbers; see :mod:`~hapticmech_ros.control.kernels`.
        rows: (slots + 1, n) messages in flight, and the one that was received last.
        law: delay, s, jitter and loss, shares.

    Raises:
        InvalidInputError: another direction.
    """

    def __init__(self, connection: Connection, direction: int, size: int, period: float) -> None:
        if direction not in (0, 1):
            raise InvalidInputError("direction", direction, "must be 0 or 1")
        self.law = connection.delay, connection.jitter, connection.loss
        # In flight at once: one for each period of the longest delay, and the one just sent.
        slots = math.ceil(connection.delay * (1.0 + connection.jitter) / period) + 2
        self.state: Array = np.zeros(STATE_SIZE + SLOT_SIZE * slots, dtype=np.int64)
        self.rows: Array = np.zeros((slots + 1, size))
        state = ChannelState(self.state)
        state.newest = -1
        for slot in range(slots):
            slot_of(self.state, slot).number = -1
        with np.errstate(over="ignore"):
            stream = np.uint64(mixed(2 * connection.seed + direction))
        state.stream = int(stream.view(np.int64))

    @property
    def lost(self) -> int:
        """Messages that were lost."""
        return ChannelState(self.state).lost

    @property
    def tag(self) -> int:
        """The number that came with the message that was received last."""
        return ChannelState(self.state).tag

    def put(self, time_ns: int, message: Array, tag: int = 0) -> None:
        """Send a message (n,) at a time (ns), and a whole number with it.

        Args:
            time_ns: when it is sent, ns.
            message: (n,).
            tag: a whole number sent with it.

        Raises:
            InvalidInputError: messages are sent more often than once in a period.
        """
        if not send(self.state, self.rows, *self.law, time_ns, tag, message):
            raise InvalidInputError("time", time_ns, "must be a period after the last message (ns)")

    def take(self, time_ns: int) -> Array | None:
        """Return the newest message (n,) since the last call, a view; None if none arrived."""
        return self.rows[-1] if receive(self.state, self.rows, time_ns) else None


class ControllerInput(NamedTuple):
    """The controller's inputs at a sample's time.

    Attributes:
        time: s, of the controllers.
        stamp_ns: of the device's sample.
        device: (19,) that sample, see :mod:`~hapticmech_ros.control.measurements`.
        operational_model: (139,) analysis and operational point.
        apart_ns: stamp of that sample minus that of the mechanism's state.
        elapsed_ns: since the last ``operational_model``.
    """

    time: float
    stamp_ns: int
    device: Array
    operational_model: Array
    apart_ns: int
    elapsed_ns: int


class ControllerCommand(NamedTuple):
    """An answer to a sample of the device.

    Attributes:
        numbers: all of it.
        answered_ns: stamp of the sample.
    """

    numbers: Answer
    answered_ns: int

    @property
    def wrenches(self) -> Array:
        """(6, 6) rows, units and axes of :class:`~.measurements.ControlOutput`."""
        return self.numbers.wrenches.values.reshape(6, 6)

    @classmethod
    def nothing(cls, stamp_ns: int) -> ControllerCommand:
        """Return the placeholder for an answer before there is one."""
        return cls(Answer(), stamp_ns)


class RenderingController:
    """Answers samples, and accounts for the energy that the mechanism gets.

    Args:
        control: that computes.
        period: s.
        connection: between device and controller.
        delay: whole periods until the mechanism is moved by what is commanded.
        before: the controller until now, whose account is continued.

    Attributes:
        account: of energies.
        queue: (delay, 6) the wrenches commanded on the mechanism that do not act yet.
        past: (n, 6) the commands until now, the last one first: all that a late state may lack.
        commanded: (2, 6) the wrenches sent to the mechanism at the last sample, and acting since,
            N and N m, world axes.
        last: last answer that was computed, whether it has arrived or not; None before the first.
        channels: of the connection, to the controller and back; None if answers arrive at once.
    """

    def __init__(
        self,
        control: ControlArchitecture,
        period: float,
        connection: Connection,
        delay: int = 1,
        before: RenderingController | None = None,
    ) -> None:
        self.control = control
        if before is None:
            self.account = ControllerAccount()
            self.account.period, self.account.inertia[:] = period, np.diag(control.device_inertia)
        else:
            self.account = before.account
        self.account.sample_known = 0.0
        self.queue = np.zeros((delay, 6))
        self.past = np.zeros((delay + math.ceil(PREDICTION_LIMIT_S / period) + 1, 6))
        self.commanded = np.zeros((2, 6))
        self.held_elsewhere()
        self.last: ControllerCommand | None = None
        self._locality, self._nothing = Locality(), Answer()
        self.channels: tuple[Channel, Channel] | None = None
        if not connection.ideal:
            sizes = DeviceSample.layout.size, Answer.layout.size
            forth, back = (Channel(connection, i, size, period) for i, size in enumerate(sizes))
            self.channels = forth, back

    @property
    def is_ideal(self) -> bool:
        """Whether answers arrive at once."""
        return self.channels is None

    @property
    def lost(self) -> int:
        """Messages that the connection lost."""
        return 0 if self.channels is None else sum(channel.lost for channel in self.channels)

    def locality(self, corrects: bool, with_model: bool) -> Locality:
        """Return the loops that the device closes.

        Args:
            corrects: whether the device corrects commands by itself.
            with_model: whether answers contain the model for it.
        """
        gains, account, locality = self.control.gains, self.account, self._locality
        account.passive, account.slack = gains.passivity.control, gains.passivity.slack
        locality.force_channel = corrects and gains.force_channel.local
        locality.joint_constraint = corrects and gains.joint_constraint.local
        locality.with_model = with_model
        return locality

    def tick(
        self, inputs: ControllerInput, clutch: Clutch, corrects: bool, with_model: bool = True
    ) -> ControllerCommand | None:
        """Return the answer that reaches the device now; None if none does.

        Args:
            inputs: of the sample's time.
            clutch: that connects the two poses.
            corrects: whether the device corrects commands by itself.
            with_model: whether the answer contains the model for it.
        """
        device: Array | None = inputs.device
        stamp_ns = inputs.stamp_ns
        if self.channels is not None:
            forth, back = self.channels
            forth.put(stamp_ns, inputs.device, stamp_ns)
            device, stamp_ns = forth.take(stamp_ns), forth.tag
        received = device is not None
        if device is not None:
            self.last = ControllerCommand(Answer(), stamp_ns)
        self._control_sample(device, inputs, clutch, self.locality(corrects, with_model))
        if self.channels is None:
            return self.last
        if received and self.last is not None:
            back.put(inputs.stamp_ns, self.last.numbers.values, self.last.answered_ns)
        arrived = back.take(inputs.stamp_ns)
        return None if arrived is None else ControllerCommand(Answer(arrived.copy()), back.tag)

    def held_elsewhere(self) -> None:
        """Take back the wrench commanded on the mechanism at the place where it was held.

        Springs and motion begin anew there; the account keeps the energy that has flowed.
        """
        self.queue[:] = 0.0
        self.past[:] = 0.0
        self.account.acting[:] = 0.0
        self.account.twist_known = self.account.error_known = 0.0

    def _control_sample(
        self, device: Array | None, inputs: ControllerInput, clutch: Clutch, locality: Locality
    ) -> None:
        """Fill the last answer, if a sample (19,) was received, and :attr:`commanded`."""
        control, time, model = self.control, inputs.time, inputs.operational_model
        answer = self._nothing if self.last is None else self.last.numbers
        settings, in_python = control.settings_at(time, clutch), control.answers_in_python
        if device is not None and in_python:
            delay, period, flying = len(self.queue), self.account.period, None
            closes = locality.force_channel != 0.0
            ahead = lateness(inputs.apart_ns, period)
            number, ahead = number_in_flight(delay, ahead, period, closes)
            if closes:
                rows = self.queue if number == delay else self.past[:number]
                flying = self.in_flight(rows, settings, device, model, time)
            found = control.answer(time, clutch, device, model, ahead, flying)
            answer.wrenches.values[:] = found.ravel()
        control_sample(
            self.account,
            ControllerSettings(settings),
            clutch.faded(time),
            self.queue,
            self.past,
            DeviceSample(inputs.device if device is None else device),
            OperationalModelSample(model),
            time,
            inputs.apart_ns,
            inputs.elapsed_ns,
            locality,
            device is not None,
            in_python,
            answer,
            self.commanded[0],
        )
        command_mechanism(self.account, self.queue, self.past, *self.commanded)

    def in_flight(
        self, flying: Array, settings: Array, device: Array, operational_model: Array, time: float
    ) -> InFlight:
        """Return the commands to the mechanism that have not acted, with half a period of one now.

        A device that corrects commands has done it already.

        Args:
            flying: (n, 6) these commands, N and N m, world axes.
            settings: (59,) of the controllers, a ``ControllerSettings``.
            device: (19,) the sample, in SI units; see ``layout.DeviceSample``.
            operational_model: (139,) in SI units; see ``layout.OperationalModelSample``.
            time: s, of the controllers.
        """
        sample, model = DeviceSample(device), OperationalModelSample(operational_model)
        impulse = np.empty(6)
        duration = impulse_in_flight(
            self.account, ControllerSettings(settings), flying, sample, model, time, impulse
        )
        return InFlight(duration, impulse)
