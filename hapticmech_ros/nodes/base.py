"""What the four nodes share: scene and parameters, refusal of bad messages, diagnostics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.nodes.messages import set_stamp
from hapticmech_ros.nodes.period_clock import Backlog, PeriodClock
from hapticmech_ros.nodes.qos import STREAM_PUBLISHER
from hapticmech_ros.nodes.statistics import DurationHistogram
from hapticmech_ros.scene import Scene, load_scene
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.topics import DIAGNOSTICS, Topic

M = TypeVar("M")
NANOSECONDS = 1_000_000_000
# A refused message is logged at most this often for each topic; all of them are counted.
REFUSAL_LOG_PERIOD_S = 1.0


class HapticNode(Node):
    """A thin shell around core objects of one scene.

    Parameters common to all nodes: ``scene``, ``operational_point``, ``view_rate``,
    ``message_age_limit``, ``diagnostics_period``.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        scene_name = self.text_parameter(
            "scene", "five_bar", "shipped scene, or path of a YAML file"
        )
        self.scene: Scene = load_scene(scene_name)
        point = self.text_parameter("operational_point", "", "where the user holds; empty: first")
        self.point = self.scene.operational_point(point).name
        view_rate = self.number_parameter(
            "view_rate", 100.0, "rate of topics for people, Hz", 1.0, 1000.0
        )
        self.view_every = max(1, round(1.0 / (view_rate * self.scene.simulation.period)))
        limit = self.number_parameter(
            "message_age_limit", 0.25, "oldest stamp that is accepted, s", 0.001, 3600.0
        )
        self.age_limit_ns = round(limit * NANOSECONDS)
        period = self.number_parameter(
            "diagnostics_period", 1.0, "time between diagnostics, s", 0.01, 60.0
        )
        self.refused = 0
        self.ages = DurationHistogram()
        self._last_refusal_log: dict[str, int] = {}
        self._diagnostics = self.create_publisher(
            DiagnosticArray, DIAGNOSTICS.name, STREAM_PUBLISHER
        )
        self.create_timer(period, self._publish_diagnostics)

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return whether all is well, a sentence, and figures, for diagnostics."""
        raise NotImplementedError

    def text_parameter(self, name: str, default: str, description: str) -> str:
        """Declare a read-only text parameter and return its value."""
        descriptor = ParameterDescriptor(description=description, read_only=True)
        return str(self.declare_parameter(name, default, descriptor).value)

    def number_parameter(
        self, name: str, default: float, description: str, low: float, high: float
    ) -> float:
        """Declare a read-only number with a range and return its value."""
        bounds = FloatingPointRange(from_value=low, to_value=high)
        descriptor = ParameterDescriptor(
            description=description, read_only=True, floating_point_range=[bounds]
        )
        return float(self.declare_parameter(name, default, descriptor).value)

    def flag_parameter(self, name: str, default: bool, description: str) -> bool:
        """Declare a read-only flag and return its value."""
        descriptor = ParameterDescriptor(description=description, read_only=True)
        return bool(self.declare_parameter(name, default, descriptor).value)

    def output(
        self, topic: Topic, message_type: Any, qos: QoSProfile = STREAM_PUBLISHER
    ) -> Publisher:
        """Create the publisher of a topic of the table."""
        return self.create_publisher(message_type, topic.of(self.point), qos)

    def input(
        self,
        name: str,
        message_type: type[M],
        qos: QoSProfile,
        accept: Callable[[M, int], None],
    ) -> None:
        """Subscribe; what ``accept(message, now_ns)`` refuses with InvalidInputError is counted."""
        self.create_subscription(message_type, name, self._guarded(name, accept), qos)

    def input_array(self, name: str, qos: QoSProfile, accept: Callable[[Array, int], None]) -> None:
        """Subscribe to a Float64MultiArray's data, read from the bytes on the wire."""

        def read(message: bytes, now_ns: int) -> None:
            accept(decode(message), now_ns)

        guarded = self._guarded(name, read)
        self.create_subscription(Float64MultiArray, name, guarded, qos, raw=True)

    def _guarded(self, name: str, accept: Callable[[M, int], None]) -> Callable[[M], None]:

        def callback(message: M) -> None:
            now = self.now_ns()
            try:
                accept(message, now)
            except InvalidInputError as error:
                self._refuse(name, error, now)

        return callback

    def now_ns(self) -> int:
        """Return the node's time, ns."""
        return int(self.get_clock().now().nanoseconds)

    def final_report(self) -> str:
        """Return what is printed when the node ends."""
        _, sentence, figures = self._whole_status()
        shown = ", ".join(f"{key} {value}" for key, value in figures.items())
        return f"{self.get_name()}: {sentence}; {shown}"

    def _refuse(self, topic: str, error: InvalidInputError, now_ns: int) -> None:
        self.refused += 1
        last = self._last_refusal_log.get(topic)
        if last is None or now_ns - last > REFUSAL_LOG_PERIOD_S * NANOSECONDS:
            self._last_refusal_log[topic] = now_ns
            self.get_logger().warning(f"message on {topic} refused: {error}")

    def _whole_status(self) -> tuple[bool, str, dict[str, str]]:
        well, sentence, figures = self.status()
        figures = {**figures, **self.ages.summary("message_age")}
        figures["refused_messages"] = str(self.refused)
        return well, sentence, figures

    def _publish_diagnostics(self) -> None:
        well, sentence, figures = self._whole_status()
        status = DiagnosticStatus(
            level=DiagnosticStatus.OK if well else DiagnosticStatus.WARN,
            name=self.get_name(),
            message=sentence,
            hardware_id=self.scene.name,
            values=[KeyValue(key=key, value=value) for key, value in figures.items()],
        )
        message = DiagnosticArray(status=[status])
        set_stamp(message.header.stamp, self.now_ns())
        self._diagnostics.publish(message)


class ClockedNode(HapticNode):
    """A node that acts on deadlines of its own as well as on messages.

    Attributes:
        clock: its deadlines, given by the loop that runs it.
        phase: share of a period by which its deadlines follow the common grid.
    """

    clock: PeriodClock
    phase = 0.0

    @property
    def period_s(self) -> float:
        """Control period of the scene, s."""
        return self.scene.simulation.period

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Act on a deadline; ``periods`` is 1, or more after missed deadlines."""
        raise NotImplementedError

    def clock_figures(self, backlog: Backlog) -> dict[str, str]:
        """Return what diagnostics say of deadlines."""
        achieved = self.clock.periods - self.clock.missed
        share = achieved / self.clock.periods if self.clock.periods else 1.0
        return {
            "periods": str(self.clock.periods),
            "missed_deadlines": str(self.clock.missed),
            "dropped_periods": str(backlog.dropped),
            "achieved_rate_hz": f"{share / self.period_s:.1f}",
        }
