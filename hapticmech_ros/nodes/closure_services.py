# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Closures that people open and close while the mechanism runs, one service each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from std_srvs.srv import SetBool

from hapticmech_ros.device.real_device import MOST_BUTTONS
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.wire.topics import CLOSURES


def offer_closures(
    actor: Actor[Any], names: Iterable[str], switch: Callable[[str, bool], None]
) -> None:
    """Offer ``mechanism/closures/<name>``: true closes it, false opens it.

    Args:
        actor: whose services they are.
        names: of the closures and couplings.
        switch: does it, or raises HapticMechError, which is answered.
    """
    node = actor.node
    for name in names:
        answer = partial(_answer, actor, name, switch)
        node.keep(node.create_service(SetBool, f"{CLOSURES.name}/{name}", answer))


def _answer(
    actor: Actor[Any],
    name: str,
    switch: Callable[[str, bool], None],
    request: SetBool.Request,
    response: SetBool.Response,
) -> SetBool.Response:
    closed = bool(request.data)
    done = f"{name} is {'closed' if closed else 'open'}"
    return actor.failures.answer(f"closure {name}", lambda: switch(name, closed), response, done)


def closure_button(given: str, names: Sequence[str]) -> tuple[str, int] | None:
    """Return the closure that a button switches, and the number of the button; None for none.

    Args:
        given: name and number, such as ``ground_pin 2``; empty: none.
        names: of the closures.

    Raises:
        InvalidInputError: no such closure, or no number of a button.
    """
    if not given.strip():
        return None
    name, _, number = given.strip().rpartition(" ")
    if name not in names or not number.isdecimal() or not 0 < int(number) <= MOST_BUTTONS:
        rule = f"must be one of {list(names)}, and a number from 1 to {MOST_BUTTONS}"
        raise InvalidInputError("closure_button", given, rule)
    return name, int(number)
