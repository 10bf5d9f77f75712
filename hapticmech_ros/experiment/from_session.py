# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The experiment in one process: a record of a :class:`Session`, or of several users'."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hapticmech_ros.errors import (
    HapticMechError,
    InaccurateStepError,
    InvalidInputError,
    check_positive,
)
from hapticmech_ros.experiment.record import (
    COUPLING_PERIOD_S,
    ExperimentRecord,
    SharedRecord,
    couplings,
    first_push,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.quaternions import quaternion_of
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Sample, Session, SharedSession
from hapticmech_ros.simulation import MechanismState


class UnfinishedRunError(HapticMechError):
    """A run that an error ended.

    Attributes:
        record: of the run until then, of one user or several; None if there was no tick.
        time: of the session when it happened, s.
        joint: whose rate changed most in the step that failed, or else is largest in the last
            state, rad/s or m/s; empty in a mechanism without joints.
        positions, velocities: of the last state within the scene's limits of numbers, by joint, as
            a scene's ``initial_state`` has them.
        good_time: of that state, s.
    """

    def __init__(
        self,
        error: HapticMechError,
        record: ExperimentRecord | SharedRecord | None,
        time: float,
        joint: str,
        positions: dict[str, list[float]],
        velocities: dict[str, list[float]],
        good_time: float,
    ) -> None:
        self.record, self.time, self.joint = record, time, joint
        self.positions, self.velocities, self.good_time = positions, velocities, good_time
        super().__init__(f"at {time:g} s: {error}")


def run_session(
    scene: Scene,
    duration: float | None = None,
    progress: Callable[[float], None] | None = None,
    point: str = "",
) -> ExperimentRecord:
    """Run a session from engagement until ``duration`` after the hand starts.

    Args:
        scene: to run.
        duration: s after the hand's start; by default that of the scene's experiment.
        progress: called with the share done, 0 to 1, about a hundred times.
        point: operational point that the device holds; the scene's first one if empty.

    Returns:
        Record of the run.

    Raises:
        InvalidInputError: duration not positive, unknown point.
        ClosureError: the loops cannot be closed at the start.
        UnfinishedRunError: an error ended the run, such as a loop that came apart.
    """
    session = Session(scene, point)
    recorder = SessionRecorder(session, point)
    ticks = ticks_of(session.scene, duration)
    _run(lambda: recorder.add(session.tick()), recorder, ticks, progress)
    return recorder.record()


def _run(
    tick: Callable[[], None],
    recorder: SessionRecorder | _SharedRecorder,
    ticks: int,
    progress: Callable[[float], None] | None,
) -> None:
    """Make the ticks of a run.

    Raises:
        UnfinishedRunError: an error ended it.
    """
    for done in range(1, ticks + 1):
        try:
            tick()
        except HapticMechError as error:
            raise recorder.unfinished(error) from error
        if progress is not None and (done % max(ticks // 100, 1) == 0 or done == ticks):
            progress(done / ticks)


def ticks_of(scene: Scene, duration: float | None) -> int:
    """Return how many ticks a run takes from engagement on.

    Args:
        scene: of the run, as its user has it.
        duration: s after the hand's start; that of the scene's experiment if None.

    Raises:
        InvalidInputError: duration not positive.
    """
    lasting = scene.experiment.duration if duration is None else float(duration)
    check_positive(duration=lasting)
    return round((scene.hand.start_delay + lasting) / scene.simulation.period) + 1


class SessionRecorder:
    """Collects the samples of a session whose ticks are made elsewhere."""

    def __init__(self, session: Session, point: str = "") -> None:
        self._session = session
        self._scene = session.scene
        self._point = session.scene.operational_point(point).name
        self._rows: dict[str, list[Array | float]] = {}
        self._good = session.mechanism

    def add(self, sample: Sample) -> None:
        """Add a sample, which must be the session's latest."""
        mechanism, analysis = sample.mechanism, sample.analysis
        if self._is_good(mechanism):
            self._good = mechanism
        kinetic, potential = self._session.simulator.mechanism.energy(mechanism.q, mechanism.v)
        beta = self._scene.controller.joint_constraint.feedforward
        device, point = sample.device.measured_pose, sample.point.pose
        values: dict[str, Array | float] = {
            "time": sample.time,
            "device_position": device.translation.copy(),
            "device_orientation": quaternion_of(device.rotation),
            "point_position": point.translation.copy(),
            "point_orientation": quaternion_of(point.rotation),
            "hand_wrench": sample.hand_wrench,
            "constraint_wrench": sample.output.joint_constraint,
            "count": sample.count,
            "s": analysis.spectrum.s,
            "expected_wrench": (beta - 1.0) * (analysis.wrench_projector @ sample.hand_wrench),
            "kinetic": kinetic,
            "potential": potential + mechanism.account.contact_energy,
            "work_in": mechanism.account.work_in,
            "damping_loss": mechanism.account.damping_loss + mechanism.account.contact_loss,
            "latch_loss": mechanism.account.latch_loss,
            "closure_error": mechanism.closure_error,
            "surplus": mechanism.account.surplus,
            "refined": mechanism.account.refined,
            "inaccurate": mechanism.account.inaccurate,
            "joint_positions": mechanism.q,
        }
        for name, value in values.items():
            self._rows.setdefault(name, []).append(value)

    def unfinished(self, error: HapticMechError) -> UnfinishedRunError:
        """Return the error of a run that another error ended, with the record until then."""
        mechanism, state = self._session.simulator.mechanism, self._session.mechanism
        good = state if self._is_good(state) else self._good
        positions, velocities, rates = {}, {}, {}
        for joint in mechanism.tree.joint_names:
            in_q, in_v = mechanism.joint_slices(joint)
            positions[joint] = good.q[in_q].tolist()
            velocities[joint] = good.v[in_v].tolist()
            rates[joint] = float(np.abs(state.v[in_v]).max())
        fastest = max(rates, key=rates.__getitem__, default="")
        joint = error.joint if isinstance(error, InaccurateStepError) else fastest
        record, time = self.record() if self._rows else None, self._session.time
        return UnfinishedRunError(error, record, time, joint, positions, velocities, good.time)

    def _is_good(self, state: MechanismState) -> bool:
        """Return whether numbers of a state are within the limits of the scene's messages."""
        limits = self._scene.limits
        return bool(
            (np.abs(state.q) <= limits.joint_position).all()
            and (np.abs(state.v) <= limits.joint_velocity).all()
        )

    @property
    def started(self) -> float:
        """Time of the session, s, of the first push, or else of the hand's start."""
        # An estimate is never zero, and without a sensor pushes are unknown.
        measured = self._scene.device.force_sensor == "measured"
        push = first_push(np.array(self._rows["hand_wrench"])) if measured else None
        return self._scene.hand.start_delay if push is None else float(self._rows["time"][push])

    def record(self, started: float | None = None) -> ExperimentRecord:
        """Return the record of the collected samples.

        Args:
            started: time of the session, s, that is the record's zero; :attr:`started` if None.

        Raises:
            InvalidInputError: there are none.
        """
        if not self._rows:
            raise InvalidInputError("samples", 0, "must be at least one")
        zero = self.started if started is None else started
        arrays: dict[str, Any] = {name: np.array(rows) for name, rows in self._rows.items()}
        times = arrays.pop("time") - zero
        return ExperimentRecord(
            scene=self._scene.name,
            point=self._point,
            source="session",
            period=self._session.period,
            times=times,
            wrench_times=times,
            analysis_times=times,
            energy_times=times,
            joint_times=times,
            **arrays,
        )


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
    _run(recorder.tick, recorder, ticks, progress)
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
        """Return the error of a run that another error ended, with the record until then."""
        found = next(iter(self._recorders.values())).unfinished(error)
        found.record = self.record() if self._kept else None
        return found
