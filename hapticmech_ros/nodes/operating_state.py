# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""CRTK's operating state of an actor, and the commands that change it.

With ``crtk_msgs`` the topics have CRTK's types, without it ``std_msgs/String`` with the same words.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hapticmech_ros.errors import HapticMechError, InvalidInputError, listed
from hapticmech_ros.nodes.actor import Actor
from hapticmech_ros.nodes.messages import (
    LATCHED,
    STREAM_PUBLISHER,
    deserialized,
    message_class,
    set_stamp,
)
from hapticmech_ros.wire.stamped import nearest_stamp
from hapticmech_ros.wire.topics import TEXT, Topic

DISABLED, ENABLED, PAUSED, FAULT = "DISABLED", "ENABLED", "PAUSED", "FAULT"
COMMANDS = ("enable", "disable", "pause", "resume", "home", "unhome")
PAUSE, NOT_HOMED = "paused by state_command", "not homed, by state_command"


class OperatingState:
    """Publishes an actor's operating state when it changes, and obeys commands in any state.

    An inactive node is DISABLED, one that must not obey is in FAULT. A command is answered by the
    state, changed or not: CRTK's clients request one and wait, and do not receive latched messages.

    Args:
        actor: whose.
        topics: of the state and of commands.
        fault: returns why the actor must not obey, its own pause apart; empty if it may.
        at_zero: brings the actor to rest, and makes that known.

    Attributes:
        withheld: why commands of motion are not obeyed, on command; empty if they are.
    """

    def __init__(
        self,
        actor: Actor[Any],
        topics: tuple[Topic, Topic],
        fault: Callable[[], str],
        at_zero: Callable[[], None],
    ) -> None:
        self._actor, self._fault, self._at_zero = actor, fault, at_zero
        self._paused, self._homed = False, True
        self._published: tuple[str, bool] | None = None
        state, command = topics
        self._state_type, self._command_type = map(message_class, (state.type, command.type))
        self._is_text = state.type == TEXT
        self._outlet = actor.output(state, self._state_type, LATCHED)
        self._name = command.of(actor.point)
        node = actor.node
        node.keep(
            node.create_subscription(
                self._command_type, self._name, self._on_command, STREAM_PUBLISHER, raw=True
            )
        )
        self.publish(active=False)

    @property
    def withheld(self) -> str:
        """Why commands of motion are not obeyed."""
        if self._paused:
            return PAUSE
        return "" if self._homed else NOT_HOMED

    def publish(self, active: bool, answers: bool = False) -> None:
        """Publish the state, if it is another than before, or answers a command.

        Args:
            active: whether the node is.
            answers: whether it does.
        """
        state = self._state(active)
        if not answers and (state, self._homed) == self._published:
            return
        self._published = state, self._homed
        message = self._state_type()
        if self._is_text:
            message.data = state
        else:
            set_stamp(message.header.stamp, nearest_stamp(self._actor.now_ns()))
            message.state, message.is_homed, message.is_busy = state, self._homed, False
        self._outlet.publish(message)

    def _state(self, active: bool) -> str:
        if not active:
            return DISABLED
        if self._fault():
            return FAULT
        return PAUSED if self._paused else ENABLED

    def _on_command(self, message: bytes) -> None:
        # Received in every state: ``enable`` comes while the node is inactive.
        self._actor.failures.run(self._name, self._obey, message)

    def _obey(self, message: bytes) -> None:
        try:
            given = deserialized(message, self._command_type)
            word = (given.data if self._is_text else given.string).strip().lower()
            if word not in COMMANDS:
                raise InvalidInputError("state_command", word, f"must be one of {listed(COMMANDS)}")
            getattr(self, f"_{word}")()
        except HapticMechError as error:
            self._actor.node.refuse(self._name, error)
        self.publish(self._actor.node.active, answers=True)

    def _enable(self) -> None:
        self._paused = False
        if not self._actor.node.active:
            self._actor.node.begin()

    def _disable(self) -> None:
        self._actor.node.end()

    def _pause(self) -> None:
        self._actor.refuse_in_lockstep("state_command", "pause", "be commanded")
        self._paused = True
        self._stop()

    def _resume(self) -> None:
        self._paused = False

    def _home(self) -> None:
        self._homed = True

    def _unhome(self) -> None:
        self._actor.refuse_in_lockstep("state_command", "unhome", "be commanded")
        self._homed = False
        self._stop()

    def _stop(self) -> None:
        if self._actor.node.active:
            self._at_zero()
