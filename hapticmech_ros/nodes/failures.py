# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What an actor does when a callback or a tick of its goes wrong: fail closed, say so, go on.

A failure never ends the process, and nobody is left under a force. The actor is put back to where
all was well, at rest, and begins anew, so that the graph comes back by itself. What the package
raises on purpose, such as a state that is no longer finite, may come as often as its cause does;
anything else is a defect of the program, and an actor that keeps on meeting one is deactivated.
What moves something goes back to its last valid state.
"""

from __future__ import annotations

import time
import traceback
from collections import deque
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from hapticmech_ros.errors import HapticMechError, OutputError, shown
from hapticmech_ros.nodes.host import Host
from hapticmech_ros.times import NANOSECONDS

# So many defects within this time, and the node deactivates itself.
MOST_DEFECTS, DEFECTS_WITHIN_NS = 20, 10 * NANOSECONDS
# A failure of one callback is logged at most this often; all of them are counted.
LOG_PERIOD_NS = NANOSECONDS

Status = tuple[bool, str, dict[str, str]]
# As of SetBool and Trigger.
Response = TypeVar("Response", bound="Told")


class Told(Protocol):
    """A service's answer.

    Attributes:
        success: whether it was done.
        message: in a sentence.
    """

    success: bool
    message: str


class Failures:
    """Runs an actor's callbacks and ticks, and counts those that fail.

    Args:
        node: that hosts the actor.
        reseat: puts the actor back to where all was well, at rest, with nobody under a force.

    Attributes:
        count, defects: failures so far, and unexpected ones among them.
        last: what failed last, and how.
    """

    def __init__(self, node: Host, reseat: Callable[[], None]) -> None:
        self._node = node
        self._reseat = reseat
        self.count = 0
        self.last = ""
        self.defects = 0
        self._lately: deque[int] = deque(maxlen=MOST_DEFECTS)
        self._logged: dict[str, int] = {}

    def run(self, what: str, call: Callable[..., object], *arguments: object) -> None:
        """Call; whatever goes wrong is said under the name ``what``, and the actor begins anew."""
        try:
            call(*arguments)
        except Exception as error:  # noqa: BLE001 - a hand is held: no error may stop what stops it
            self.met(what, error)

    def answer(
        self, what: str, call: Callable[[], object], response: Response, done: str
    ) -> Response:
        """Call for a service, and return its response: done, or why it was refused or failed.

        Args:
            what: the service.
            call: does it, or refuses with a HapticMechError.
            response: to fill.
            done: sentence if all went well.
        """
        before = self.count
        refusals: list[str] = []

        def called() -> None:
            try:
                call()
            except OutputError:
                raise  # a failure: something is wrong in here
            except HapticMechError as error:
                refusals.append(str(error))

        self.run(what, called)
        if self.count > before:
            refusals.append(self.last)
        response.success = not refusals
        response.message = refusals[0] if refusals else done
        return response

    def status(self, ask: Callable[[], Status]) -> Status:
        """Return an actor's status with what failed, be it that the status cannot be told."""
        told: list[Status] = []
        self.run("status", lambda: told.append(ask()))
        well, sentence, figures = told[0] if told else (False, self.last, {})
        return well, sentence, {**figures, "failures": str(self.count), "last_failure": self.last}

    def met(self, what: str, error: Exception) -> None:
        """Say what went wrong, and begin anew, or give up."""
        self.count += 1
        self.last = f"{what}: {_sentence(error)}"
        now = time.monotonic_ns()
        last = self._logged.get(what)
        if last is None or now - last > LOG_PERIOD_NS:
            self._logged[what] = now
            self._node.get_logger().error(
                f"error in {self.last}: forces are zero, this node restarts at rest from its last "
                "valid state"
            )
        if isinstance(error, HapticMechError):
            self._begin_anew()
            return
        self.defects += 1
        self._lately.append(now)
        full = len(self._lately) == MOST_DEFECTS
        if full and now - self._lately[0] <= DEFECTS_WITHIN_NS:
            self._give_up()
        else:
            self._begin_anew()

    def _begin_anew(self) -> None:
        try:
            self._reseat()
        except Exception as error:  # noqa: BLE001 - as in run(): what cannot begin anew must end
            self.last = f"cannot begin anew: {_sentence(error)}"
            self._give_up()

    def _give_up(self) -> None:
        """Deactivate the node, whatever becomes of it meanwhile."""
        self._lately.clear()
        self._node.get_logger().fatal(
            f"this node deactivates itself after repeated errors; last error: {self.last}"
        )
        try:
            self._node.end()
        except Exception as error:  # noqa: BLE001 - as in run(): it does nothing more either way
            self._node.get_logger().fatal(f"cannot be deactivated: {_sentence(error)}")
        self._node.active = False


def _sentence(error: Exception) -> str:
    """Return what an error says; of a defect also what it is, and where it was."""
    if isinstance(error, HapticMechError):
        return str(error)
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({frames[-1].filename.rpartition('/')[2]}:{frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {shown(str(error))}{where}"


T = TypeVar("T")
# Who fails again so soon goes back to where it began, s.
CALM_S = 0.25
# How long one that failed is silent, so that everyone notices, before it goes on at rest.
SILENCE_NS = NANOSECONDS // 2


class LastValidState(Generic[T]):
    """The last state in which all was well, and the one to begin with where even that fails.

    Args:
        start: the state to begin with.
        period_s: between two ticks.

    Attributes:
        resting: whether it is silent now, after a failure.
    """

    def __init__(self, start: T, period_s: float) -> None:
        self._start = self._good = start
        self._since = self._calm = max(1, round(CALM_S / period_s))
        self._until_ns = 0
        self.resting = False

    def keep(self, state: T, ticks: int = 1) -> None:
        """Remember a state that was sent to others, and those before it: they kept every rule."""
        self._good = state
        self._since += ticks

    def go_back(self, now_ns: int) -> T:
        """Return the last state that was well; the start, if it was gone back to just now."""
        if self._since < self._calm:
            self._good = self._start
        self._since = 0
        self._until_ns, self.resting = now_ns + SILENCE_NS, True
        return self._good

    def rests(self, now_ns: int, begin: Callable[[], None]) -> bool:
        """Return whether it is silent at a time; call ``begin`` when that is over.

        What was heard meanwhile was for one that was not there, and counts no more.
        """
        # Time that was set back meanwhile prolongs nothing.
        if self.resting and not self._until_ns - SILENCE_NS <= now_ns < self._until_ns:
            self.resting = False
            begin()
        return self.resting
