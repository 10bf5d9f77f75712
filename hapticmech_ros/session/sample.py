# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A session's measurements and commands: of one tick, and of many as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from hapticmech_ros.compilation.records import Field, Layout
from hapticmech_ros.control import ControlOutput, OperationalModel
from hapticmech_ros.control.loop_layout import ActingWrenches, Answer
from hapticmech_ros.control.measurements import model_of
from hapticmech_ros.device import DeviceState
from hapticmech_ros.mechanism import PointKinematics
from hapticmech_ros.numerics import Array
from hapticmech_ros.numerics.layout import TWIST, WRENCH, DeviceSample, OperationalModelSample
from hapticmech_ros.operational import Analyser, OperationalAnalysis
from hapticmech_ros.operational.observation import Observation
from hapticmech_ros.session.tick_kernels import SessionData, SessionTotals
from hapticmech_ros.simulation.simulator import EnergyAccount, MechanismState

if TYPE_CHECKING:
    from hapticmech_ros.contact.memory import Touching

ENERGIES = ("to_mechanism", "stored", "injected", "dissipated", "actuators")
SCALARS = frozenset(("time", *ENERGIES, "count"))
ONE, FORCE = Field(1), Field(6, WRENCH)
POSE_ERROR = ("position",) * 3 + ("angle",) * 3
# Letters of names of fields that a repr shows.
REPR_NAMES = 60
_ACCOUNT = tuple(field.name for field in fields(EnergyAccount))
# Rows of a ControlOutput, and then its pose error.
CONTROL = ("device_command", "mechanism_command", "impedance", "joint_constraint", "four_channel")


def run_layout(nq: int, nv: int) -> Layout:
    """Return how a row of a run is laid out: all that was measured and commanded in one tick.

    Time, s; q and v of the mechanism; the device's sample, the wrench applied until then, and its
    driver's addition to the next one; the simulated device's true pose, rotation row by row, and
    its true motion; the operational model; wrenches of the controllers and their pose error, see
    :class:`~hapticmech_ros.control.measurements.ControlOutput`; the wrenches that act from then on,
    on the hand by the device and on the mechanism by the hand; others' wrench on the mechanism at
    the operational point; energies of the controllers and of the device, J, see docs/passivity.md;
    and the number of joint constraints reported.

    Args:
        nq: numbers of a configuration.
        nv: number of rates.
    """
    return Layout(
        {
            "time": ONE,
            "q": Field(nq),
            "v": Field(nv),
            **{f"device_{name}": field for name, field in DeviceSample.layout.fields.items()},
            "device_applied": FORCE,
            "device_added": FORCE,
            "device_true_position": Field(3),
            "device_true_rotation": Field(9),
            "device_true_twist": Field(6, TWIST),
            **OperationalModelSample.layout.fields,
            **dict.fromkeys(CONTROL, FORCE),
            "pose_error": Field(6, POSE_ERROR),
            "on_hand": FORCE,
            "on_mechanism": FORCE,
            "external": FORCE,
            **dict.fromkeys(ENERGIES, ONE),
            "count": ONE,
        }
    )


class Run:
    """Ticks of a session, one a row.

    ``run["twist"]`` is (k, 6), and so for every name of the layout; times, energies and the count
    are (k,).

    Args:
        rows: (k, ...) all of it.
        layout: of a row, see :func:`run_layout`.

    Attributes:
        rows, layout: these.
    """

    def __init__(self, rows: Array, layout: Layout) -> None:
        self.rows, self.layout = rows, layout

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, name: str) -> Array:
        """Return a field (k, n), or (k,), a view.

        Raises:
            KeyError: no such field; it names those that there are.
        """
        if name not in self.layout:
            raise KeyError(f"{name}: must be one of {', '.join(self.layout)}")
        found = self.rows[:, self.layout.slice(name)]
        return found[:, 0] if name in SCALARS else found

    def __repr__(self) -> str:
        if not len(self):
            return "Run of no ticks"
        first, last = self["time"][[0, -1]]
        names = ", ".join(self.layout)
        return f"Run of {len(self)} ticks, {first:g} to {last:g} s: {names[:REPR_NAMES]}…"

    def columns(self) -> dict[str, Array]:
        """Return every number as a column (k,), as ``pandas.DataFrame`` takes them.

        Fields of one number have their own name, others it with an index: ``twist_0``.
        """
        fields = {name: self.rows[:, self.layout.slice(name)] for name in self.layout}
        return {
            column: fields[name][:, k]
            for name in self.layout
            for k, column in enumerate(column_names(name, self.layout.fields[name].size))
        }

    def to_numpy(self, *names: str) -> Array:
        """Return fields side by side (k, n), in the order of their names; all if none are given.

        Args:
            names: of fields, such as ``time`` or ``twist``.

        Raises:
            KeyError: no such field; it names those that there are.
        """
        if not names:
            return self.rows
        return np.hstack([self[name].reshape(len(self), -1) for name in names])

    def to_dataframe(self) -> Any:
        """Return the run as a data frame of pandas: a row for each tick, its columns as above.

        Raises:
            ImportError: pandas is not installed.
        """
        return data_frame(self.columns())


