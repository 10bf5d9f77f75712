# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A session in real time that users change while it runs. It has no clock: time is an argument.

No tick is skipped. Late ticks are done later; a session that is too far behind runs slower than
real time, and reports that.

It records a bag of ``mechanism/state`` at every tick, as the nodes publish it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from hapticmech_ros.bag import BagWriter
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.live.commands import (
    Command,
    Drag,
    Draggable,
    DragStiffness,
    Failed,
    Hold,
    LiveState,
    Open,
    Opened,
    Pause,
    Record,
    Release,
    Report,
    Reset,
    Step,
    SwitchClosure,
    Tune,
    UserState,
)
from hapticmech_ros.live.grip import Dragging
from hapticmech_ros.live.settings import MOUSE_ALONE
from hapticmech_ros.loading import load_scene
from hapticmech_ros.mechanism.closures import flat_grasps
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import nanoseconds
from hapticmech_ros.scene.hand import ConstantWrenchHand, Hand, ScriptedHand
from hapticmech_ros.session import Sample, SharedSession
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.state import StateLayout, WireState
from hapticmech_ros.wire.topics import STATE, user_prefixes


def holding(hand: Hand | None, limit: float) -> str:
    """Return a description of the hand that holds a device while a mouse drags it.

    Args:
        hand: that holds it; None for none.
        limit: N, of the mouse's force.
    """
    if isinstance(hand, ScriptedHand):
        return f"a hand that pushes by {hand.file}"
    if hand is None or isinstance(hand, ConstantWrenchHand):
        force = 0.0 if hand is None else float(np.linalg.norm(hand.force))
        torque = 0.0 if hand is None else float(np.linalg.norm(hand.torque))
        if force == torque == 0.0:
            return MOUSE_ALONE
        return f"a hand that pushes with {force:.3g} N and {torque:.3g} N m"
    name = "an arm" if hand.kind == "arm" else "a spring"
    moves = any(any(way.xyz) or any(way.rotation) for way in hand.waypoints)
    itself = ", which moves by itself" if moves else ""
    most = 1e3 * limit / hand.stiffness
    return (
        f"{name} of {hand.stiffness:.3g} N/m{itself}: the mouse's {limit:.3g} N displace it by "
        f"{most:.3g} mm at most"
    )


_NAME = f"/{STATE.name}"


class StateBag(BagWriter):
    """A bag of a session's states that is being written.

    Args:
        folder: to make.
        session: whose states they are.

    Raises:
        BagError: as of :class:`~hapticmech_ros.bag.writer.BagWriter`.
    """

    def __init__(self, folder: str, session: SharedSession) -> None:
        self._mechanism = mechanism = session.simulator.mechanism
        self._layout = StateLayout(mechanism)
        self._messages = FlatArray(self._layout.fields, self._layout.bounds)
        super().__init__(folder)
        self.add_topic(_NAME, STATE.type, STATE.qos)

    def add(self, samples: Mapping[str, Sample]) -> None:
        """Add the state of a tick, with F_c at every operational point.

        Args:
            samples: of the tick, by the operational point of the user.

        Raises:
            BagError: it cannot be written.
            OutputError: numbers beyond the limits of the scene.
        """
        contacts = np.zeros((len(self._mechanism.point_names), 6))
        for point, one in samples.items():
            at = self._mechanism.point_index(point)
            contacts[at] = one.contact_wrench + one.external_wrench
        sample = next(iter(samples.values()))
        found, scene = sample.mechanism, self._mechanism.scene
        stamp_ns, commanded = nanoseconds(sample.time), (True,) * len(contacts)
        state = WireState(
            stamp_ns, found.active, found.q, found.v, contacts, flat_grasps(scene), commanded
        )
        self.write(_NAME, stamp_ns, self._messages.encode(self._layout.pack(state)))


# Real time (s) of ticks computed at once; then commands are received again.
AT_ONCE_S = 0.005
# A delay of more than this (s) is not caught up.
MOST_BEHIND_S = 0.1
# Over which the real-time factor is taken, s.
FACTOR_WINDOW_S = 1.0
# Prefix of keys that can be tuned while a session runs.
_GAINS = "controller."
# Gains that were changed: operational point of the user -> key -> value.
Tuned = dict[str, dict[str, float]]


