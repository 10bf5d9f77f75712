# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a session measured and commanded in one tick."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control import ControlOutput, OperationalModel
from hapticmech_ros.control.loop_layout import ANSWER
from hapticmech_ros.control.measurements import model_of
from hapticmech_ros.device import DeviceState
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL
from hapticmech_ros.mechanism import PointKinematics
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.observation import Observation
from hapticmech_ros.session.data import TOTALS, SessionData
from hapticmech_ros.session.run import CONTROL, column_names
from hapticmech_ros.simulation.simulator import EnergyAccount, MechanismState

if TYPE_CHECKING:
    from hapticmech_ros.contact.memory import Touching

_FORCE, _WRENCHES = DEVICE_SAMPLE.slice("hand_wrench"), ANSWER.slice("wrenches")
_CONSTRAINTS = TOTALS.start("constraints")


def totals_of(state: MechanismState, constraints: float = 0.0) -> tuple[float, ...]:
    """Return what kernels add up; see :data:`~hapticmech_ros.session.data.TOTALS`.

    Args:
        state: of the mechanism, to begin with.
        constraints: joint constraints reported.
    """
    a = state.account
    return (
        *(state.time, a.work_in, a.damping_loss, state.closure_error, constraints),
        *(a.contact_loss, a.contact_energy, a.surplus),
        *(a.refined, a.inaccurate, a.latch_loss, a.moved, a.contact_most),
    )


class LeftState(NamedTuple):
    """A mechanism's state as a kernel left it.

    Attributes:
        known: the last state before that was known as such.
        totals: (13,) see :data:`~hapticmech_ros.session.data.TOTALS`.
        q, v: configuration (nq,) and rates (nv,).
        touching: points of contact; None in a scene without.
    """

    known: MechanismState
    totals: Array
    q: Array
    v: Array
    touching: Touching | None = None

    def state(self) -> MechanismState:
        """Return the state; q and v can be written no more."""
        before = self.known
        totals = dict(zip(TOTALS, self.totals.tolist(), strict=True))
        self.q.flags.writeable = self.v.flags.writeable = False
        return MechanismState(
            totals["time"],
            self.q,
            self.v,
            before.active,
            totals["closure_error"],
            EnergyAccount(
                work_in=totals["work_in"],
                damping_loss=totals["damping_loss"],
                latch_loss=totals["latch_loss"],
                contact_loss=totals["contact_loss"],
                contact_energy=totals["contact_energy"],
                surplus=totals["surplus"],
                refined=int(totals["refined"]),
                inaccurate=int(totals["inaccurate"]),
                moved=totals["moved"],
                contact_most=totals["contact_most"],
            ),
            self.touching,
            before.released,
        )


class Sample:
    """All that was measured and commanded in one tick, at its start.

    Args:
        time: s since the session's start; the device is engaged at time 0.
        numbers: of the session's data, whole ones.
        values: of the session's data after the tick, as no tick will change them.
        analyser: of the operational point.
        mechanism: its state at ``time``, or the last one that was known as such before, and the
            points of contact.
        device: its state at ``time``, if it is known as such.
    """

    __slots__ = ("_analyser", "_device", "_mechanism", "_numbers", "_seen", "_values", "time")

    def __init__(
        self,
        time: float,
        numbers: Array,
        values: Array,
        analyser: Analyser,
        mechanism: MechanismState | tuple[MechanismState, Touching | None],
        device: DeviceState | None,
    ) -> None:
        # A session that is ticked makes one each time: what is not asked for is not made.
        self.time, self._numbers, self._values = time, numbers, values
        self._analyser, self._mechanism, self._device = analyser, mechanism, device
        self._seen: Observation | None = None

    def __repr__(self) -> str:
        return f"Sample at {self.time:g} s: {self.count} joint constraints"

    def columns(self) -> dict[str, float]:
        """Return the numbers of the sample by the names that columns of a run have.

        Those of a :class:`~hapticmech_ros.session.run.Run` but the true state of the device, what
        its actuators do, and energies: for ``pandas.DataFrame``, which takes a list of them.
        """
        state, sample = self.mechanism, self._data.sample
        on_hand, on_mechanism = self.acting
        model = self.seen.model
        fields = {
            "time": np.array([self.time]),
            "q": state.q,
            "v": state.v,
            **{f"device_{name}": sample[DEVICE_SAMPLE.slice(name)] for name in DEVICE_SAMPLE},
            **{name: model[OPERATIONAL_MODEL.slice(name)] for name in OPERATIONAL_MODEL},
            **dict(zip((*CONTROL, "pose_error"), self.wrenches, strict=True)),
            "on_hand": on_hand,
            "on_mechanism": on_mechanism,
            "external": self.external_wrench,
            "count": np.array([float(self.count)]),
        }
        return {
            column: float(number)
            for name, values in fields.items()
            for column, number in zip(column_names(name, values.size), values, strict=True)
        }

    def to_numpy(self) -> Array:
        """Return the numbers of :meth:`columns` (n,), in their order."""
        return np.array(list(self.columns().values()))

    @property
    def _data(self) -> SessionData:
        return SessionData(self._numbers, self._values)

    @property
    def device(self) -> DeviceState:
        """State of the device at ``time``."""
        if self._device is None:
            self._device = DeviceState(self._data.began_state)
        return self._device

    @property
    def mechanism(self) -> MechanismState:
        """State of the mechanism at ``time``."""
        if isinstance(self._mechanism, tuple):
            data, (known, touching) = self._data, self._mechanism
            parts = data.began_totals, data.began_q, data.began_v
            self._mechanism = LeftState(known, *parts, touching).state()
        return self._mechanism

    @property
    def seen(self) -> Observation:
        """The operational point there: its motion, Λ_h⁻¹ and what follows."""
        if self._seen is None:
            data, analyser = self._data, self._analyser
            self._seen = Observation(data.observation, analyser.layout, analyser.rows, data.v.size)
        return self._seen

    @property
    def hand_wrench(self) -> Array:
        """(6,) F_h on the device, by the hand and by others, as reported; N and N m, world axes."""
        return self._data.sample[_FORCE]

    @property
    def external_wrench(self) -> Array:
        """(6,) on the mechanism at the operational point, by others; N and N m, world axes."""
        return self._data.external

    @property
    def contact_wrench(self) -> Array:
        """(6,) part of F_c by virtual objects in the last step, N, N m, world axes; or zero."""
        return self._data.contact

    @property
    def count(self) -> int:
        """Joint constraints reported."""
        return int(self._data.totals[_CONSTRAINTS])

    @property
    def wrenches(self) -> Array:
        """(6, 6) of the last answer that arrived; rows and units of :class:`ControlOutput`."""
        data = self._data
        given = data.given if data.connected else data.answers[-1]
        return given[_WRENCHES].reshape(6, 6)

    @property
    def acting(self) -> Array:
        """(2, 6) wrenches over the period that begins, N and N m, world axes.

        On the hand by the device, and on the mechanism by the hand.
        """
        return self._data.wrenches[:2]

    @property
    def point(self) -> PointKinematics:
        """The operational point's kinematics."""
        return self.seen.point

    @property
    def analysis(self) -> OperationalAnalysis:
        """Λ_h⁻¹ and what follows from it."""
        return self.seen.analysis

    @property
    def output(self) -> ControlOutput:
        """The controllers' wrenches."""
        return ControlOutput(*self.wrenches)

    @property
    def model(self) -> OperationalModel:
        """What of the analysis they were computed with: X and a_0 as late as the loop is."""
        return model_of(self.seen.model)
