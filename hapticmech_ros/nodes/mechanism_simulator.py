"""The virtual mechanism as a node: moves under wrenches at its operational points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, UInt8MultiArray

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism import Evaluation, MechanismState, Simulator
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.nodes.base import NANOSECONDS, ClockedNode
from hapticmech_ros.nodes.inputs import ExpiringWrench
from hapticmech_ros.nodes.messages import (
    checked_stamp,
    read_wrench,
    set_stamp,
    write_pose,
    write_twist,
    write_wrench,
)
from hapticmech_ros.nodes.period_clock import Backlog
from hapticmech_ros.nodes.qos import (
    COMMAND_SUBSCRIBER,
    CONTROL_SUBSCRIBER,
    LATCHED,
    STREAM_PUBLISHER,
)
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.joints import coordinate_names
from hapticmech_ros.wire.layouts import ENERGY_FIELDS, Energy, pack_energy
from hapticmech_ros.wire.state import StateLayout, WireState
from hapticmech_ros.wire.topics import (
    CLOSURES,
    CONTACT_FORCE,
    ENERGY,
    EXTERNAL_WRENCH,
    JOINT_STATES,
    POINT_COMMAND,
    POINT_POSE,
    POINT_TWIST,
    STATE,
    Topic,
)

# How long a mechanism that failed is silent, so that everyone notices, before it goes on at rest.
FAILURE_SILENCE_NS = NANOSECONDS // 2


@dataclass(slots=True)
class PointPort:
    """Topics of one operational point: what it is told, and what it tells."""

    command: ExpiringWrench
    external: ExpiringWrench
    publish_pose: Publisher
    publish_twist: Publisher
    publish_contact: Publisher


class MechanismSimulatorNode(ClockedNode):
    """Drives a :class:`Simulator` at the control rate."""

    # Half a period after the device, so that a command computed from the device's measurement has
    # arrived when the mechanism steps.
    phase = 0.5

    def __init__(self) -> None:
        super().__init__("mechanism_simulator")
        timeout = self.number_parameter(
            "command_timeout", 0.05, "servo_cf older than this counts as lost, s", 0.001, 1.0
        )
        external = self.number_parameter(
            "external_timeout", 0.2, "external_cf stands this long, s; 0 for ever", 0.0, 3600.0
        )
        self._simulator = Simulator(self.scene)
        self._state: MechanismState = self._simulator.initial_state()
        self._backlog = Backlog()
        self._silent_until_ns = 0
        self.failures = 0
        self._ticks = 0
        self._pose, self._twist, self._wrench = PoseStamped(), TwistStamped(), WrenchStamped()
        self._joints = JointState(name=list(coordinate_names(self._simulator.mechanism)))
        self._layout = StateLayout(self._simulator.mechanism)
        self._wire = FlatArray(self._layout.fields)
        self._energy = FlatArray(ENERGY_FIELDS)
        self._publish_wire = self.output(STATE, Float64MultiArray)
        self._publish_joints = self.output(JOINT_STATES, JointState)
        self._publish_energy = self.output(ENERGY, Float64MultiArray)
        self._publish_closures = self.output(CLOSURES, UInt8MultiArray, LATCHED)
        self._ports = [
            self._port(name, round(timeout * NANOSECONDS), round(external * NANOSECONDS))
            for name in self._simulator.mechanism.point_names
        ]
        self._announce_closures()

    def tick(self, periods: int, deadline_ns: int) -> None:
        """Step the mechanism under the wrenches that stand, and publish its state."""
        if deadline_ns < self._silent_until_ns:
            return
        external = np.array([port.external.at(deadline_ns) for port in self._ports])
        wrenches = external + np.array([port.command.at(deadline_ns) for port in self._ports])
        active = self._state.active
        try:
            for _ in range(self._backlog.steps(periods)):
                self._state = self._simulator.step(self._state, wrenches)
            terms = self._simulator.evaluate(self._state)
        except HapticMechError as error:
            self._fail(error, deadline_ns)
            return
        if self._state.active != active:
            self._announce_closures()
        state = self._state
        commanded = tuple(port.command.heard(deadline_ns) for port in self._ports)
        wire = WireState(deadline_ns, state.active, state.q, state.v, external, commanded)
        self._publish_wire.publish(self._wire.encode(self._layout.pack(wire)))
        if self._ticks % self.view_every == 0:
            self._publish_view(terms, external, deadline_ns)
        self._ticks += 1

    def status(self) -> tuple[bool, str, dict[str, str]]:
        """Return the mechanism's state and figures."""
        closed = self._simulator.mechanism.names_of(self._state.active)
        sentence = f"closed loops: {', '.join(closed) or 'none'}"
        return (
            self.failures == 0,
            sentence,
            {
                **self.clock_figures(self._backlog),
                "closure_error": f"{self._state.closure_error:.3e}",
                "failures": str(self.failures),
            },
        )

    def _publish_view(self, terms: Evaluation, external: Array, time_ns: int) -> None:
        for port, point, contact in zip(self._ports, terms.points, external, strict=True):
            write_wrench(self._wrench, contact, time_ns)
            write_twist(self._twist, point.twist, time_ns)
            write_pose(self._pose, point.pose, time_ns)
            port.publish_contact.publish(self._wrench)
            port.publish_twist.publish(self._twist)
            port.publish_pose.publish(self._pose)
        set_stamp(self._joints.header.stamp, time_ns)
        self._joints.position = self._layout.coordinates(self._state.q).tolist()
        self._joints.velocity = self._state.v.tolist()
        self._publish_joints.publish(self._joints)
        self._publish_energy.publish(self._energy.encode(pack_energy(self._energies(time_ns))))

    def _energies(self, time_ns: int) -> Energy:
        state = self._state
        kinetic, potential = self._simulator.mechanism.energy(state.q, state.v)
        account = state.account
        return Energy(
            time_ns,
            kinetic,
            potential,
            account.work_in,
            account.damping_loss,
            account.latch_loss,
            state.closure_error,
        )

    def _announce_closures(self) -> None:
        message = UInt8MultiArray(data=[int(on) for on in self._state.active])
        label = ",".join(closure.name for closure in self._simulator.mechanism.closures)
        size = len(self._state.active)
        message.layout.dim = [MultiArrayDimension(label=label, size=size, stride=size)]
        self._publish_closures.publish(message)

    def _fail(self, error: HapticMechError, now_ns: int) -> None:
        """Stand still where all was well, and be silent long enough to be noticed."""
        self.failures += 1
        self.get_logger().error(f"mechanism stopped: {error}")
        self._state = replace(self._state, v=np.zeros_like(self._state.v))
        self._silent_until_ns = now_ns + FAILURE_SILENCE_NS

    def _port(self, name: str, timeout_ns: int, external_ns: int) -> PointPort:
        def publisher(topic: Topic, message_type: type) -> Publisher:
            return self.create_publisher(message_type, topic.of(name), STREAM_PUBLISHER)

        port = PointPort(
            ExpiringWrench(timeout_ns, timeout_ns),
            ExpiringWrench(external_ns, NANOSECONDS // 20),
            publisher(POINT_POSE, PoseStamped),
            publisher(POINT_TWIST, TwistStamped),
            publisher(CONTACT_FORCE, WrenchStamped),
        )

        def on_command(message: WrenchStamped, now_ns: int) -> None:
            measured = checked_stamp(message.header, now_ns, self.age_limit_ns, True)
            port.command.put(read_wrench(message), now_ns)
            self.ages.add(now_ns - measured)

        def on_external(message: WrenchStamped, now_ns: int) -> None:
            checked_stamp(message.header, now_ns, self.age_limit_ns, unstamped_is_now=True)
            port.external.put(read_wrench(message), now_ns)

        self.input(POINT_COMMAND.of(name), WrenchStamped, CONTROL_SUBSCRIBER, on_command)
        self.input(EXTERNAL_WRENCH.of(name), WrenchStamped, COMMAND_SUBSCRIBER, on_external)
        return port
