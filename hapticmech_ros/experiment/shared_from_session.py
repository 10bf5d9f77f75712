# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The experiment of several users in one process: a record of a :class:`SharedSession`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.experiment.from_session import SessionRecorder, UnfinishedRunError, ticks_of
from hapticmech_ros.experiment.shared_record import COUPLING_PERIOD_S, SharedRecord, couplings
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Sample, SharedSession


def run_shared_session(
    scene: Scene,
    duration: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> SharedRecord:
    """Run a session of several users from engagement until a time after the first hand starts.

    Args:
        scene: with several ``hands``.
        duration: s after the first hand's start; by default that of the scene's experiment.
        progress: called with the share done, 0 to 1, about a hundred times.

    Returns:
        Record of the run.

    Raises:
        InvalidInputError: duration not positive.
        ClosureError: the loops cannot be closed at the start.
        UnfinishedRunError: an error ended the run, such as a loop that came apart.
    """
    ticks = min(ticks_of(scene.held_at(point), duration) for point in scene.held_points)
    recorder = _SharedRecorder(SharedSession(scene))
    for tick in range(ticks):
        try:
            recorder.tick()
        except HapticMechError as error:
            raise recorder.unfinished(error) from error
        done = tick + 1
        if progress is not None and (done % max(ticks // 100, 1) == 0 or done == ticks):
            progress(done / ticks)
    return recorder.record()


class _SharedRecorder:
    """Ticks a session and collects its samples."""

    def __init__(self, session: SharedSession) -> None:
        self._session = session
        self._recorders = {
            point: SessionRecorder(session.user(point), point) for point in session.points
        }
        self._kept: list[dict[str, Sample]] = []
        self._ticks, self._every = 0, max(round(COUPLING_PERIOD_S / session.period), 1)

    def tick(self) -> None:
        samples = self._session.tick()
        for point, sample in samples.items():
            self._recorders[point].add(sample)
        if self._ticks % self._every == 0:
            self._kept.append(samples)
        self._ticks += 1

    def record(self) -> SharedRecord:
        zero = min(recorder.started for recorder in self._recorders.values())
        states = [next(iter(samples.values())).mechanism for samples in self._kept]
        return SharedRecord(
            {point: recorder.record(zero) for point, recorder in self._recorders.items()},
            np.array([state.time for state in states]) - zero,
            np.array([[sample.acting[1] for sample in row.values()] for row in self._kept]),
            np.array([[sample.external_wrench for sample in row.values()] for row in self._kept]),
            couplings(
                self._session.simulator.mechanism,
                self._session.points,
                np.array([state.q for state in states]),
                [state.active for state in states],
            ),
        )

    def unfinished(self, error: HapticMechError) -> UnfinishedRunError:
        """Return the error of a run that another one ended, with what there was until then."""
        found = next(iter(self._recorders.values())).unfinished(error)
        found.record = self.record() if self._kept else None
        return found
