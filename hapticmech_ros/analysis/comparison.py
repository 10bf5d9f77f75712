# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of the architecture with simpler rendering methods, for the same hand motions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from hapticmech_ros.analysis.experience import (
    Experience,
    Yield,
    directions,
    experience,
    penetration,
)
from hapticmech_ros.analysis.impedance import measured_ratios
from hapticmech_ros.analysis.rendering_methods import (
    FREE,
    FULL,
    PROXY,
    SOFT,
    STIFF,
    Variant,
    largest_delay,
    predicted_delay,
    variants,
)
from hapticmech_ros.analysis.scene_variants import at_once, held_by_nobody, of_first_user
from hapticmech_ros.analysis.study import NOTHING, SharedResults, Sheet, Show, plain, silent
from hapticmech_ros.analysis.touch import Setup
from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.experiment.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    SKY,
    VERMILION,
    about,
    dress,
    legend_outside,
    new_figure,
)
from hapticmech_ros.loading import load_scene
from hapticmech_ros.scene import Scene
from hapticmech_ros.workers import Lost, Workers, in_order

FREQUENCIES_HZ = (2, 5, 10, 20)
COLOURS = {FULL: BLUE, STIFF: SKY, FREE: GREY, PROXY: VERMILION, SOFT: ORANGE}
MARKS = {FULL: "o", STIFF: "s", FREE: "x", PROXY: "^", SOFT: "v"}
CAPTION = (
    "Left: largest error of the felt impedance along free directions at 10 Hz. Middle: smallest "
    "stiffness felt along directions constrained by the joints. Right: delay margin of sessions "
    "with these gains, up to 50 periods. 'Stiffest' gains leave a gain margin of 2 at the delay "
    "shown; unstable cases are not drawn."
)
# Smaller values are drawn at these limits: 0.01 % and 1 N/m. Periods have no limit.
LEAST = (1e-4, 1.0, None)


# N/m, half of the default joint-constraint stiffness. Stiffer directions count as constrained.
RIGID = 1000.0
# Value shown in each panel of the figure.
VALUES: tuple[Callable[[Column], float], ...] = (
    lambda row: row.error(10),
    lambda row: np.nan if row.softest_held is None else row.softest_held,
    lambda row: np.nan if row.largest_delay is None else row.largest_delay,
)


@dataclass(frozen=True, slots=True)
class Column:
    """Results of one rendering method for a scene.

    Attributes:
        scene, variant: names.
        delay: periods from measuring to acting.
        stiffness, damping: of the joint constraint or of the proxy, N/m and N s/m.
        errors: (k,) largest |felt / desired - 1| over the free directions, at each frequency.
        sizes: (k,) |felt / desired| farthest from 1, at each frequency: felt over desired inertia.
        stiffest_free: largest stiffness felt along free directions under a push of 0.3 s, N/m.
        softest_held: smallest stiffness felt along constrained directions, N/m; None if there are
            none, or if sessions diverge.
        count: number of directions felt stiffer than 1000 N/m.
        constraints: number of joint constraints.
        largest_delay: delay margin of sessions, up to 50 periods; -1 if unstable without delay,
            None if the method does not couple device and mechanism in all directions.
        predicted_delay: delay margin of the linear model of the loop.
        experience: results of the scene's own experiment.
    """

    scene: str
    variant: str
    delay: int
    stiffness: float
    damping: float
    errors: tuple[float, ...]
    sizes: tuple[float, ...]
    stiffest_free: float
    softest_held: float | None
    count: int
    constraints: int
    largest_delay: int | None
    predicted_delay: int
    experience: Experience

    @property
    def frequencies_hz(self) -> tuple[int, ...]:
        """(k,) of errors and sizes."""
        return FREQUENCIES_HZ

    def error(self, frequency: int) -> float:
        """Return the largest |felt / desired - 1| at one of :meth:`frequencies_hz`."""
        return self.errors[FREQUENCIES_HZ.index(frequency)]


