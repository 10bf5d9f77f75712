# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A ROS 2 node of anybody's: sees what it finds of a graph, and meddles with it if told to.

``python -m benchmarks.reliability.visitor SECONDS [--meddle]``; prints what came of it as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

PERIOD_S, HAND = 0.02, "/device/hand_cf"
# One that any value within its bounds may be given to.
PARAMETER = Parameter("view_rate", value=50.0)


class Visitor(Node):
    """Counts what it finds and what it is let do.

    Args:
        meddle: push the hand, set a parameter, deactivate the controller.
    """

    def __init__(self, meddle: bool) -> None:
        super().__init__("visitor_who_meddles" if meddle else "visitor")
        self.found: set[str] = set()
        self.pushed_by: set[str] = set()
        self.stopped: set[str] = set()
        self.parameters_set = self.transitions = 0
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)
        self._push = self.create_publisher(WrenchStamped, HAND, 10) if meddle else None
        self._set = self.create_client(SetParameters, "/haptic_device/set_parameters")
        self._change = self.create_client(ChangeState, "/teleoperation_controller/change_state")
        self._asked: set[str] = set()

    def visit(self, last: bool) -> None:
        """Look, and meddle; the controller is asked to stop only in the last part of a visit."""
        for name, _ in self.get_topic_names_and_types():
            if name.startswith(("/device", "/mechanism")) and self.count_publishers(name):
                self.found.add(name)
        if self._push is None:
            return
        message = WrenchStamped()
        message.header.frame_id = "world"
        message.header.stamp = self.get_clock().now().to_msg()
        message.wrench.force.x = 0.5
        self._push.publish(message)
        request = SetParameters.Request(parameters=[PARAMETER.to_parameter_msg()])
        self._ask(self._set, request, self._on_set)
        if last:
            step = Transition(id=Transition.TRANSITION_DEACTIVATE)
            self._ask(self._change, ChangeState.Request(transition=step), self._on_changed)

    def report(self) -> dict[str, Any]:
        """Return what came of the visit."""
        return {
            # Nobody of the graph speaks where visitors push.
            "topics": sorted(self.found - {HAND}),
            "pushed_by": sorted(self.pushed_by),
            "parameters_set": self.parameters_set,
            "transitions": self.transitions,
            "inactive": sorted(self.stopped),
        }

    def _ask(self, client: Any, request: Any, done: Callable[[Any], None]) -> None:
        if client.srv_name not in self._asked and client.service_is_ready():
            self._asked.add(client.srv_name)
            client.call_async(request).add_done_callback(done)

    def _on_set(self, answer: Any) -> None:
        self.parameters_set += sum(result.successful for result in answer.result().results)

    def _on_changed(self, answer: Any) -> None:
        self.transitions += bool(answer.result().success)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.message == "inactive":
                self.stopped.add(status.name)
            for pair in status.values:
                if pair.key == "pushed_by" and pair.value != "nobody":
                    self.pushed_by.add(pair.value)


if __name__ == "__main__":
    seconds = float(sys.argv[1])
    rclpy.init()
    node = Visitor("--meddle" in sys.argv)
    begun = time.monotonic()
    while (passed := time.monotonic() - begun) < seconds:
        node.visit(last=passed > seconds / 2)
        rclpy.spin_once(node, timeout_sec=PERIOD_S)
    print(json.dumps(node.report()), flush=True)
    node.destroy_node()
    rclpy.try_shutdown()
