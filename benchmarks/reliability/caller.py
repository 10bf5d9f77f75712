# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of this process in a graph of others: a client of the device's emergency stop."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import SetBool

from benchmarks.children import BenchError
from hapticmech_ros.wire.topics import EMERGENCY_STOP

ANSWERS_WITHIN_S = 5.0


class Stranger:
    """A node of this process in a graph of others.

    Args:
        name: of the node.
        environment: of the graph; this process takes over how the middleware is set in it.
        executor: kind that handles its messages.

    Attributes:
        node, executor: of it.
    """

    def __init__(
        self, name: str, environment: Mapping[str, str], executor: Any = SingleThreadedExecutor
    ) -> None:
        chosen = {"FASTRTPS_DEFAULT_PROFILES_FILE", "ROS_DOMAIN_ID"} & environment.keys()
        os.environ.update({name: environment[name] for name in chosen})
        self._context = Context()
        rclpy.init(context=self._context, domain_id=int(environment["ROS_DOMAIN_ID"]))
        self.node = rclpy.create_node(name, context=self._context)
        self.executor = executor(context=self._context)
        self.executor.add_node(self.node)

    def close(self) -> None:
        """Leave the graph."""
        self.node.destroy_node()
        self._context.try_shutdown()


class Caller(Stranger):
    """Calls the emergency stop of a graph.

    Args:
        environment: of the graph.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        super().__init__("stop_caller", environment)
        self._client = self.node.create_client(SetBool, EMERGENCY_STOP)

    def stop(self, on: bool) -> tuple[bool, int]:
        """Call it; return whether it succeeded, and when the answer was here (monotonic, ns).

        Raises:
            BenchError: there is no such service, or no answer within 5 s.
        """
        if not self._client.wait_for_service(ANSWERS_WITHIN_S):
            raise BenchError(f"waited {ANSWERS_WITHIN_S:g} s in vain for {EMERGENCY_STOP}")
        answer = self._client.call_async(SetBool.Request(data=on))
        self.executor.spin_until_future_complete(answer, ANSWERS_WITHIN_S)
        now_ns, result = time.monotonic_ns(), answer.result()
        if result is None:
            raise BenchError(f"waited {ANSWERS_WITHIN_S:g} s in vain for {EMERGENCY_STOP}'s answer")
        return bool(result.success), now_ns