def ratios(setup: Setup) -> list[tuple[Array, Array]]:
    """Return the free directions and felt over desired impedance along them, without a hand.

    Args:
        setup: of the sessions.

    Returns:
        For each free direction its wrench (6,), N and N m, world axes at the point, and the complex
        ratio (k,) at the frequencies.

    Raises:
        InvalidInputError: a period that does not divide 1 s.
        ClosureError: a session that ended by itself.
    """
    released = replace(setup, scene=at_once(held_by_nobody(setup.scene)))
    return measured_ratios(released, np.array(FREQUENCIES_HZ, dtype=float))


def side_by_side(scene: Scene, point: str = "", delay: int = 1) -> list[Column]:
    """Return the results of every rendering method for a scene.

    Args:
        scene: with any device and hand.
        point: operational point; the first one if empty.
        delay: periods from measuring to acting.

    Raises:
        InvalidInputError: a delay below 0, or a period that does not divide 1 s.
    """
    return [_column(scene.name, variant) for variant in variants(scene, point, delay)]


def _column(name: str, variant: Variant) -> Column:
    setup = variant.setup
    most = largest_delay(variant)
    ratio = np.full((1, len(FREQUENCIES_HZ)), np.inf, dtype=complex)
    yields: list[Yield] = []
    # Measurements on a session that diverges are meaningless.
    if most is None or most >= setup.delay:
        with suppress(HapticMechError):
            ratio = np.array([one for _, one in ratios(setup)])
            yields = penetration(setup)
    errors = np.abs(ratio - 1.0).max(axis=0)
    logs = np.abs(np.log(np.abs(ratio)))
    sizes = np.abs(ratio)[logs.argmax(axis=0), np.arange(ratio.shape[1])]
    free = [one.stiffness for one in yields if not one.held]
    held = [one.stiffness for one in yields if one.held]
    return Column(
        scene=name,
        variant=variant.name,
        delay=setup.delay,
        stiffness=variant.gains[0],
        damping=variant.gains[1],
        errors=tuple(errors.tolist()),
        sizes=tuple(sizes.tolist()),
        stiffest_free=max(free, default=0.0),
        softest_held=min(held, default=None),
        count=sum(one.stiffness > RIGID for one in yields),
        constraints=directions(setup.scene, setup.point).held.shape[1],
        largest_delay=most,
        predicted_delay=predicted_delay(variant),
        experience=experience(setup),
    )


@dataclass(frozen=True)
class RenderingComparison(SharedResults):
    """Results of all rendering methods.

    Attributes:
        columns: one for each scene, delay and method.
    """

    NAME: ClassVar[str] = "comparison"

    columns: tuple[Column, ...]

    def document(self) -> list[object]:
        """Return a dictionary for each column."""
        return [plain(one) for one in self.columns]

    def sheets(self) -> Iterator[Sheet]:
        """Yield a table with a row for each scene, delay and rendering method."""
        lines: list[tuple[str, ...]] = []
        for (scene, delay), group in groupby(self.columns, lambda row: (row.scene, row.delay)):
            lines.append((f"{scene}, delay {delay}",))
            lines += [_row(row) for row in group]
        yield Sheet(
            "comparison of rendering methods: error of felt impedance, stiffness along constraints,"
            " rigid directions, delay margin in periods; drift and penetration in mm",
            ("", "2 Hz %", "10 Hz %", "N/m", "rigid", "delay margin", "drift", "depth"),
            tuple(lines),
        )

    def figures(self) -> Mapping[str, Figure]:
        """Return the comparison over scenes, or over delays of one scene."""
        return {"comparison.png": _drawn(self.columns)}


