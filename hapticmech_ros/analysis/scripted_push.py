# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A hand that pushes as a measurement wants it, smoothly, and what of it acts in each period.

A hand's wrench varies within a period. One that is held over each period and steps at the samples
would act half a period later, in the mean, than what a device measures of it; one that goes from
sample to sample in straight lines has edges there, which on a mass that is a thousand times the
device's are felt at 10 Hz.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.scene.hand import ScriptedHand
from hapticmech_ros.scene.script import COLUMNS

# Rows of a script in a period, between which its wrench goes in straight lines.
ROWS = 8


def fine_times(period: float, periods: int, rows: int = ROWS) -> Array:
    """Return times (rows n + 1,) of a script's rows in n periods, s.

    Args:
        period: s.
        periods: n.
        rows: in a period.
    """
    return period / rows * np.arange(rows * periods + 1)


def samples_of(fine: Array, rows: int = ROWS) -> Array:
    """Return what a push is at the start of each of its periods, (n, ...).

    Args:
        fine: (rows n + 1, ...) by rows of a script.
        rows: in a period.
    """
    return fine[:-1:rows]


def means_of(fine: Array) -> Array:
    """Return the means of a push over each of its periods, (n, ...).

    Args:
        fine: (ROWS n + 1, ...) by rows of a script.
    """
    middles = 0.5 * (fine[:-1] + fine[1:])
    return np.asarray(middles.reshape(-1, ROWS, *fine.shape[1:]).mean(axis=1))


def write_script(path: Path, times: Array, pushes: Array) -> None:
    """Write a script of a scripted hand.

    Args:
        path: of the file.
        times: (n,) s, increasing.
        pushes: (n, 6) N and N m, world axes at the point held.
    """
    rows = np.column_stack((times, pushes))
    # In fewer digits a script of five seconds at 4 kHz is within what is read of one.
    digits = ["%.9g"] + ["%.8g"] * 6
    np.savetxt(path, rows, digits, ",", header=",".join(COLUMNS), comments="")


@contextmanager
def scripted(times: Array, pushes: Array) -> Iterator[ScriptedHand]:
    """Yield a hand that pushes from its start on, whose script exists meanwhile.

    Args:
        times: (n,) s after the start, increasing.
        pushes: (n, 6) N and N m, world axes at the point held.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "push.csv"
        write_script(path, times, pushes)
        yield ScriptedHand(kind="scripted", file=str(path), start_delay=0.0)
