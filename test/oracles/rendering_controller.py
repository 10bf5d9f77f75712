# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the controller does with a sample: through the connection, answered, and back through it."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.clutch import Clutch
from hapticmech_ros.control.measurements import InFlight, model_of
from hapticmech_ros.control.rendering_controller import ControllerInput
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL
from hapticmech_ros.scene.controller import Connection
from oracles.delay_line import DelayLine
from oracles.energy_ledger import EnergyLedger
from oracles.local_model import FORCE, NO_MODEL, LocalModel, local_model
from oracles.port_passivity import PortPassivity

_NO_WRENCH = np.zeros(6)
_TWIST, _CONTACT = OPERATIONAL_MODEL.slice("twist"), OPERATIONAL_MODEL.slice("contact")


class ControllerCommand(NamedTuple):
    """An answer to a sample of the device.

    Attributes:
        wrenches: (6, 6) as :class:`~hapticmech_ros.control.measurements.ControlOutput` has them.
        model: how the first of them depends on the device.
        answered: (19,) the sample.
        answered_ns: its stamp.
        to_mechanism: E_m when it was given, J.
    """

    wrenches: Array
    model: LocalModel
    answered: Array
    answered_ns: int
    to_mechanism: float

    @classmethod
    def nothing(cls, stamp_ns: int) -> ControllerCommand:
        """Return what stands for an answer before there is one."""
        return cls(np.zeros((6, 6)), NO_MODEL, np.zeros(DEVICE_SAMPLE.size), stamp_ns, 0.0)


class RenderingController:
    """Answers samples, and keeps the account of what the mechanism gets.

    Args:
        control: that computes.
        period: s.
        connection: between device and controller.
        delay: whole periods until the mechanism is moved by what it is told.
        before: what answered until now, whose account goes on.

    Attributes:
        ledger: the account.
        last: last answer that was given, whether it has arrived or not; None before the first.
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
        self.ledger: EnergyLedger = EnergyLedger() if before is None else before.ledger
        self.ledger.held_elsewhere()
        self.last: ControllerCommand | None = None
        self._period = period
        self._told: deque[Array] = deque([_NO_WRENCH] * delay)
        inertia = np.diag(control.device_inertia).copy()
        self.port: PortPassivity = PortPassivity(inertia) if before is None else before.port
        self.port.pause()
        self._twist: Array = _NO_WRENCH
        self._lines: tuple[DelayLine[ControllerInput], DelayLine[ControllerCommand]] | None = None
        if not connection.ideal:
            self._lines = DelayLine(connection, 0), DelayLine(connection, 1)

    def _passive_command(self) -> Array:
        """Return what the mechanism is told (6,): the last answer, as far as the hand pays."""
        if self.last is None:
            return _NO_WRENCH
        wrench = self.last.wrenches[1]
        passivity = self.control.gains.passivity
        if not passivity.control:
            return np.asarray(wrench)
        short = self.ledger.entry.to_mechanism - self.port.from_hand - passivity.slack
        return self.port.enforce(wrench, self._twist) if short > 0.0 else wrench

    @property
    def lost(self) -> int:
        """Messages that the connection lost."""
        return 0 if self._lines is None else self._lines[0].lost + self._lines[1].lost

    def tick(
        self, inputs: ControllerInput, clutch: Clutch, corrects: bool, with_model: bool = True
    ) -> ControllerCommand | None:
        """Return the answer that reaches the device now; None if none does.

        Args:
            inputs: what is known.
            clutch: that connects the two poses.
            corrects: whether the device corrects commands by itself.
            with_model: whether the answer is to say how.
        """
        self.ledger.moved(inputs.operational_model[_TWIST], inputs.elapsed)
        seen: ControllerInput | None = inputs
        if self._lines is not None:
            self._lines[0].put(inputs.stamp_ns, inputs)
            seen = self._lines[0].take(inputs.stamp_ns)
        answer = None
        self._twist = inputs.operational_model[_TWIST]
        if seen is not None:
            self.port.record(seen.device)
            answer = self._answered(seen, inputs, clutch, corrects, with_model)
            self.last = answer
        if self._lines is None:
            return answer
        if answer is not None:
            self._lines[1].put(inputs.stamp_ns, answer)
        return self._lines[1].take(inputs.stamp_ns)

    def command_mechanism(self) -> tuple[Array, Array]:
        """Return what the mechanism is told, and what acts on it from now on, (6,) each."""
        told = self._passive_command()
        self._told.append(told)
        acting = self._told.popleft()
        self.ledger.acts(acting)
        return told, acting

    def held_elsewhere(self) -> None:
        """Take back what the mechanism was told at the place where it was held."""
        self._told = deque([_NO_WRENCH] * len(self._told))
        self.ledger.held_elsewhere()

    def _answered(
        self,
        seen: ControllerInput,
        inputs: ControllerInput,
        clutch: Clutch,
        corrects: bool,
        with_model: bool,
    ) -> ControllerCommand:
        control, operational_model = self.control, inputs.operational_model
        flying = None
        if corrects and control.gains.force_channel.local:
            flying = self._in_flight(inputs.time, clutch, seen.device, operational_model)
        wrenches = control.answer(
            inputs.time, clutch, seen.device, operational_model, inputs.ahead, flying
        )
        gains, seen_model = control.gains.joint_constraint, model_of(operational_model)
        projector = seen_model.constraint_projector
        self.ledger.answered(wrenches[5], projector, gains, control.channels, self._period)
        model = NO_MODEL
        if corrects and with_model and control.gains.local:
            model = local_model(control, inputs.time, clutch, seen_model)
        given = self.ledger.entry.to_mechanism
        return ControllerCommand(wrenches, model, seen.device, seen.stamp_ns, given)

    def _in_flight(
        self, time: float, clutch: Clutch, device: Array, operational_model: Array
    ) -> InFlight:
        """Return what the mechanism was told, and a device that corrects commands has done.

        And half a period of what it is told now of measured forces.
        """
        gains, task = self.control.gains.force_channel, self.control.task
        hand, contact = device[FORCE], operational_model[_CONTACT]
        forces = gains.hand * hand + gains.mechanism_feedback * contact
        told = np.sum(self._told, axis=0) if self._told else np.zeros(6)
        told = told + 0.5 * clutch.force_ramp(time) * task * forces
        return InFlight((len(self._told) + 0.5) * self._period, self._period * told)