def compare(
    scenes: Sequence[str], delays: Sequence[int], workers: Workers = 1, show: Show = silent
) -> RenderingComparison:
    """Compare the rendering methods on every scene at each delay.

    Args:
        scenes: names or paths.
        delays: periods from measuring to acting, each 0 or more.
        workers: that share the scenes; they do not affect the results.
        show: called after each scene.

    Returns:
        Results of every scene, delay and method.

    Raises:
        SceneError: a scene that cannot be loaded.
        InvalidInputError: no process; as :func:`side_by_side`.
    """
    for delay in delays:
        if delay < 0:
            raise InvalidInputError("delay", delay, "must be 0 or more periods")
    cases = [_Case(of_first_user(load_scene(name)), delay) for name in scenes for delay in delays]
    columns: list[Column] = []
    lost: list[str] = []
    for case, found in zip(cases, in_order(_compared, cases, workers), strict=True):
        if isinstance(found, Lost):
            lost.append(str(found))
        else:
            columns += found
        show(str(case))
    return RenderingComparison(tuple(columns), lost=tuple(lost))


@dataclass(frozen=True, slots=True)
class _Case:
    scene: Scene
    delay: int

    def __str__(self) -> str:
        return f"{self.scene.name}, {self.delay} periods of delay"


def _compared(case: _Case) -> list[Column]:
    return side_by_side(case.scene, delay=case.delay)


def _row(row: Column) -> tuple[str, ...]:
    seen = row.experience
    return (
        row.variant,
        _percent(row.error(2)),
        _percent(row.error(10)),
        NOTHING if row.softest_held is None else f"{row.softest_held:.0f}",
        f"{row.count}/{row.constraints}",
        NOTHING if row.largest_delay is None else str(row.largest_delay),
        f"{1e3 * seen.drift_rms:.2g}" if seen.kept else "lost",
        f"{1e3 * seen.penetration_rms:.2g}" if seen.kept else "lost",
    )


def _percent(value: float) -> str:
    return f"{100.0 * value:.3g}" if np.isfinite(value) else "lost"


def _drawn(columns: Sequence[Column]) -> Figure:
    scenes = list(dict.fromkeys(row.scene for row in columns))
    delays = sorted({row.delay for row in columns})
    over_delay = len(scenes) == 1 and len(delays) > 1
    height = 4.2 if over_delay else 1.6 + 0.34 * len(scenes)
    figure = new_figure(13.0, height, about(scenes, CAPTION))
    axes = figure.subplots(1, 3, sharey=not over_delay)
    shown = columns if over_delay else [row for row in columns if row.delay == delays[0]]
    for panel, least, value in zip(axes, LEAST, VALUES, strict=True):
        for name in COLOURS:
            rows = [row for row in shown if row.variant == name]
            values = [value(row) for row in rows]
            kept = [max(one, least) if least else float(one) for one in values]
            if over_delay:
                _line(panel, [row.delay for row in rows], kept, name)
            else:
                _dots(panel, [scenes.index(row.scene) for row in rows], kept, name)
        if least:
            panel.set_yscale("log") if over_delay else panel.set_xscale("log")
    labels = ("error at 10 Hz (1)", "constraint stiffness (N/m)", "delay margin (periods)")
    for panel, label in zip(axes, labels, strict=True):
        dress(panel, *(("delay (periods)", label) if over_delay else (label, "")))
    if over_delay:
        for panel in axes:
            panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    else:
        axes[0].set_yticks(range(len(scenes)), scenes)
        axes[0].invert_yaxis()
    handles, names = axes[0].get_legend_handles_labels()
    legend_outside(figure, handles, names, len(names))
    return figure


def _dots(axes: Axes, rows: list[int], values: list[float], name: str) -> None:
    offset = 0.13 * (list(COLOURS).index(name) - 2)
    at = np.array(rows, dtype=float) + offset
    axes.plot(values, at, MARKS[name], color=COLOURS[name], markersize=6, label=name)


def _line(axes: Axes, delays: list[int], values: list[float], name: str) -> None:
    colour, mark = COLOURS[name], MARKS[name]
    # Hollow, and smaller from one to the next: where values are equal, all marks are seen.
    style: dict[str, Any] = {
        "markersize": 11.0 - 1.7 * list(COLOURS).index(name),
        "fillstyle": "none",
    }
    axes.plot(delays, values, color=colour, marker=mark, linewidth=1.3, label=name, **style)
