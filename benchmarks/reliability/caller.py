# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of a benchmark in a graph of others: a client of the device's emergency stop."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Mapping
from contextlib import closing, suppress
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, cast

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import SetBool

from benchmarks.children import BenchError
from hapticmech_ros.nodes.loop import wait_for_messages
from hapticmech_ros.wire.topics import EMERGENCY_STOP

ANSWERS_WITHIN_S = 5.0


class Answer(NamedTuple):
    """What a call was answered.

    Attributes:
        success: whether the request was carried out.
        called_ns, answered_ns: when it was called and answered, ns of the monotonic clock.
    """

    success: bool
    called_ns: int
    answered_ns: int


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


class Caller:
    """Calls the emergency stop of a graph, from a process of its own: this one may be busy.

    Args:
        environment: of the graph.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        spawn = multiprocessing.get_context("spawn")
        self._calls, other_end = spawn.Pipe()
        self._process = spawn.Process(
            target=_call_stops, args=(other_end, dict(environment)), daemon=True
        )
        self._process.start()
        other_end.close()

    def close(self) -> None:
        """End the process."""
        self._calls.close()
        self._process.join()

    def stop(self, on: bool) -> Answer:
        """Call it; return the answer.

        Raises:
            BenchError: there is no such service, or no answer within 5 s.
        """
        self._calls.send(on)
        answer = self._calls.recv()
        if answer is None:
            raise BenchError(f"waited {ANSWERS_WITHIN_S:g} s in vain for {EMERGENCY_STOP}")
        return cast(Answer, answer)


def _call_stops(calls: Connection, environment: Mapping[str, str]) -> None:
    """Call the stop for each message of a connection, until it is closed."""
    with closing(Stranger("stop_caller", environment)) as stranger, suppress(EOFError):
        client = stranger.node.create_client(SetBool, EMERGENCY_STOP)
        while True:
            request, answer = SetBool.Request(data=calls.recv()), None
            if client.wait_for_service(ANSWERS_WITHIN_S):
                called_ns = time.monotonic_ns()
                called = client.call_async(request)
                # Each spin_until_future_complete of this executor makes the next ones slower.
                wait_for_messages(stranger.executor, ANSWERS_WITHIN_S, called)
                if called.done():
                    answered_ns = time.monotonic_ns()
                    answer = Answer(called.result().success, called_ns, answered_ns)
            calls.send(answer)
