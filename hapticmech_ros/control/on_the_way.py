"""Commands between being computed and acting, some periods later."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.engagement import Engagement
from hapticmech_ros.control.force_gain import corrected
from hapticmech_ros.control.measurements import ControlOutput, RenderingModel
from hapticmech_ros.control.prediction import InFlight
from hapticmech_ros.mechanism.model import Array

_NO_GAIN = np.zeros((6, 6))


class Command(NamedTuple):
    """Wrenches (6,) of a tick, G (6, 6), and the hand wrench (6,) that they answer."""

    device: Array
    mechanism: Array
    gain: Array
    answered: Array


class OnTheWay:
    """Commands that have not acted yet, oldest first.

    Args:
        control: that computes them.
        period: s.
        delay: whole periods between measuring and acting.
    """

    def __init__(self, control: ControlArchitecture, period: float, delay: int = 1) -> None:
        self._control = control
        self._period = period
        self._local = control.gains.force_channel.local
        nothing = Command(np.zeros(6), np.zeros(6), _NO_GAIN, np.zeros(6))
        self._commands: deque[Command] = deque([nothing] * delay)

    @property
    def in_flight(self) -> InFlight | None:
        """What the mechanism has been told, and a device that corrects commands has done."""
        if not (self._local and self._commands):
            return None
        impulse = self._period * np.sum([one.mechanism for one in self._commands], axis=0)
        return InFlight(len(self._commands) * self._period, impulse)

    def pass_on(
        self,
        time: float,
        engagement: Engagement,
        model: RenderingModel,
        output: ControlOutput,
        hand_wrench: Array,
    ) -> tuple[Array, Array]:
        """Send an answer off, and return what acts now on device and mechanism, (6,) each.

        Args:
            time: s.
            engagement: the tie of the two poses.
            model: what the analysis reports.
            output: the answer.
            hand_wrench: (6,) F_h that it answers, and that stands now.
        """
        gain = self._control.force_gain(time, engagement, model) if self._local else _NO_GAIN
        self._commands.append(Command(output.device, output.mechanism, gain, hand_wrench))
        device, mechanism, gain, answered = self._commands.popleft()
        if self._local:
            device = corrected(device, gain, answered, hand_wrench)
        return device, mechanism

    def let_go(self) -> None:
        """Take back what the mechanism has been told."""
        self._commands = deque(one._replace(mechanism=np.zeros(6)) for one in self._commands)
