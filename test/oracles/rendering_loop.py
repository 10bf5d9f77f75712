# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A period of rendering: from the samples of device and mechanism to what acts on both."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.clutch import Clutch
from hapticmech_ros.control.measurements import ControlOutput
from hapticmech_ros.control.rendering_controller import ControllerInput
from hapticmech_ros.device.safety import safety_limits
from hapticmech_ros.scene import Scene
from hapticmech_ros.times import nanoseconds
from oracles.local_model import FORCE, corrected
from oracles.passivity import NO_WRENCH, PassivityController, passivity_for
from oracles.rendering_controller import ControllerCommand, RenderingController
from oracles.safety import SafetyEnvelope


class Acting(NamedTuple):
    """What acts over the next period, (6,) each, world axes.

    Attributes:
        device: on the hand, by the device.
        mechanism: on the mechanism, by the hand.
    """

    device: Array
    mechanism: Array


class RenderingLoop:
    """Controllers, connection and the device's own loop, in the order of the graph.

    Args:
        scene: whose connection and bounds.
        control: that answers.
        delay: whole periods between measuring and acting.

    Attributes:
        passivity: the device's account.
        envelope: its safety envelope.
        side: the controllers'.
    """

    def __init__(self, scene: Scene, control: ControlArchitecture, delay: int = 1) -> None:
        self.passivity: PassivityController = passivity_for(scene)
        self.envelope = SafetyEnvelope(scene.simulation.period)
        self._limits = safety_limits(scene.device)
        self._period = scene.simulation.period
        self._period_ns = nanoseconds(self._period)
        self.side = RenderingController(control, self._period, scene.connection, delay)
        self._on_the_way: deque[ControllerCommand | None] = deque([None] * delay)
        self._arrived: ControllerCommand | None = None
        self._tick = 0
        self._hand: deque[Array] = deque(maxlen=2)

    @property
    def output(self) -> ControlOutput:
        """The last answer."""
        last = self.side.last
        return ControlOutput(*(np.zeros((6, 6)) if last is None else last.wrenches))

    def tick(
        self,
        time: float,
        clutch: Clutch,
        device: Array,
        applied: Array,
        operational_model: Array,
        added: Array = NO_WRENCH,
    ) -> Acting:
        """Answer, and return what acts from now on.

        Args:
            time: s.
            clutch: that connects the two poses.
            device: (19,) its sample, see :mod:`~hapticmech_ros.control.measurements`.
            applied: (6,) by the actuators until now.
            operational_model: (139,) operational model, F_c included.
            added: (6,) by the device's driver, to the next command.
        """
        stamp_ns = self._tick * self._period_ns
        self._tick += 1
        inputs = ControllerInput(time, stamp_ns, device, operational_model, 0.0, self._period)
        arrived = self.side.tick(inputs, clutch, corrects=True)
        self._arrived = self._arrived if arrived is None else arrived
        self._on_the_way.append(self._arrived)
        _, mechanism = self.side.command_mechanism()
        answer = self._on_the_way.popleft()
        self.passivity.record(device, applied)
        wrench = NO_WRENCH
        if answer is not None:
            self.passivity.set_mechanism_energy(answer.to_mechanism)
            answered = answer.model, answer.answered, device
            wrench = corrected(answer.wrenches[0], *answered, list(self._hand))
        self._hand.appendleft(device[FORCE].copy())
        safe = self.envelope.apply(self._limits, wrench, device[:3])
        passive = self.passivity.enforce(safe, device, added)
        if passive is not safe:
            passive = self.envelope.bound(self._limits, passive, device[:3])
        return Acting(passive, mechanism)
