# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A client of the device's emergency stop, in this process."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import SetBool

from benchmarks.children import BenchError
from hapticmech_ros.wire.topics import EMERGENCY_STOP

ANSWERS_WITHIN_S = 5.0


class Caller:
    """Calls the emergency stop of a graph.

    Args:
        environment: of the graph; this process takes over how the middleware is set in it.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        names = ("FASTRTPS_DEFAULT_PROFILES_FILE", "ROS_DOMAIN_ID")
        os.environ.update({name: environment[name] for name in names if name in environment})
        self._context = Context()
        rclpy.init(context=self._context, domain_id=int(environment["ROS_DOMAIN_ID"]))
        self._node = rclpy.create_node("stop_caller", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._client = self._node.create_client(SetBool, EMERGENCY_STOP)

    def stop(self, on: bool) -> tuple[bool, int]:
        """Call it; return whether it succeeded, and when the answer was here (monotonic, ns).

        Raises:
            BenchError: there is no such service, or no answer within 5 s.
        """
        if not self._client.wait_for_service(ANSWERS_WITHIN_S):
            raise BenchError(f"waited {ANSWERS_WITHIN_S:g} s in vain for {EMERGENCY_STOP}")
        answer = self._client.call_async(SetBool.Request(data=on))
        self._executor.spin_until_future_complete(answer, ANSWERS_WITHIN_S)
        now_ns, result = time.monotonic_ns(), answer.result()
        if result is None:
            raise BenchError(f"waited {ANSWERS_WITHIN_S:g} s in vain for {EMERGENCY_STOP}'s answer")
        return bool(result.success), now_ns

    def close(self) -> None:
        """Leave the graph."""
        self._node.destroy_node()
        self._context.try_shutdown()