class LiveSession:
    """A scene that runs, and can be dragged, tuned and exchanged.

    Args:
        asked: the scene.
        now: s, of the caller's clock.

    Attributes:
        session: of the scene as it is.
        is_behind: whether more ticks are due than were done.

    Raises:
        HapticMechError: the scene is refused, or cannot begin.
    """

    def __init__(self, asked: Open, now: float) -> None:
        self._number = 0
        self._factor = 1.0
        self._error = ""
        self._paused, self.is_behind, self._steps = False, False, 0
        self._bag: StateBag | None = None
        self._begin(asked, {}, now)

    @property
    def opened(self) -> Opened:
        """The report of the running scene."""
        scene = self.session.simulator.scene
        return Opened(self._number, self._asked, scene, self.session.points)

    def take(self, command: Command, now: float) -> Report | None:
        """Execute a command at a time (s); return a report of it, if any."""
        try:
            return self._take(command, now)
        except HapticMechError as error:
            return Failed(str(error))

    def advance(self, now: float) -> None:
        """Do ticks that are due at a time (s), as many as are computed at once.

        An error ends the session: it pauses, and reports why.
        """
        self._dragging.expire(now)
        ticks, period = self._steps, self.session.period
        self._steps, self.is_behind = 0, False
        if not self._paused:
            due = int((now - self._anchor) / period + 1e-6) - self._done
            beyond = due - max(round(MOST_BEHIND_S / period), 1)
            if beyond > 0:
                self._anchor += beyond * period
                due -= beyond
            ticks = min(due, max(round(AT_ONCE_S / period), 1))
            self.is_behind = ticks < due
        if ticks > 0 and not self._error:
            try:
                self._tick(ticks)
            except HapticMechError as error:
                self._error = str(error)
                self._dragging.release()
                self._pause(True, now)
        self._measure(now)

    def state(self) -> LiveState:
        """Return the present state."""
        sample = next(iter(self._samples.values()))
        return LiveState(
            self._number,
            sample.time,
            self._paused,
            self._factor,
            np.array(sample.mechanism.q),
            sample.mechanism.active,
            tuple(self._user_state(point, one) for point, one in self._samples.items()),
            self._dragging.states(),
            changed=self._changed(),
            recording="" if self._bag is None else str(self._bag.path),
            error=self._error,
        )

    def _user_state(self, point: str, sample: Sample) -> UserState:
        device, scene = sample.device.pose, self.session.user(point).scene
        on_hand, on_mechanism = sample.acting
        return UserState(
            point,
            np.array(sample.seen.numbers),
            sample.count,
            np.column_stack((device.rotation, device.translation)),
            np.array(sample.hand_wrench),
            np.array(on_hand),
            np.array(on_mechanism),
            np.array(sample.contact_wrench + sample.external_wrench),
            holding(scene.hand, scene.device.force_limit),
        )

    def close(self) -> None:
        """End a recording."""
        if self._bag is not None:
            self._bag.close()
        self._bag = None

    def _begin(self, asked: Open, tuned: Tuned, now: float) -> None:
        """Begin a scene with gains that were tuned; if it is refused, all is as it was."""
        scene = load_scene(asked.scene, changes=asked.changes)
        if tuned:
            places = {one.point: f"hands[{i}]." for i, one in enumerate(scene.hands)}
            changes = [(places.get(point, ""), _changes(own)) for point, own in tuned.items()]
            scene = scene.with_(*(place + one for place, own in changes for one in own))
        session = SharedSession(scene)
        samples = session.tick()
        self.close()
        self.session: SharedSession = session
        self._samples: dict[str, Sample] = samples
        self._asked, self._tuned = asked, tuned
        self._dragging = Dragging(
            session.simulator.mechanism,
            scene,
            session.points,
            session.period,
            lambda point: self._samples[point].analysis,
        )
        self._error, self.is_behind = "", False
        self._number += 1
        self._pause(False, now)

    def _take(self, command: Command, now: float) -> Report | None:
        match command:
            case Drag():
                self._dragging.drag_to(command, now)
            case Release():
                self._dragging.release(command.body)
            case Pause():
                self._pause(command.paused or bool(self._error), now)
            case Step():
                self._steps += max(command.ticks, 0) if self._paused else 0
            case Tune():
                self._tune(command)
            case DragStiffness():
                self._dragging.stiffen(command.factor)
            case SwitchClosure():
                self.session.switch_closure(command.name, command.closed)
            case Record():
                self._record(command.folder)
            case Hold():
                return self._hold(command)
            case Reset():
                self._begin(self._asked, self._tuned, now)
                return self.opened
            case Open():
                self._begin(command, {}, now)
                return self.opened
        return None

    def _tune(self, command: Tune) -> None:
        if not command.key.startswith(_GAINS):
            raise InvalidInputError("key to tune", command.key, f"must begin with {_GAINS}")
        user = self.session.user(command.point)
        own = {**self._tuned.get(command.point, {}), command.key: float(command.value)}
        user.tune(user.scene.with_(*_changes(own)).controller)
        self._tuned = {**self._tuned, command.point: own}

    def _hold(self, command: Hold) -> Opened:
        self.session.set_operational_point(command.point, command.frame)
        self._dragging.release(Draggable("hand", command.point))
        self._tick(1)
        self._number += 1
        return self.opened

    def _record(self, folder: str) -> None:
        self.close()
        if folder:
            self._bag = StateBag(folder, self.session)

    def _pause(self, paused: bool, now: float) -> None:
        self._paused = paused
        self._anchor, self._done = now, 0
        self._steps = 0
        self._times: deque[tuple[float, float]] = deque([(now, self.session.time)])

    def _tick(self, ticks: int) -> None:
        """Do ticks, the last one with all that is seen."""
        dragging, session = self._dragging, self.session
        if not dragging.grips and self._bag is None:
            if ticks > 1:
                session.run(ticks - 1, every=ticks)
            self._samples = session.tick()
            self._done += ticks
            return
        for _ in range(ticks):
            state = session.mechanism
            hands: dict[str, Array] = {}
            links: dict[str, Array] = {}
            for body, wrench in dragging.wrenches(self._devices(), (state.q, state.v)).items():
                (hands if body.kind == "hand" else links)[body.name] = wrench
            self._samples = session.tick(hand_wrenches=hands, on_links=links)
            self._done += 1
            if self._bag is not None:
                self._add_to(self._bag)

    def _devices(self) -> dict[str, tuple[Array, Array]]:
        """Return place (3,), m, and velocity (3,), m/s, world axes, of each device."""
        devices = {point: self.session.user(point).device for point in self.session.points}
        return {p: (one.pose.translation, one.twist[:3]) for p, one in devices.items()}

    def _add_to(self, bag: StateBag) -> None:
        try:
            bag.add(self._samples)
        except HapticMechError:
            self.close()
            raise

    def _changed(self) -> tuple[str, ...]:
        """Return tuned gains, each with its user where there are several."""
        prefixes = user_prefixes(self.session.points)
        return tuple(
            f"{prefixes[point]}{one}" for point, own in self._tuned.items() for one in _changes(own)
        )

    def _measure(self, now: float) -> None:
        """Find the real-time factor of the last second."""
        times = self._times
        times.append((now, self.session.time))
        while len(times) > 2 and now - times[1][0] >= FACTOR_WINDOW_S:
            times.popleft()
        (began, first), (ended, last) = times[0], times[-1]
        if self._paused:
            self._factor = 0.0
        elif ended > began:
            self._factor = (last - first) / (ended - began)


def _changes(tuned: Mapping[str, float]) -> list[str]:
    """Return gains as changes of a scene; YAML takes a number without a point for a text."""
    return [f"{key}={np.format_float_positional(value, trim='0')}" for key, value in tuned.items()]