def column_names(field: str, size: int) -> list[str]:
    """Return the names of a field's columns: its own, or with an index where it is a vector."""
    return [field] if field in SCALARS else [f"{field}_{k}" for k in range(size)]


def data_frame(columns: Mapping[str, Array]) -> Any:
    """Return columns as a data frame of pandas.

    Args:
        columns: (k,) each, by name.

    Raises:
        ImportError: pandas is not installed.
    """
    try:
        pandas = import_module("pandas")
    except ImportError:
        raise ImportError("data frames need pandas: pip install pandas") from None
    return pandas.DataFrame(dict(columns))


def begin_totals(totals: SessionTotals, state: MechanismState) -> None:
    """Start the kernels' totals from a state; the number of joint constraints stays.

    Args:
        totals: to change.
        state: of the mechanism.
    """
    totals.time, totals.closure_error = state.time, state.closure_error
    for name in _ACCOUNT:
        setattr(totals, name, getattr(state.account, name))


def state_of(
    before: MechanismState, totals: SessionTotals, q: Array, v: Array, touching: Touching | None
) -> MechanismState:
    """Return a mechanism's state as a kernel left it.

    Args:
        before: the last known ``MechanismState``.
        totals: of the kernels.
        q: (nq,) configuration; made read-only.
        v: (nv,) rates, likewise.
        touching: points of contact; None in a scene without.
    """
    # Read at once: one by one they would take some microseconds.
    known: dict[str, Any] = dict(zip(SessionTotals.fields, totals.values.tolist(), strict=True))
    known["refined"], known["inaccurate"] = int(known["refined"]), int(known["inaccurate"])
    account = EnergyAccount(*(known[name] for name in _ACCOUNT))
    q.flags.writeable = v.flags.writeable = False
    time, error = known["time"], known["closure_error"]
    return MechanismState(time, q, v, before.active, error, account, touching, before.released)


class Sample:
    """All that was measured and commanded in one tick, at its start.

    Args:
        time: s since the session's start; the device is engaged at time 0.
        numbers: of the session's data, whole ones.
        values: of the session's data after the tick, as no tick will change them.
        analyser: of the operational point.
        mechanism: its state at ``time``, or the last known state before, and the points of contact.
        device: its state at ``time``, if known as a ``DeviceState``.
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
        # A session makes one per tick: its parts are computed only when requested.
        self.time, self._numbers, self._values = time, numbers, values
        self._analyser, self._mechanism, self._device = analyser, mechanism, device
        self._seen: Observation | None = None

    def __repr__(self) -> str:
        return f"Sample at {self.time:g} s: {self.count} joint constraints"

    def columns(self) -> dict[str, float]:
        """Return the numbers of the sample by the names that columns of a run have.

        Those of a :class:`~hapticmech_ros.session.Run` without the device's true state, its
        actuators' wrench, and energies: for ``pandas.DataFrame``, which takes a list of them.
        """
        state, sample = self.mechanism, self._data.sample
        on_hand, on_mechanism = self.acting
        model = self.seen.model
        fields = {
            "time": np.array([self.time]),
            "q": state.q,
            "v": state.v,
            **{
                f"device_{name}": sample[DeviceSample.layout.slice(name)]
                for name in DeviceSample.layout
            },
            **{
                name: model[OperationalModelSample.layout.slice(name)]
                for name in OperationalModelSample.layout
            },
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
            self._mechanism = state_of(known, *parts, touching)
        return self._mechanism

    @property
    def seen(self) -> Observation:
        """The operational point there: its motion, Λ_h⁻¹ and its analysis."""
        if self._seen is None:
            data, analyser = self._data, self._analyser
            self._seen = Observation(data.observation, analyser.rows, data.v.size)
        return self._seen

    @property
    def hand_wrench(self) -> Array:
        """(6,) F_h on the device, by the hand and by others, as reported; N and N m, world axes."""
        return DeviceSample(self._data.sample).hand_wrench

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
        return int(self._data.totals.constraints)

    @property
    def wrenches(self) -> Array:
        """(6, 6) of the last answer that arrived; rows and units of :class:`ControlOutput`."""
        data = self._data
        given = Answer(data.given if data.connected else data.answers[-1])
        return given.wrenches.values.reshape(6, 6)

    @property
    def acting(self) -> Array:
        """(2, 6) wrenches over the period that begins, N and N m, world axes.

        On the hand by the device, and on the mechanism by the hand.
        """
        acting = ActingWrenches(self._data.wrenches)
        return np.array((acting.on_hand, acting.on_mechanism))

    @property
    def point(self) -> PointKinematics:
        """The operational point's kinematics."""
        return self.seen.point

    @property
    def analysis(self) -> OperationalAnalysis:
        """Λ_h⁻¹ and its analysis."""
        return self.seen.analysis

    @property
    def output(self) -> ControlOutput:
        """The controllers' wrenches."""
        return ControlOutput(*self.wrenches)

    @property
    def model(self) -> OperationalModel:
        """The analysis that the controllers used: X and a_0, compensated for the loop's delay."""
        return model_of(self.seen.model)
