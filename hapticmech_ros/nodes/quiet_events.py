# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package's kind of node: rclpy's, without two of its habits that stop or end a process.

By default rclpy asks the middleware to tell of peers whose QoS or type does not fit, to log it.
Whoever takes such an event holds a lock of rmw_fastrtps and waits for one of Fast DDS, and the
thread that brings the next one does so the other way round: both may wait for ever (rmw_fastrtps
pull request 890, not in ROS 2 Jazzy's 8.4.3). The peer logs it too.

An exception in a callback ends the process, also in those that are rclpy's own, which anybody may
send anything to: of ``/clock``, and of services of parameters, states and types. Time before 1970,
a parameter of a type that there is not, a transition that the state does not allow: none of it ends
a node here.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.service import Service

from hapticmech_ros.errors import HapticMechError, shown
from hapticmech_ros.times import NANOSECONDS

M = TypeVar("M")
# Told what was wrong.
Refuse = Callable[[HapticMechError], None]


def is_rclpys(callback: object) -> bool:
    """Return whether a function or method is one of rclpy."""
    return (getattr(callback, "__module__", None) or "").partition(".")[0] == "rclpy"


def refusing(callback: Callable[[M], None], refuse: Refuse) -> Callable[[M], None]:
    """Return a subscription's callback that refuses the messages that cannot be taken.

    Args:
        callback: takes a message.
        refuse: told why one was not taken.
    """

    def take(message: M) -> None:
        try:
            callback(message)
        except Exception as error:  # noqa: BLE001 - whatever it is, the process would end
            refuse(_told(error))

    return take


def answering(service: Service, refuse: Refuse) -> Callable[[Any, Any], Any]:
    """Return a service's callback that says in its response that a request cannot be answered.

    Args:
        service: with the callback that it has so far.
        refuse: told why one was not answered.
    """
    callback: Callable[[Any, Any], Any] = service.callback
    kind: Any = service.srv_type

    def answer(request: Any, response: Any) -> Any:
        try:
            return callback(request, response)
        except Exception as error:  # noqa: BLE001 - as above
            told = _told(error)
            refuse(told)
            return _refusal(kind.Response(), str(told))

    def answer_each(request: Any, response: Any) -> Any:
        # One that cannot be read keeps no other from being set.
        each = (kind.Request(parameters=[parameter]) for parameter in request.parameters)
        response.results = [
            one for single in each for one in answer(single, kind.Response()).results
        ]
        return response

    return answer_each if kind is SetParameters else answer


def _refusal(response: Any, reason: str) -> Any:
    """Fill a response; those of other services say by what they lack that nothing was done."""
    if isinstance(response, SetParameters.Response):
        response.results = [SetParametersResult(successful=False, reason=reason)]
    elif isinstance(response, SetParametersAtomically.Response):
        response.result = SetParametersResult(successful=False, reason=reason)
    return response


def _told(error: Exception) -> HapticMechError:
    """Return an error of rclpy as one of ours; it may quote what somebody sent, at any length."""
    return HapticMechError(f"{type(error).__name__}: {shown(str(error))}")


# A refused message is logged at most this often for each topic.
REFUSAL_LOG_PERIOD_NS = NANOSECONDS


class QuietEventsNode(Node):
    """A node that is told of no QoS events, unless that is wanted, and that no message ends.

    Its own callbacks, other than rclpy's, are left as they are.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self._refusal_logs: dict[str, int] = {}
        super().__init__(*args, **kwargs)
        # All that there are now, however they were made.
        for service in self.services:
            if is_rclpys(service.callback):
                what = f"request of {service.service_name}"
                service.callback = answering(service, partial(self.say_refused, what))

    def create_publisher(self, *args: Any, **kwargs: Any) -> Any:
        """Create a publisher, as :meth:`rclpy.node.Node.create_publisher` does.

        Returns:
            The publisher.
        """
        kwargs.setdefault("event_callbacks", PublisherEventCallbacks(use_default_callbacks=False))
        return super().create_publisher(*args, **kwargs)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callable[..., None], *args: Any, **kwargs: Any
    ) -> Any:
        """Create a subscription, as :meth:`rclpy.node.Node.create_subscription` does.

        Returns:
            The subscription.
        """
        kwargs.setdefault(
            "event_callbacks", SubscriptionEventCallbacks(use_default_callbacks=False)
        )
        if is_rclpys(callback):
            callback = refusing(callback, partial(self.refuse, topic))
        return super().create_subscription(msg_type, topic, callback, *args, **kwargs)

    def refuse(self, topic: str, error: HapticMechError) -> None:
        """Drop a message that breaks a rule, and say so now and then."""
        self.say_refused(f"message on {topic}", error)

    def say_refused(self, what: str, error: HapticMechError) -> None:
        """Log what was refused, and why; at most once in :data:`REFUSAL_LOG_PERIOD_NS`."""
        now = time.monotonic_ns()
        last = self._refusal_logs.get(what)
        if last is None or now - last > REFUSAL_LOG_PERIOD_NS:
            self._refusal_logs[what] = now
            self.get_logger().warning(f"{what} refused: {error}")
