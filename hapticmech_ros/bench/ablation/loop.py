"""A session's tick with a clock between its parts."""

from __future__ import annotations

from time import perf_counter_ns

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control import PointMeasurement, control_for
from hapticmech_ros.control.engagement import engage
from hapticmech_ros.control.flat import flat_rendered
from hapticmech_ros.control.lateness import loop_lateness
from hapticmech_ros.control.rendering_loop import RenderingLoop
from hapticmech_ros.control.rendering_model import rendering_model
from hapticmech_ros.device import device_for
from hapticmech_ros.operational import Analyser
from hapticmech_ros.operational.contact_wrench import touching_wrench
from hapticmech_ros.scene import Scene
from hapticmech_ros.simulation import Simulator

# In the order of a tick.
PARTS = ("evaluate", "analyse", "control", "step", "device")


class Loop:
    """What a :class:`~hapticmech_ros.session.Session` does, to the bit, part by part.

    Attributes:
        simulator, analyser, control, device: that do the parts.
        state: of the mechanism, at the next tick.
        device_state: the same of the device.
    """

    def __init__(self, scene: Scene) -> None:
        self.simulator = Simulator(scene)
        self.analyser = Analyser(self.simulator.mechanism, lateness=loop_lateness(scene))
        self.control = control_for(scene)
        self.device = device_for(scene)
        self.state = self.simulator.initial_state()
        self._index = self.analyser.index
        start = self.simulator.evaluate(self.state).points[self._index].pose
        self.device_state = self._held = self.device.at_rest(start, held=True)
        self.engagement = engage(0.0, start, start)
        self._loop = RenderingLoop(scene, self.control)
        self._nothing = np.zeros(6)
        self._points = len(self.simulator.mechanism.point_names)
        self.ticks = 0

    def tick(self, taken_ns: Array) -> None:
        """Do a tick, and fill (5,) with the time of each of ``PARTS``, ns."""
        device, state = self.device_state, self.state
        begun = perf_counter_ns()
        terms = self.simulator.evaluate(state)
        evaluated = perf_counter_ns()
        analysis = self.analyser.analyse(terms)
        late = self.analyser.late(terms, state.q, state.v, state.active, analysis)
        contact = touching_wrench(terms, analysis, state.touching, self._index)
        analysed = perf_counter_ns()
        point, model = terms.points[self._index], rendering_model(analysis, late)
        time = self.ticks * self.simulator.period
        seen = PointMeasurement(point.pose, point.twist, self._nothing + contact)
        sample = device.published[:19]
        rendered = flat_rendered(model, seen)
        acting = self._loop.tick(time, self.engagement, sample, device.applied, rendered)
        controlled = perf_counter_ns()
        wrenches = np.zeros((self._points, 6))
        wrenches[self._index] = acting.mechanism + self._nothing
        self.state = self.simulator.step(state, wrenches)
        stepped = perf_counter_ns()
        self.device_state = self.device.step(device, acting.device, self._held, self.ticks)
        ended = perf_counter_ns()
        self.ticks += 1
        taken_ns[0], taken_ns[1] = evaluated - begun, analysed - evaluated
        taken_ns[2], taken_ns[3] = controlled - analysed, stepped - controlled
        taken_ns[4] = ended - stepped
