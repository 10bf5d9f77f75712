# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a session went through in many ticks, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL, TWIST, WRENCH, Field, Layout

ENERGIES = ("to_mechanism", "stored", "injected", "dissipated", "actuators")
SCALARS = frozenset(("time", *ENERGIES, "count"))
ONE, FORCE = Field(1), Field(6, WRENCH)
POSE_ERROR = ("position",) * 3 + ("angle",) * 3
# Letters of names of fields that a repr shows.
REPR_NAMES = 60
# Rows of a ControlOutput, and then its pose error.
CONTROL = ("device_command", "mechanism_command", "impedance", "joint_constraint", "four_channel")


def run_layout(nq: int, nv: int) -> Layout:
    """Return how a row of a run is laid out: all that was measured and commanded in one tick.

    Time, s; q and v of the mechanism; the device's sample, the wrench applied until then, and what
    its driver adds to the next one; where the simulated device really is, rotation row by row, and
    how it moves, as its state says; the operational model; wrenches of the
    controllers and their pose error, see
    :class:`~hapticmech_ros.control.measurements.ControlOutput`; what acts
    from then on, on the hand by the device and on the mechanism by the hand; what others do to the
    mechanism at the operational point; energies of the controllers and of the device, J, see
    docs/passivity.md; and the number of joint constraints reported.

    Args:
        nq: numbers of a configuration.
        nv: number of rates.
    """
    return Layout(
        {
            "time": ONE,
            "q": Field(nq),
            "v": Field(nv),
            **{f"device_{name}": field for name, field in DEVICE_SAMPLE.fields.items()},
            "device_applied": FORCE,
            "device_added": FORCE,
            "device_true_position": Field(3),
            "device_true_rotation": Field(9),
            "device_true_twist": Field(6, TWIST),
            **OPERATIONAL_MODEL.fields,
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
