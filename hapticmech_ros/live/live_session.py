# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A session in real time that people change while it runs. It knows no clock: time is given.

Ticks are never left out. What cannot be computed in time is done later; a session that is too far
behind goes on more slowly than real time, and says so.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import numpy as np

from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.live.commands import (
    Command,
    Drag,
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
)
from hapticmech_ros.live.grip import Dragging
from hapticmech_ros.live.state_bag import StateBag
from hapticmech_ros.loading import load_scene
from hapticmech_ros.session import Sample, Session

# Ticks that are computed at once take this long in real time (s); then commands are heard again.
AT_ONCE_S = 0.005
# What is behind by more than this (s) is not caught up.
MOST_BEHIND_S = 0.1
# Over which the real-time factor is taken, s.
FACTOR_WINDOW_S = 1.0
# What can be tuned while a session runs.
_GAINS = "controller."


class LiveSession:
    """A scene that runs, and can be dragged, tuned and exchanged.

    Args:
        asked: the scene.
        now: s, of the caller's clock.

    Attributes:
        session: of the scene as it is.

    Raises:
        HapticMechError: the scene is refused, or cannot begin.
    """

    def __init__(self, asked: Open, now: float) -> None:
        self._number = 0
        self._factor = 1.0
        self._error = ""
        self._paused, self._behind, self._steps = False, False, 0
        self._bag: StateBag | None = None
        self._begin(asked, {}, now)

    @property
    def opened(self) -> Opened:
        """What is told of the scene that runs."""
        scene = self.session.simulator.scene
        return Opened(self._number, self._asked, scene, scene.operational_point().name)

    @property
    def is_behind(self) -> bool:
        """Whether more ticks are due than were done."""
        return self._behind

    def take(self, command: Command, now: float) -> Report | None:
        """Do what is asked for at a time (s); return what is to be told of it, if anything is."""
        try:
            return self._take(command, now)
        except HapticMechError as error:
            return Failed(str(error))

    def advance(self, now: float) -> None:
        """Do ticks that are due at a time (s), as many as are computed at once.

        An error ends the session: it pauses, and says why.
        """
        self._dragging.expire(now)
        ticks, period = self._steps, self.session.period
        self._steps, self._behind = 0, False
        if not self._paused:
            due = int((now - self._anchor) / period + 1e-6) - self._done
            beyond = due - max(round(MOST_BEHIND_S / period), 1)
            if beyond > 0:
                self._anchor += beyond * period
                due -= beyond
            ticks = min(due, max(round(AT_ONCE_S / period), 1))
            self._behind = ticks < due
        if ticks > 0 and not self._error:
            try:
                self._tick(ticks)
            except HapticMechError as error:
                self._error, self._dragging.grip = str(error), None
                self._pause(True, now)
        self._measure(now)

    def state(self) -> LiveState:
        """Return what is seen now."""
        sample = self._sample
        device, acting = sample.device.pose, sample.acting
        state = LiveState(
            self._number,
            sample.time,
            self._paused,
            self._factor,
            np.array(sample.mechanism.q),
            sample.mechanism.active,
            np.array(sample.seen.numbers),
            sample.count,
            np.column_stack((device.rotation, device.translation)),
            np.array(sample.hand_wrench),
            np.array(acting[0]),
            np.array(acting[1]),
            np.array(sample.contact_wrench + sample.external_wrench),
            changed=tuple(_changes(self._tuned)),
            recording="" if self._bag is None else self._bag.folder,
            error=self._error,
        )
        return self._dragging.on(state)

    def close(self) -> None:
        """End a recording."""
        if self._bag is not None:
            self._bag.close()
        self._bag = None

    def _begin(self, asked: Open, tuned: dict[str, float], now: float) -> None:
        """Begin a scene with gains that were tuned; if it is refused, all is as it was."""
        scene = load_scene(asked.scene, changes=(*asked.changes, *_changes(tuned)))
        session = Session(scene)
        sample = session.tick()
        self.close()
        self.session: Session = session
        self._sample: Sample = sample
        self._asked, self._tuned = asked, tuned
        self._dragging = Dragging(session.simulator.mechanism, session.period, now)
        self._error, self._behind = "", False
        self._number += 1
        self._pause(False, now)

    def _take(self, command: Command, now: float) -> Report | None:
        if isinstance(command, Drag):
            self._dragging.drag_to(command, self._sample.analysis, now)
        elif isinstance(command, Release):
            self._dragging.grip = None
        elif isinstance(command, Pause):
            self._pause(command.paused or bool(self._error), now)
        elif isinstance(command, Step):
            self._steps += max(command.ticks, 0) if self._paused else 0
        elif isinstance(command, Tune):
            self._tune(command)
        elif isinstance(command, DragStiffness):
            self._dragging.stiffen(command.factor, self._sample.analysis)
        elif isinstance(command, SwitchClosure):
            self.session.switch_closure(command.name, command.closed)
        elif isinstance(command, Record):
            self._record(command.folder)
        elif isinstance(command, Hold):
            return self._hold(command.frame)
        elif isinstance(command, Reset):
            self._begin(self._asked, self._tuned, now)
            return self.opened
        else:
            self._begin(command, {}, now)
            return self.opened
        return None

    def _tune(self, command: Tune) -> None:
        if not command.key.startswith(_GAINS):
            raise InvalidInputError("key to tune", command.key, f"must begin with {_GAINS}")
        tuned = {**self._tuned, command.key: float(command.value)}
        self.session.tune(self.session.scene.with_(*_changes(tuned)).controller)
        self._tuned = tuned

    def _hold(self, frame: str) -> Opened:
        self.session.set_operational_point(frame)
        self._dragging.grip = None
        self._tick(1)
        self._number += 1
        return self.opened

    def _record(self, folder: str) -> None:
        self.close()
        if folder:
            self._bag = StateBag(folder, self.session.simulator.mechanism)

    def _pause(self, paused: bool, now: float) -> None:
        self._paused = paused
        self._anchor, self._done = now, 0
        self._steps = 0
        self._times: deque[tuple[float, float]] = deque([(now, self.session.time)])

    def _tick(self, ticks: int) -> None:
        """Do ticks, the last one with all that is seen."""
        dragging, session = self._dragging, self.session
        if dragging.grip is None and self._bag is None:
            if ticks > 1:
                session.run(ticks - 1, every=ticks)
            self._sample = session.tick()
            self._done += ticks
            return
        for _ in range(ticks):
            device, state = session.device, session.mechanism
            place, velocity = device.pose.translation, device.twist[:3]
            push, on_links = dragging.wrenches(place, velocity, state.q, state.v)
            self._sample = session.tick(hand_wrench=push, on_links=on_links)
            self._done += 1
            if self._bag is not None:
                self._add_to_bag(self._bag)

    def _add_to_bag(self, bag: StateBag) -> None:
        sample = self._sample
        contacts = np.zeros((len(self.session.scene.operational_points), 6))
        contacts[0] = sample.contact_wrench + sample.external_wrench
        mechanism = sample.mechanism
        try:
            bag.add(sample.time, mechanism.q, mechanism.v, mechanism.active, contacts)
        except HapticMechError:
            self.close()
            raise

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
