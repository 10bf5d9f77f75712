"""The one loop that runs nodes: an executor that waits no longer than the next deadline.

A bare spin() of the events executor hangs on an endless deadline, so waiting with a finite timeout
happens here and nowhere else. One thread runs callbacks and ticks, so nodes need no locks.
"""

from __future__ import annotations

import gc
import signal
import sys
import time
from collections.abc import Callable, Sequence
from types import FrameType

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.nodes.base import ClockedNode, HapticNode
from hapticmech_ros.nodes.haptic_device import HapticDeviceNode
from hapticmech_ros.nodes.mechanism_simulator import MechanismSimulatorNode
from hapticmech_ros.nodes.nullspace_analyser import NullspaceAnalyserNode
from hapticmech_ros.nodes.period_clock import PeriodClock
from hapticmech_ros.nodes.teleoperation_controller import TeleoperationControllerNode

NODE_TYPES: dict[str, Callable[[], HapticNode]] = {
    "haptic_device": HapticDeviceNode,
    "mechanism_simulator": MechanismSimulatorNode,
    "nullspace_analyser": NullspaceAnalyserNode,
    "teleoperation_controller": TeleoperationControllerNode,
}
NANOSECONDS = 1_000_000_000
# Longest wait for a message or deadline: also how late a signal is answered at the worst.
LONGEST_WAIT_S = 0.1
# A deadline closer than this is waited for by looking at the clock: timers wake up later than that.
SHORTEST_WAIT_S = 20e-6
_NEVER = Future()


class StopRequest:
    """Set by the first SIGINT or SIGTERM; further ones change nothing, nor disturb the end."""

    def __init__(self) -> None:
        self.asked = False
        signal.signal(signal.SIGINT, self._handle)
        signal.signal(signal.SIGTERM, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        self.asked = True


def run(names: Sequence[str], arguments: Sequence[str]) -> int:
    """Create the named nodes and run them in this thread until a signal; return the exit code."""
    stop = StopRequest()
    rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[HapticNode] = []
    try:
        # One by one: those made before a failure are destroyed.
        nodes.extend(NODE_TYPES[name]() for name in names)
        _loop(nodes, stop)
        for node in nodes:
            print(node.final_report(), flush=True)
        return 0
    except HapticMechError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except ExternalShutdownException:
        return 0
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


def wait_for_messages(executor: Executor, timeout_s: float) -> None:
    """Run callbacks of messages for at most ``timeout_s``, which must be finite."""
    executor.spin_until_future_complete(_NEVER, timeout_sec=timeout_s)


def _loop(nodes: Sequence[HapticNode], stop: StopRequest) -> None:
    executor = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    now = time.time_ns()
    clocked: list[tuple[ClockedNode, PeriodClock]] = []
    for node in nodes:
        if isinstance(node, ClockedNode):
            node.clock = PeriodClock.on_grid(node.period_s, node.phase, now)
            clocked.append((node, node.clock))
    gc.collect()
    gc.freeze()
    while rclpy.ok() and not stop.asked:
        wait_for_messages(executor, _wait_s(clocked))
        for node, clock in clocked:
            periods = clock.due(time.time_ns())
            if periods:
                node.tick(periods, clock.last_deadline_ns)
    executor.shutdown()


def _wait_s(clocked: Sequence[tuple[ClockedNode, PeriodClock]]) -> float:
    """Return how long to wait for messages: to the next deadline, within finite bounds."""
    if not clocked:
        return LONGEST_WAIT_S
    ahead = (min(clock.next_ns for _, clock in clocked) - time.time_ns()) / NANOSECONDS
    return min(max(ahead, SHORTEST_WAIT_S), LONGEST_WAIT_S)
