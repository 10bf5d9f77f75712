"""The limits of a rendering, from plan to files."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from hapticmech_ros.bench.feel.limits.figure import draw_m_width, draw_z_width
from hapticmech_ros.bench.feel.limits.m_width import MPoint
from hapticmech_ros.bench.feel.limits.plan import Case, Found, Load, measure
from hapticmech_ros.bench.feel.limits.z_width import ZPoint
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.workers import worker_pool

JSON_NAME = "bench_feel_limits.json"
Z_PLOT, M_PLOT = "bench_feel_z_width.png", "bench_feel_m_width.png"

Show = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Limits:
    """All that was found.

    Attributes:
        z: stiffest stable joint constraints.
        m: lightest and heaviest stable inertias.
        loads: penetration, and what happened during experiments.
    """

    z: tuple[ZPoint, ...]
    m: tuple[MPoint, ...]
    loads: tuple[Load, ...]

    def document(self) -> dict[str, object]:
        """Return the results as plain dictionaries, lists and numbers."""
        loads = [
            {
                "scene": load.scene,
                "delay": load.delay,
                "yields": [
                    {**asdict(one), "direction": one.direction.tolist(), "felt": one.stiffness}
                    for one in load.yields
                ],
                "experience": asdict(load.experience),
            }
            for load in self.loads
        ]
        whole = {
            "z_width": [asdict(one) for one in self.z],
            "m_width": [asdict(one) for one in self.m],
            "loads": loads,
        }
        plain = _finite(whole)
        return plain if isinstance(plain, dict) else {}


def run_limits(
    cases: Sequence[Case], out: Path, processes: int = 1, show: Show = lambda line: None
) -> Limits:
    """Measure every case; write JSON and pictures into ``out``.

    Args:
        cases: of :func:`~hapticmech_ros.bench.feel.limits.plan.plan`.
        out: folder, made if it is not there.
        processes: that share the cases; it changes no figure.
        show: told of each case that is done.

    Raises:
        InvalidInputError: no process.
    """
    if processes < 1:
        raise InvalidInputError("processes", processes, "must be 1 or more")
    found: list[Found] = []
    if processes == 1:
        for case in cases:
            found += measure(case)
            show(str(case))
    else:
        # Forked, a process would lack the threads that this one has.
        with worker_pool(processes) as pool:
            for case, some in zip(cases, pool.map(measure, cases), strict=True):
                found += some
                show(str(case))
    limits = Limits(
        tuple(one for one in found if isinstance(one, ZPoint)),
        tuple(one for one in found if isinstance(one, MPoint)),
        tuple(one for one in found if isinstance(one, Load)),
    )
    out.mkdir(parents=True, exist_ok=True)
    written = json.dumps(limits.document(), indent=1, ensure_ascii=False, allow_nan=False)
    (out / JSON_NAME).write_text(written + "\n", encoding="utf-8")
    if limits.z:
        draw_z_width(limits.z, out / Z_PLOT)
    if limits.m:
        draw_m_width(limits.m, out / M_PLOT)
    return limits


def _finite(value: object) -> object:
    """Return a value with None for numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
