"""A period of rendering: from the samples of device and mechanism to what acts on both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.controller_side import Answer, ControllerSide, Reading
from hapticmech_ros.control.device_side import DeviceSide
from hapticmech_ros.control.engagement import Engagement
from hapticmech_ros.control.loop_layout import ANSWER
from hapticmech_ros.control.measurements import ControlOutput
from hapticmech_ros.control.passivity import NO_WRENCH
from hapticmech_ros.control.render_kernels import act_on_answers, render_period
from hapticmech_ros.device.safety import NO_LIMITS
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.times import nanoseconds


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
        device: the device's side; its safety envelope, which the device's node has, is open.
        side: the controllers'.
    """

    def __init__(self, scene: Scene, control: ControlArchitecture, delay: int = 1) -> None:
        self.device = DeviceSide(scene, NO_LIMITS)
        self._period = scene.simulation.period
        self._period_ns = nanoseconds(self._period)
        self.side = ControllerSide(control, self._period, scene.connection, delay)
        # Those on the way, the row after them, and the one that has arrived last.
        self._answers = np.zeros((delay + 2, ANSWER.size))
        self._nothing = np.zeros(ANSWER.size)
        self._tick = 0

    @property
    def wrenches(self) -> Array:
        """(6, 6) the last answer, rows as in :class:`ControlOutput`; a copy."""
        last = self.side.last
        return np.zeros((6, 6)) if last is None else last.wrenches.copy()

    @property
    def output(self) -> ControlOutput:
        """The last answer."""
        return ControlOutput(*self.wrenches)

    def tick(
        self,
        time: float,
        engagement: Engagement,
        device: Array,
        applied: Array,
        rendered: Array,
        added: Array = NO_WRENCH,
    ) -> Acting:
        """Answer, and return what acts from now on.

        Args:
            time: s.
            engagement: the tie of the two poses.
            device: (19,) its sample, see :mod:`~hapticmech_ros.control.flat`.
            applied: (6,) by the actuators until now.
            rendered: (139,) operational model, F_c included.
            added: (6,) by the device's driver, to the next command.
        """
        side, answers, wrenches = self.side, self._answers, np.empty((3, 6))
        stamp_ns = self._tick * self._period_ns
        account, safety = self.device.passivity.account, self.device.envelope.numbers
        control = side.control
        self._tick += 1
        if side.is_ideal and control.compiled:
            settings = control.settings_at(time, engagement)
            render_period(
                side.account,
                settings,
                control.carried_at(time, engagement),
                side.queue,
                account,
                safety,
                answers,
                device,
                rendered,
                time,
                side.locality(corrects=True, with_model=True),
                applied,
                added,
                wrenches,
            )
            side.last = Answer(answers[-1], stamp_ns)
            return Acting(wrenches[0], wrenches[1])
        reading = Reading(time, stamp_ns, device, rendered, 0.0, self._period)
        arrived = side.tick(reading, engagement, corrects=True)
        if arrived is not None:
            answers[-1] = arrived.numbers
        given = self._nothing if side.last is None else side.last.numbers
        known = (side.queue, account, safety, answers, device, applied, added)
        act_on_answers(side.account, given, *known, wrenches)
        return Acting(wrenches[0], wrenches[1])
