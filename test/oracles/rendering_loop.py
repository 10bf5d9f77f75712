"""A period of rendering: from the samples of device and mechanism to what acts on both."""

from __future__ import annotations

from collections import deque

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.architecture import ControlArchitecture
from hapticmech_ros.control.controller_side import Reading
from hapticmech_ros.control.engagement import Engagement
from hapticmech_ros.control.measurements import ControlOutput
from hapticmech_ros.control.rendering_loop import Acting
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.times import nanoseconds
from oracles.controller_side import Answer, ControllerSide
from oracles.local_model import corrected
from oracles.passivity import NO_WRENCH, PassivityController, passivity_for


class RenderingLoop:
    """Controllers, connection and the device's own loop, in the order of the graph.

    Args:
        scene: whose connection and bounds.
        control: that answers.
        delay: whole periods between measuring and acting.

    Attributes:
        passivity: the device's account.
        side: the controllers'.
    """

    def __init__(self, scene: Scene, control: ControlArchitecture, delay: int = 1) -> None:
        self.passivity: PassivityController = passivity_for(scene)
        self._period = scene.simulation.period
        self._period_ns = nanoseconds(self._period)
        self.side = ControllerSide(control, self._period, scene.connection, delay)
        self._on_the_way: deque[Answer | None] = deque([None] * delay)
        self._arrived: Answer | None = None
        self._tick = 0

    @property
    def output(self) -> ControlOutput:
        """The last answer."""
        last = self.side.last
        return ControlOutput(*(np.zeros((6, 6)) if last is None else last.wrenches))

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
        stamp_ns = self._tick * self._period_ns
        self._tick += 1
        reading = Reading(time, stamp_ns, device, rendered, 0.0, self._period)
        arrived = self.side.tick(reading, engagement, corrects=True)
        self._arrived = self._arrived if arrived is None else arrived
        self._on_the_way.append(self._arrived)
        _, mechanism = self.side.tell()
        answer = self._on_the_way.popleft()
        self.passivity.see(device, applied)
        if answer is None:
            return Acting(NO_WRENCH, mechanism)
        self.passivity.tell(answer.to_mechanism)
        wrench = corrected(answer.wrenches[0], answer.model, answer.answered, device)
        return Acting(self.passivity.hold(wrench, device, added), mechanism)
