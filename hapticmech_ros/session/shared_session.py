# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several users on one mechanism: a device, a hand, an analysis and controllers each."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.other_hands import NO_OTHERS, OtherHands, received_directly
from hapticmech_ros.device import SimulatedDevice
from hapticmech_ros.errors import InvalidInputError, listed, nearest
from hapticmech_ros.mechanism.motion import NOTHING
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.times import nanoseconds
from hapticmech_ros.operational.analysis import ContactWrenches, by_others, coupling, transmission
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import Origin
from hapticmech_ros.session.sample import Run, Sample
from hapticmech_ros.session.session import (
    NO_RECORDS,
    Session,
    check_counts,
    checked_pushes,
    checked_wrench,
)
from hapticmech_ros.simulation import MechanismState, Simulator


class SharedSession:
    """A scene with several ``hands``, running.

    In each tick every user's device is sampled, and its controllers answer, at the same state of
    the mechanism; then all their wrenches move the mechanism. The others' wrenches are part of a
    user's F_c: the wrench at the own operational point that accelerates it as theirs do, X_ii F_c =
    Σ X_ij F_j (see :mod:`~hapticmech_ros.operational.analysis`). It has no part along directions
    that the joints constrain: there the joints stand between the hands.

    Args:
        scene: to run; each of its ``hands`` is a user.
        command_delay: as of :class:`~hapticmech_ros.session.session.Session`.
        controls: controllers other than the scene's, by operational point.
        devices: devices other than the scene's, likewise.

    Raises:
        InvalidInputError: a delay below 0; or controls or devices of a point that is not held.
    """

    def __init__(
        self,
        scene: Scene,
        command_delay: int = 1,
        controls: Mapping[str, ControlArchitecture] = MappingProxyType({}),
        devices: Mapping[str, SimulatedDevice] = MappingProxyType({}),
    ) -> None:
        self.scene = scene
        self.points = scene.held_points
        self._check_points("controls", controls)
        self._check_points("devices", devices)
        self.simulator = Simulator(scene)
        self.period = self.simulator.period
        self._users = {
            point: Session(
                scene,
                point,
                command_delay,
                controls.get(point),
                devices.get(point),
                self.simulator,
            )
            for point in self.points
        }
        mechanism = self.simulator.mechanism
        self._places = {point: mechanism.point_index(point) for point in self.points}
        self._state = self.simulator.initial_state()
        self._ticks = 0
        self._contact_wrenches = ContactWrenches(mechanism)
        # Of each user: C3 of the hands whose wrenches its device gets at once, their samples, and H
        # of the answers that do not act yet.
        self._direct = {
            point: {} if user.answers_in_python else received_directly(scene, point, self.points)
            for point, user in self._users.items()
        }
        self._period_ns, self._delay = nanoseconds(self.period), command_delay
        self._others = {p: OtherHands(self._direct[p], self._period_ns) for p in self.points}
        self._gains: dict[str, deque[dict[str, Array]]] = {p: deque() for p in self.points}

    def __repr__(self) -> str:
        return f"SharedSession of {self.scene.name} at {self.time:g} s, held at {self.points}"

    @property
    def time(self) -> float:
        """Time of the next tick, s."""
        return self._ticks * self.period

    @property
    def mechanism(self) -> MechanismState:
        """State of the mechanism at the next tick."""
        return self._state

    def user(self, point: str) -> Session:
        """Return the session of the user who holds a point: its device, account and gains.

        It is ticked by this one only.

        Raises:
            InvalidInputError: a point that is not held.
        """
        self._check_points("point", [point])
        return self._users[point]

    def tick(
        self,
        external_wrenches: Mapping[str, Array] = NOTHING,
        hand_wrenches: Mapping[str, Array] = NOTHING,
        on_links: Mapping[str, Array] = NOTHING,
    ) -> dict[str, Sample]:
        """Advance mechanism and devices by one period; return measurements and commands.

        Args:
            external_wrenches: (6,) by operational point that is held, on the mechanism, N and N m,
                world axes, held over the period.
            hand_wrenches: (6,) by point, on the device that holds it, likewise, beside its hand's.
            on_links: (6,) by link, on the mechanism at the link's frame, likewise.

        Returns:
            The sample of each user by its point; its ``external_wrench`` has the other hands' part
            of F_c in it.

        Raises:
            InvalidInputError: a point that is not held, an unknown link, or a wrench of another
                shape or not finite; nothing has moved then.
            ClosureError, InaccurateStepError: as of ``Session.tick``.
        """
        inputs = self._inputs(external_wrenches, hand_wrenches)
        pushed = checked_pushes(self.simulator, on_links)
        begun = {point: user.begun() for point, user in self._users.items()}
        self._advance(inputs, {}, pushed)
        return {point: user.sample(begun[point]) for point, user in self._users.items()}

    def run(self, ticks: int, every: int = 1) -> dict[str, Run]:
        """Do many ticks, and return each user's run, by its point.

        Args:
            ticks: how many.
            every: ticks from one row to the next.

        Raises:
            InvalidInputError: as :func:`~hapticmech_ros.session.session.check_counts`.
            ClosureError, InaccurateStepError: as of :meth:`tick`.
        """
        check_counts(ticks, every)
        most, filled, inputs = ticks // every + 1, 0, self._inputs(NOTHING, NOTHING)
        rows = {p: np.empty((most, user.layout.size)) for p, user in self._users.items()}
        for _ in range(ticks):
            kept = self._ticks % every == 0
            into = {p: of[filled : filled + 1] for p, of in rows.items()} if kept else {}
            self._advance(inputs, into)
            filled += kept
        return {
            point: Run(rows[point][:filled], user.layout) for point, user in self._users.items()
        }

    def set_operational_point(self, point: str, frame: str, origin: Origin | None = None) -> None:
        """Let a user hold the mechanism elsewhere from the next tick on, without a bump.

        Args:
            point: operational point that the user holds, and that goes there.
            frame: a link, or an operational point of the scene.
            origin: where in it; its own origin if left out.

        Raises:
            InvalidInputError: a point that is not held; and as
                :func:`~hapticmech_ros.mechanism.closures.grasped`.
        """
        self.user(point).set_operational_point(frame, origin)
        self._contact_wrenches = ContactWrenches(self.simulator.mechanism)
        # H of answers in flight is of the old place.
        for gains in self._gains.values():
            gains.clear()

    def switch_closure(self, name: str, closed: bool) -> None:
        """Open or close a loop between two ticks.

        Raises:
            InvalidInputError: unknown closure, or one too far open to be closed.
        """
        self._state = self.simulator.switch(self._state, {name: closed})
        for user in self._users.values():
            user.put(self._state)

    def _advance(
        self,
        inputs: Mapping[str, Array],
        records: Mapping[str, Array],
        on_links: Mapping[str, Array] = NOTHING,
    ) -> None:
        """Do a tick.

        Args:
            inputs: (1, 12) by point, see :meth:`_inputs`.
            records: (1, width) by point to fill; other points are not recorded.
            on_links: as of :meth:`tick`.
        """
        others, rows = self._by_others(), {}
        wrenches = np.zeros_like(others)
        for point, user in self._users.items():
            rows[point] = inputs[point].copy()
            rows[point][0, :6] += others[self._places[point]]
            self._command(point, user.sense(rows[point]))
        for point, user in self._users.items():
            at = self._places[point]
            record = records.get(point, NO_RECORDS)
            wrenches[at] = user.answer(rows[point], record, self._correction(point))
            wrenches[at] += inputs[point][0, :6]
        self._couple()
        self._state = self.simulator.step(self._state, wrenches, on_links)
        self._ticks += 1
        for user in self._users.values():
            user.go_on(self._state)

    def _command(self, point: str, wrench: Array) -> None:
        """Send a hand's wrench (6,) to the other users' devices, N and N m, world axes."""
        for known, names in zip(self._others.values(), self._direct.values(), strict=True):
            if point in names:
                known.measured(point, wrench, self._ticks * self._period_ns)

    def _correction(self, point: str) -> Array:
        """Return (19,) the correction of the command that acts now; see ``other_hands``."""
        gains = self._gains[point]
        if len(gains) < max(self._delay, 1):
            return NO_OTHERS
        now_ns = self._ticks * self._period_ns
        answered_ns = now_ns - self._delay * self._period_ns
        others = self._others[point]
        others.couple(gains[0], now_ns)
        return others.correction(answered_ns, now_ns)

    def _couple(self) -> None:
        """Find H of this tick's answers."""
        if not any(self._direct.values()):
            return
        coupled = coupling(self.simulator.evaluate(self._state))
        for point, user in self._users.items():
            analysis, row = user.analysis, coupled[self._places[point]]
            found = {
                name: user.coupling_gain(transmission(analysis, row[self._places[name]]), share)
                for name, share in self._direct[point].items()
            }
            self._gains[point].append(found)
            if len(self._gains[point]) > self._delay:
                self._gains[point].popleft()

    def _by_others(self) -> Array:
        """Return (points, 6) the last commands for the other hands, as part of F_c."""
        commanded = np.zeros((len(self.simulator.mechanism.point_names), 6))
        for point, user in self._users.items():
            commanded[self._places[point]] = user.answered
        if len(self._users) == 1 or not commanded.any():
            return np.zeros_like(commanded)
        terms = self.simulator.evaluate(self._state)
        return self._contact_wrenches.at(terms, by_others(terms, commanded))

    def _inputs(
        self, external: Mapping[str, Array], hands: Mapping[str, Array]
    ) -> dict[str, Array]:
        """Return (1, 12) by point: others' wrenches on mechanism and device.

        Raises:
            InvalidInputError: as :meth:`tick`.
        """
        inputs = {point: np.zeros((1, 12)) for point in self.points}
        given = (("external_wrenches", external, 0), ("hand_wrenches", hands, 6))
        for name, wrenches, first in given:
            self._check_points(name, wrenches)
            for point, wrench in wrenches.items():
                checked = checked_wrench(f"{name} at {point}", wrench, self.scene.limits)
                inputs[point][0, first : first + 6] = checked
        return inputs

    def _check_points(self, name: str, points: Mapping[str, object] | list[str]) -> None:
        """Check that points are held.

        Raises:
            InvalidInputError: one is not.
        """
        for point in points:
            if point not in self.points:
                rule = f"must be a point that is held, one of {listed(self.points)}"
                raise InvalidInputError(name, point, rule + nearest(point, self.points))
