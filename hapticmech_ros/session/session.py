# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Device, mechanism, analysis and control in one process, one tick at a time, without ROS.

The reference for the graph of nodes: same core objects, same order, no clock. Bitwise repeatable.

A tick is one call of a kernel, and so are many. What is written in Python, a device, a hand or a
control law, is called in its place, and the kernel does the rest of the tick around it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control import Clutch
from hapticmech_ros.control.loop_layout import ANSWER
from hapticmech_ros.control.passivity import PassivityController
from hapticmech_ros.control.rendering_controller import LedgerEntry, RenderingController
from hapticmech_ros.device.motion_check import MotionCheck
from hapticmech_ros.device.safety import SafetyEnvelope
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.layout import DEVICE_SAMPLE
from hapticmech_ros.mechanism.grasp import grasped
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene.controller import Controller
from hapticmech_ros.scene.limits import Limits
from hapticmech_ros.scene.mechanism import Origin
from hapticmech_ros.session.run import Run
from hapticmech_ros.session.sample import Sample
from hapticmech_ros.session.tick_kernels import RECORDED, TICK
from hapticmech_ros.session.user_loop import UserLoop

_FORCE, _WRENCHES = DEVICE_SAMPLE.slice("hand_wrench"), ANSWER.slice("wrenches")
_NO_RECORDS = np.zeros((0, 0))
# Wrenches by others in a tick without any.
_NOTHING = np.zeros((1, 12))
_NOTHING.flags.writeable = False


