# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Callbacks that are rclpy's own: of ``/clock``, and of services of parameters, states and types.

They take whatever a message or request holds, and rclpy ends the process for an exception: time
before 1970, a parameter of a type that there is not, a transition that the state does not allow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.service import Service

from hapticmech_ros.errors import HapticMechError, shown

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
