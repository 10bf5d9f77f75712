# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sessions of scenes from their start, and what tests ask of them as arrays."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin

from hapticmech_ros import Session, load_scene
from hapticmech_ros.control.clutch import engage
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Sample

Array = np.ndarray


class SessionRun:
    """All samples of a session."""

    def __init__(self, scene: Scene, duration: float | None = None, command_delay: int = 1) -> None:
        self.session = Session(scene, command_delay=command_delay)
        span = duration or scene.hand.start_delay + scene.experiment.duration
        self.samples = [self.session.tick() for _ in range(round(span / self.session.period))]
        self.time = self.of(lambda s: s.time)
        self.count = self.of(lambda s: s.count)

    def of(self, what: Callable[[Sample], Any]) -> Array:
        """Return one value of each sample."""
        return np.array([what(sample) for sample in self.samples])

    @property
    def changes(self) -> list[tuple[float, int, int]]:
        """Return (time, count before, count after) of every change of the count."""
        where = np.flatnonzero(np.diff(self.count)) + 1
        return [(self.time[i], self.count[i - 1], self.count[i]) for i in where]

    def at(self, time: float) -> Sample:
        """Return the sample at a time, s."""
        return self.samples[round(time / self.session.period)]

    def held(self) -> Array:
        """Return kinetic and potential energy, and what contacts hold, J."""
        energy = self.session.simulator.mechanism.energy
        return self.of(
            lambda s: sum(energy(s.mechanism.q, s.mechanism.v)) + s.mechanism.account.contact_energy
        )

    def work(self) -> Array:
        """Return the work done on the mechanism, J."""
        return self.of(lambda s: s.mechanism.account.work_in)

    def lost(self) -> Array:
        """Return energy lost in damping, latches and contacts, J."""

        def losses(sample: Sample) -> float:
            account = sample.mechanism.account
            return account.damping_loss + account.latch_loss + account.contact_loss

        return self.of(losses)


@cache
def whole(name: str, duration: float | None = None) -> SessionRun:
    """Return the experiment of a shipped scene, or so much (s) of it."""
    return SessionRun(load_scene(name), duration)


def take_hold_beside(session: Session, pose: pin.SE3) -> None:
    """Put a new session's device elsewhere, tied as if it had stayed with the mechanism."""
    start = session.device.pose
    session._clutch = engage(0.0, start, start)
    moved = session._device.at_rest(pose)
    session._parts.state[:] = moved.flat
    session._device_state = moved