class Session(UserLoop):
    """A scene, running.

    Args:
        scene: what to run.
        point: operational point that the device holds; the first that is held if empty. Device,
            hand, gains and connection are its own where the scene has several ``hands``; of those
            at other points nothing is done, see :class:`.SharedSession`.
        command_delay: whole periods between measuring and acting. One is what the graph of nodes
            has: a command computed from this tick's measurements acts from the next tick on.
        control: controllers other than the scene's; None for the scene's.
        device: a device other than the scene's; None for the scene's.
        simulator: of the mechanism, where several sessions share one; made anew if None.

    Raises:
        InvalidInputError: a delay below 0, or no such operational point.
    """

    def __repr__(self) -> str:
        return f"Session of {self.scene.name} at {self.time:g} s"

    @property
    def clutch(self) -> Clutch | None:
        """The clutch; None before the first tick."""
        return self._clutch

    @property
    def energies(self) -> LedgerEntry:
        """The controllers' account; see :mod:`~hapticmech_ros.control.account_kernels`."""
        return self._side.entry

    @property
    def passivity(self) -> PassivityController:
        """The device's account."""
        return self._device_side.passivity

    @property
    def envelope(self) -> SafetyEnvelope:
        """The device's safety envelope."""
        return self._device_side.envelope

    @property
    def motion(self) -> MotionCheck | None:
        """What holds the samples of a device of one's own against each other; None for others."""
        return self._motion

    @property
    def controller(self) -> RenderingController:
        """The controllers' side of the loop."""
        return self._side

    @property
    def compensation(self) -> Array:
        """(6,) what the device's driver adds to the next tick's command, N and N m, world axes."""
        return self._device.compensation(self.device)

    def tune(self, gains: Controller) -> None:
        """Pass to other gains, without a bump, over their ``gain_ramp``."""
        self._control.tune(self.time, gains)

    def tick(
        self,
        external_wrench: Array | None = None,
        hand_wrench: Array | None = None,
        on_links: Mapping[str, Array] | None = None,
    ) -> Sample:
        """Advance mechanism and device by one period; return what was measured and commanded.

        Args:
            external_wrench: (6,) on the mechanism at the operational point, N and N m, world axes,
                held over the period; none if left out.
            hand_wrench: (6,) on the device at the point held, N and N m, world axes, beside the
                hand's own and held over the period; none if left out.
            on_links: (6,) by name of the link, on the mechanism at its frame's origin, N and N m,
                world axes, held over the period; none if left out. F_c has no part of them.

        Raises:
            ClosureError: a closed loop came apart.
            InaccurateStepError: a step's energy account is off by a tenth of what it exchanged.
            InvalidInputError: the state is no longer finite, an unknown link, or a wrench of
                another shape, not finite or beyond ``limits``; nothing has moved then.
        """
        pushed: dict[str, Array] = {}
        if on_links:
            for link, wrench in on_links.items():
                self.simulator.mechanism.link_place(link)
                pushed[link] = checked_wrench(f"wrench on {link}", wrench, self.scene.limits)
        inputs, limits = _NOTHING, self.scene.limits
        if external_wrench is not None or hand_wrench is not None:
            inputs = np.zeros((1, 12))
        if external_wrench is not None:
            inputs[0, :6] = checked_wrench("external_wrench", external_wrench, limits)
        if hand_wrench is not None:
            inputs[0, 6:] = checked_wrench("hand_wrench", hand_wrench, limits)
        begun = self.begun()
        if pushed:
            self._tick_pushed(inputs, _NO_RECORDS, pushed)
        else:
            self._go(1, inputs, _NO_RECORDS, 0)
        return self.sample(begun)

    def run(
        self,
        ticks: int,
        external_wrench: Array | None = None,
        hand_wrench: Array | None = None,
        every: int = 1,
        into: Array | None = None,
        show: Callable[[Run], None] | None = None,
        chunk: int = 1000,
    ) -> Run:
        """Do many ticks, and return what they went through; the same numbers as :meth:`tick`.

        Args:
            ticks: how many.
            external_wrench: as of :meth:`tick`: (6,) for all of them, or (ticks, 6).
            hand_wrench: (6,) or (ticks, 6), likewise.
            every: ticks from one row to the next; rows are of ticks whose number since the
                session's start is a multiple of it.
            into: (rows or more, width) float64 in C order to fill, such as a ``numpy.memmap``, with
                ``session.layout.size`` columns; made anew if left out.
            show: called with the rows that have come since the last call, every ``chunk`` ticks and
                at the end. If given, and ``into`` is not, rows are kept for one chunk only, and the
                last one is returned.
            chunk: ticks between calls of ``show``.

        Raises:
            ClosureError: a closed loop came apart.
            InaccurateStepError: a step's energy account is off by a tenth of what it exchanged.
            InvalidInputError: the state is no longer finite; fewer than 0 ticks, ``every`` or
                ``chunk`` below 1, or arrays of another shape, not finite or beyond ``limits``.
        """
        for name, value, least in (("ticks", ticks, 0), ("every", every, 1), ("chunk", chunk, 1)):
            if value < least:
                raise InvalidInputError(name, value, f"must be {least} or more")
        inputs = _inputs(ticks, external_wrench, hand_wrench, self.scene.limits)
        first = self._clock[TICK]
        apart = ticks if show is None else chunk
        rows = self._rows(into, first, ticks, apart if into is None else ticks, every)
        done, filled, shown = 0, 0, 0
        while done < ticks:
            count = min(apart, ticks - done)
            if show is not None and into is None:
                filled = shown = 0
            self._go(count, inputs[done:] if len(inputs) > 1 else inputs, rows[filled:], every)
            done += count
            filled += self._clock[RECORDED]
            if show is not None:
                show(Run(rows[shown:filled], self.layout))
                shown = filled
        return Run(rows[:filled], self.layout)

    def switch_closure(self, name: str, closed: bool) -> None:
        """Open or close a loop between two ticks.

        Raises:
            InvalidInputError: unknown closure, or one too far open to be closed.
        """
        self._begin(self.simulator.switch(self.mechanism, {name: closed}))

    def set_operational_point(self, frame: str, origin: Origin | None = None) -> None:
        """Hold the mechanism elsewhere from the next tick on, without a bump.

        The device's wrench is carried on and fades over the scene's ``grasp_ramp``, in which the
        new grasp closes; see :mod:`~hapticmech_ros.control.clutch`. What the hand did to
        the mechanism at the old place ends at once.

        Args:
            frame: a link, or an operational point of the scene.
            origin: where in it; its own origin if left out.

        Raises:
            InvalidInputError: as :func:`~hapticmech_ros.mechanism.grasp.grasped`.
        """
        point = grasped(self.simulator.scene, self._analyser.point.name, frame, origin)
        state = self.mechanism
        self.simulator.set_operational_point(point)
        self._analyser = Analyser(self.simulator.mechanism, point.name, self._compensated_delay)
        self._parts.metric[:] = self._analyser.constants
        self._side.held_elsewhere()
        self._carried = self._given[_WRENCHES][:6].copy()
        self._counter.begin()
        self._begin(state)

    def _rows(self, into: Array | None, first: int, ticks: int, at_once: int, every: int) -> Array:
        """Return rows to fill.

        Raises:
            InvalidInputError: what was given is not an array of that size.
        """
        width = self.layout.size
        if into is None:
            return np.empty((at_once // every + 1, width))
        needed = len(range(-first % every, ticks, every))
        fits = into.dtype == np.float64 and into.ndim == 2 and into.flags.c_contiguous
        if not (fits and into.shape[0] >= needed and into.shape[1] == width):
            rule = f"must be ({needed} or more, {width}) of float64 in C order"
            raise InvalidInputError("shape of into", into.shape, rule)
        return np.asarray(into)


def checked_wrench(name: str, given: Array, limits: Limits) -> Array:
    """Return a wrench (6,) as it was given.

    Args:
        name: of it, for errors.
        given: (6,) N and N m.
        limits: of the scene, as for messages.

    Raises:
        InvalidInputError: an array of another shape, NaN, infinity, or beyond the limits.
    """
    if np.shape(given) != (6,):
        raise InvalidInputError(f"shape of {name}", np.shape(given), "must be (6,)")
    return _bounded(name, given, limits)


def _bounded(name: str, given: Array, limits: Limits) -> Array:
    """Return wrenches (..., 6) as they were given.

    Raises:
        InvalidInputError: NaN, infinity, or beyond the limits.
    """
    most = (limits.force,) * 3 + (limits.torque,) * 3
    sound = np.abs(given) <= most
    if not sound.all():
        row = given if np.ndim(given) == 1 else given[int(np.argmin(sound.all(axis=-1)))]
        force, torque = f"{limits.force:g} N (limits.force)", f"{limits.torque:g} N m"
        rule = f"must be finite numbers, of at most {force} and {torque} (limits.torque)"
        raise InvalidInputError(name, np.asarray(row).tolist(), rule)
    return given


def _inputs(ticks: int, external: Array | None, push: Array | None, limits: Limits) -> Array:
    """Return (1 or ticks, 12) wrenches by others.

    Raises:
        InvalidInputError: an array of another shape, NaN, infinity, or beyond the limits.
    """
    given = [
        np.zeros(6) if one is None else np.asarray(one, dtype=float) for one in (external, push)
    ]
    for name, one in zip(("external_wrench", "hand_wrench"), given, strict=True):
        if one.shape not in ((6,), (ticks, 6)):
            raise InvalidInputError(f"shape of {name}", one.shape, f"must be (6,) or ({ticks}, 6)")
        _bounded(name, one, limits)
    rows = 1 if all(one.ndim == 1 for one in given) else ticks
    return np.hstack([np.broadcast_to(one, (rows, 6)) for one in given])
