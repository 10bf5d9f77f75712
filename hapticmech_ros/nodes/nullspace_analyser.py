"""Λ_h⁻¹ and its null space at the mechanism's state, once per joint state received."""

from __future__ import annotations

import numpy as np
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, UInt8, UInt8MultiArray

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.nodes.base import NANOSECONDS, HapticNode
from hapticmech_ros.nodes.messages import checked_stamp, fields_message, matrix_message, write_array
from hapticmech_ros.nodes.qos import CONTROL_SUBSCRIBER, LATCHED
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.counter import CountState, first_count, next_count
from hapticmech_ros.session import rendering_model
from hapticmech_ros.wire.joints import coordinate_names, state_of
from hapticmech_ros.wire.layouts import RENDERING_FIELDS, Rendering, pack_rendering
from hapticmech_ros.wire.topics import (
    CLOSURES,
    CONSTRAINT_WRENCHES,
    COUNT,
    INVERSE_INERTIA,
    JOINT_STATES,
    PROJECTOR,
    RENDERING,
    SPECTRUM,
)

# A pause in joint states longer than this starts the count anew: the mechanism may be elsewhere.
RESTART_PAUSE_NS = NANOSECONDS // 4


class NullspaceAnalyserNode(HapticNode):
    """Runs an :class:`Analyser` on every joint state."""

    def __init__(self) -> None:
        super().__init__("nullspace_analyser")
        self._mechanism = Mechanism(self.scene)
        self._analyser = Analyser(self._mechanism, self.point)
        self._names = coordinate_names(self._mechanism)
        self._active = self._mechanism.initially_active
        self._count: CountState | None = None
        self._last_ns = 0
        self._first_ns = 0
        self.analyses = 0
        self._rendering = fields_message(RENDERING_FIELDS)
        self._square = matrix_message("row", "column", 6, 6)
        self._publish_rendering = self.output(RENDERING, Float64MultiArray)
        self._publish_inertia = self.output(INVERSE_INERTIA, Float64MultiArray)
        self._publish_projector = self.output(PROJECTOR, Float64MultiArray)
        self._publish_wrenches = self.output(CONSTRAINT_WRENCHES, Float64MultiArray)
        self._publish_spectrum = self.output(SPECTRUM, Float64MultiArray)
        self._publish_count = self.output(COUNT, UInt8)
        self.input(CLOSURES.name, UInt8MultiArray, LATCHED, self._on_closures)
        self.input(JOINT_STATES.name, JointState, CONTROL_SUBSCRIBER, self._on_joint_states)

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return what was analysed and how often."""
        fresh = self.now_ns() - self._last_ns < RESTART_PAUSE_NS
        span_s = (self._last_ns - self._first_ns) / NANOSECONDS
        rate = (self.analyses - 1) / span_s if span_s > 0.0 else 0.0
        count = "unknown" if self._count is None else str(self._count.count)
        sentence = f"{count} joint constraints" if fresh else "no joint states"
        figures = {"analyses": str(self.analyses), "achieved_rate_hz": f"{rate:.1f}"}
        return fresh, sentence, figures

    def _on_closures(self, message: UInt8MultiArray, now_ns: int) -> None:
        del now_ns
        expected = len(self._mechanism.closures)
        if len(message.data) != expected:
            rule = f"must hold {expected} flags, one per closure of scene {self.scene.name}"
            raise InvalidInputError("closures", list(message.data), rule)
        self._active = tuple(bool(flag) for flag in message.data)

    def _on_joint_states(self, message: JointState, now_ns: int) -> None:
        time_ns = checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=False)
        q, v = state_of(
            self._mechanism, self._names, message.name, message.position, message.velocity
        )
        self.ages.add(now_ns - time_ns)
        found = self._analyser.analyse(self._mechanism.evaluate(q, v, self._active))
        count = self._counted(found, time_ns)
        rendering = Rendering(time_ns, count, found.spectrum.s, rendering_model(found))
        write_array(self._rendering, pack_rendering(rendering))
        self._publish_rendering.publish(self._rendering)
        if self.analyses % self.view_every == 0:
            self._publish_view(found, count)
        self.analyses += 1

    def _counted(self, found: OperationalAnalysis, time_ns: int) -> int:
        s, perception = found.spectrum.s, self.scene.perception
        if self._count is None or not 0 <= time_ns - self._last_ns < RESTART_PAUSE_NS:
            self._count = first_count(s, perception)
            self._first_ns = time_ns
            self.analyses = 0
        else:
            seconds = (time_ns - self._first_ns) / NANOSECONDS
            self._count = next_count(self._count, s, seconds, perception)
        self._last_ns = time_ns
        return self._count.count

    def _publish_view(self, found: OperationalAnalysis, count: int) -> None:
        for publisher, matrix in (
            (self._publish_inertia, found.inverse_inertia),
            (self._publish_projector, found.constraint_projector),
        ):
            write_array(self._square, matrix)
            publisher.publish(self._square)
        wrenches = np.zeros((6, count))
        if count:
            wrenches[found.rows] = found.spectrum.wrenches[:, -count:]
        self._publish_matrix(self._publish_wrenches, "wrench", "constraint", wrenches)
        self._publish_matrix(
            self._publish_spectrum, "mu", "value", found.spectrum.mu.reshape(-1, 1)
        )
        self._publish_count.publish(UInt8(data=count))

    @staticmethod
    def _publish_matrix(publisher: Publisher, row: str, column: str, matrix: np.ndarray) -> None:
        message = matrix_message(row, column, *matrix.shape)
        write_array(message, matrix)
        publisher.publish(message)
