# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Buttons of a device's handle: published by its driver, received by nodes that obey them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import Joy

from hapticmech_ros.device.real_device import MOST_BUTTONS
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.messages import LATCHED, STREAM_PUBLISHER, set_stamp
from hapticmech_ros.numerics.times import NANOSECONDS
from hapticmech_ros.wire.topics import DEVICE_BUTTONS

# Foreign drivers latch nothing, and so subscribers do not expect it: a late one receives the
# buttons within this time, ns.
REPEAT_NS = NANOSECONDS


class ButtonOutput:
    """Publishes the buttons of a device when they change, and once a second.

    Args:
        actor: the device's.
    """

    def __init__(self, actor: Actor[Any]) -> None:
        self._publish = actor.output(DEVICE_BUTTONS, Joy, LATCHED)
        self._published: tuple[bool, ...] = ()
        self._published_ns = 0

    def publish(self, pressed: tuple[bool, ...], time_ns: int) -> None:
        """Publish which buttons are pressed, if due; buttons that are gone are released.

        Args:
            pressed: whether each button is.
            time_ns: of the sample, ns.
        """
        missing = len(self._published) - len(pressed)
        found = (*pressed, *(False,) * missing)
        if found != self._published or (found and time_ns - self._published_ns >= REPEAT_NS):
            self._published, self._published_ns = found, time_ns
            message = Joy(buttons=[int(one) for one in found])
            set_stamp(message.header.stamp, time_ns)
            self._publish.publish(message)


class ButtonInput:
    """Receives which buttons of a device are pressed.

    Args:
        actor: who obeys them.
        prefix: before the name of the topic.
        pressed: called with the number of a button that is pressed from now on; those of the first
            message may have been pressed before.
    """

    def __init__(
        self, actor: Actor[Any], prefix: str = "", pressed: Callable[[int], None] | None = None
    ) -> None:
        self._on_press = pressed
        self._state: tuple[bool, ...] | None = None
        actor.input(prefix + DEVICE_BUTTONS.name, Joy, STREAM_PUBLISHER, self._received)

    def is_pressed(self, number: int) -> bool:
        """Return whether a button is pressed, the first one being 1; none is 0."""
        known = self._state or ()
        return 0 < number <= len(known) and known[number - 1]

    def _received(self, message: Joy, now_ns: int) -> None:
        del now_ns
        before, self._state = self._state, joy_buttons(message)
        if self._on_press is None or before is None:
            return
        for number, pressed in enumerate(self._state, 1):
            if pressed and not (number <= len(before) and before[number - 1]):
                self._on_press(number)


def joy_buttons(message: Joy) -> tuple[bool, ...]:
    """Return which buttons of a message are pressed.

    Raises:
        InvalidInputError: too many for a handle.
    """
    if len(message.buttons) > MOST_BUTTONS:
        rule = f"must be at most {MOST_BUTTONS}"
        raise InvalidInputError("buttons", len(message.buttons), rule)
    return tuple(bool(one) for one in message.buttons)
