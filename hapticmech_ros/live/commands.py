# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Commands from the page to the process that runs the session, and its reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, get_args

from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene


class Draggable(NamedTuple):
    """A draggable body: the device in a user's hand, or a link.

    Attributes:
        kind: which of them.
        name: of the operational point that the hand holds, or of the link.
    """

    kind: Literal["hand", "link"]
    name: str


@dataclass(frozen=True, slots=True)
class Drag:
    """A spring pulls a body to a place, until another command or a timeout.

    Several bodies may be dragged at once, each to a place of its own.

    Attributes:
        body: that is pulled.
        grip: (3,) where, in the link's frame, m; unused for a hand.
        goal: (3,) to where, m, world axes.
    """

    body: Draggable
    grip: Array
    goal: Array


@dataclass(frozen=True, slots=True)
class Release:
    """A body is dragged no more.

    Attributes:
        body: which.
    """

    body: Draggable


@dataclass(frozen=True, slots=True)
class Pause:
    """Stop, or go on.

    Attributes:
        paused: whether to stop.
    """

    paused: bool


@dataclass(frozen=True, slots=True)
class Step:
    """Go on by some ticks while paused.

    Attributes:
        ticks: how many.
    """

    ticks: int = 1


@dataclass(frozen=True, slots=True)
class Reset:
    """Begin anew at the scene's start, with the changes that were made."""


@dataclass(frozen=True, slots=True)
class Tune:
    """Another value of a user's gain.

    Attributes:
        point: operational point that the user holds.
        key: of the scene as it is for that user, such as
            ``controller.joint_constraint.stiffness``.
        value: in the key's unit.
    """

    point: str
    key: str
    value: float


@dataclass(frozen=True, slots=True)
class DragStiffness:
    """Stiffness of the spring that drags.

    Attributes:
        factor: times the stiffness chosen for each dragged body.
    """

    factor: float


@dataclass(frozen=True, slots=True)
class SwitchClosure:
    """Open or close a loop.

    Attributes:
        name: of the closure.
        closed: whether it is to be closed.
    """

    name: str
    closed: bool


@dataclass(frozen=True, slots=True)
class Hold:
    """A user holds the mechanism elsewhere.

    Attributes:
        point: operational point that the user holds, and that goes there.
        frame: a link, or an operational point.
    """

    point: str
    frame: str


@dataclass(frozen=True, slots=True)
class Open:
    """Begin a scene.

    Attributes:
        scene: name of a shipped one, or a path.
        changes: ``key=value`` each; see :func:`~hapticmech_ros.scene.validation.with_changes`.
    """

    scene: str
    changes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Record:
    """Record from now on, or no more.

    Attributes:
        folder: of the bag, which must not exist; empty: end the recording.
    """

    folder: str


Command = (
    Drag
    | Release
    | Pause
    | Step
    | Reset
    | Tune
    | DragStiffness
    | SwitchClosure
    | Hold
    | Open
    | Record
)
COMMANDS: frozenset[type] = frozenset(get_args(Command))


@dataclass(frozen=True, slots=True)
class Opened:
    """A scene has begun, or is held elsewhere: later reports are of this one.

    Attributes:
        number: of openings; of states the same.
        asked: the request.
        scene: as it is.
        users: operational points that are held, one by each user.
    """

    number: int
    asked: Open
    scene: Scene
    users: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Failed:
    """A request was refused; nothing has changed.

    Attributes:
        reason: for people.
    """

    reason: str


@dataclass(frozen=True, slots=True)
class UserState:
    """A user's state at a time, for the page.

    Attributes:
        point: operational point that is held.
        observation: of that point; see
            :func:`~hapticmech_ros.operational.observe_kernels.observation_size`.
        count: joint constraints felt.
        device: (3, 4) rotation and position (m) of the device in the world.
        hand_wrench: (6,) on the device, by the hand and the mouse, N and N m, world axes.
        on_hand: (6,) by the device, likewise.
        on_mechanism: (6,) at the point held, by the hand through the controller, likewise.
        contact: (6,) F_c at the point held, likewise.
        holding: description of the hand that holds the device besides the mouse.
        immovable: why the mouse cannot drag it; empty if it can.
    """

    point: str
    observation: Array
    count: int
    device: Array
    hand_wrench: Array
    on_hand: Array
    on_mechanism: Array
    contact: Array
    holding: str = ""
    immovable: str = ""


@dataclass(frozen=True, slots=True)
class DragState:
    """A drag as it is at a time.

    Attributes:
        body: that is dragged.
        force: (3,) of the spring that drags, N, world axes.
        grip: (3,) where it acts, m, world axes.
        goal: (3,) to where it is pulled, m, world axes.
        goal_at: s of the process's clock, since when it is pulled there.
    """

    body: Draggable
    force: Array
    grip: Array
    goal: Array
    goal_at: float


@dataclass(frozen=True, slots=True)
class LiveState:
    """The session's state at a time, for the page.

    Attributes:
        number: of the opening that it is of.
        time: of the session, s.
        paused: whether it stands still.
        factor: simulated over real time, over the last second; 0 while it stands still.
        q: (nq,) configuration.
        active: per closure, whether it is closed.
        users: who hold the mechanism, in the order of ``Opened.users``.
        drags: of dragged bodies, in the order of grabbing.
        changed: tuned gains, ``key=value`` each.
        recording: folder of the bag that is recorded; empty for none.
        error: that ended the session; empty while it runs.
        told: a running graph's rate, or its topics that are not received; empty for a session.
    """

    number: int
    time: float
    paused: bool
    factor: float
    q: Array
    active: Active
    users: tuple[UserState, ...]
    drags: tuple[DragState, ...] = ()
    changed: tuple[str, ...] = ()
    recording: str = ""
    error: str = ""
    told: str = ""

    def user(self, point: str) -> UserState:
        """Return the user who holds an operational point."""
        return next(user for user in self.users if user.point == point)


Report = Opened | Failed | LiveState


class Backend(Protocol):
    """The session or graph behind a page; may be used from several threads.

    Attributes:
        takes: the commands of :data:`COMMANDS` that it obeys; the page has no controls for others.
    """

    @property
    def takes(self) -> frozenset[type]:
        """Commands that it obeys."""

    def send(self, command: Command) -> None:
        """Send a command without waiting."""

    def news(self, timeout_s: float) -> list[Report]:
        """Return its reports: of states only the newest, the others in their order.

        Args:
            timeout_s: how long to wait for anything.

        Raises:
            HapticMechError: it has ended.
        """


def newest(reports: Sequence[Report]) -> list[Report]:
    """Return reports in their order, of states only the last one."""
    states = [one for one in reports if isinstance(one, LiveState)]
    return [one for one in reports if not isinstance(one, LiveState) or one is states[-1]]
