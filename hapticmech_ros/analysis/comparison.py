# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of the architecture with simpler rendering methods, for the same hand motions.

Rendering methods that are compared: the architecture with and without constraints, and proxies.

Architecture and proxy are both used with two pairs of gains: the scene's own joint-constraint
gains, and the stiffest ones with a gain margin of 2, chosen in the same way, and so the comparison
does not depend on the choice of gains.

A proxy is a virtual coupling, the same stiff spring and damper in all directions:

    u = -(κ Λ_d e + β Λ_d ė)   on the device,      κ Λ_d e + β Λ_d ė   on the mechanism

It uses neither Λ_h⁻¹ nor force feedforward, and does not distinguish constrained directions. The
hand feels the mechanism through the spring, with the device's inertia added.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, groupby
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
from hapticmech_ros.analysis.linear_loop import FINE, Law, diverges, frontier, law_of, tick_matrix
from hapticmech_ros.analysis.scene_variants import (
    at_once,
    held_by_nobody,
    of_first_user,
    with_constraint,
)
from hapticmech_ros.analysis.study import (
    NOTHING,
    SharedResults,
    Sheet,
    Show,
    plain,
    shared,
    silent,
)
from hapticmech_ros.analysis.touch import Setup, comes_to_rest, relative_speeds
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.architecture import LawControl, LawInput
from hapticmech_ros.control.loop_stability import LoopTerms, spectral_radius
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.errors import HapticMechError, check_not_negative
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
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.system.workers import Workers

# Gain margin of the chosen gains.
GAIN_MARGIN = 2.0
# Candidates for β / κ, in units of the loop's latency (delay + 1/2) T.
RATIOS = np.geomspace(0.5, 8.0, 17)


class ProxyControl(LawControl):
    """A spring and damper between device and operational point.

    Args:
        scene: whose device, limits and ramps are used.
        stiffness: κ, 1/s².
        damping: β, 1/s.

    Raises:
        InvalidInputError: a gain that is negative or not finite.
    """

    def __init__(self, scene: Scene, stiffness: float, damping: float) -> None:
        super().__init__(scene, self._pulled)
        check_not_negative(stiffness=stiffness, damping=damping)
        self.spring = stiffness * self.device_inertia
        self.damper = damping * self.device_inertia

    def _pulled(self, seen: LawInput, /) -> tuple[Array, Array]:
        pull = self.spring @ seen.error + self.damper @ seen.rate
        return -pull, pull

    def law(self) -> Law:
        """Return the linear law of this controller."""
        zero = np.zeros((6, 6))
        return Law(zero, self.spring, self.damper, zero, self.spring, self.damper, local=False)


def stiffest_proxy(scene: Scene, found: OperationalAnalysis, delay: int) -> tuple[float, float]:
    """Return κ (1/s²) and β (1/s) of the stiffest proxy with a gain margin of 2.

    With the position frozen ë = -(1 + X Λ_d) (κ e + β ė), delayed; see :func:`stiffest_gains`.

    Args:
        scene: whose device and period are used.
        found: analysis at the position where the loop has to be stable.
        delay: whole periods from measuring to acting.

    Raises:
        InvalidInputError: a delay below 0.
    """
    rows = found.rows
    inertia = np.diag(scene.device.inertias)[np.ix_(rows, rows)]
    loop = np.eye(len(rows)) + found.inverse_inertia[np.ix_(rows, rows)] @ inertia
    return stiffest_gains(scene, loop, delay)


def stiffest_gains(scene: Scene, loop: Array, delay: int) -> tuple[float, float]:
    """Return the largest k and b of a delayed ë = -A (k e + b ė) with a gain margin of 2.

    They are half of the limit gains for the ratio of b to k with the largest stable k.

    Args:
        scene: whose period is used.
        loop: (n, n) A; without unit for k in 1/s² and b in 1/s, in 1/kg for N/m and N s/m.
        delay: whole periods from measuring to acting.

    Raises:
        InvalidInputError: a delay below 0.
    """
    check_not_negative(delay=delay)
    period = scene.simulation.period
    latency = (delay + 0.5) * period
    best = (0.0, 0.0)
    for ratio in latency * RATIOS:

        def stable(gain: float, ratio: float = ratio) -> bool:
            late = gain * loop, gain * ratio * loop
            terms = LoopTerms(late, (np.zeros_like(loop), np.zeros_like(loop)))
            return spectral_radius(terms, period, delay) < 1.0

        guess = 0.25 / latency**2 / float(np.trace(loop))
        most = frontier(stable, guess, 1e-6 * guess, 1e3 * guess, FINE)
        if most is not None and most > best[0]:
            best = (most, most * float(ratio))
    return best[0] / GAIN_MARGIN, best[1] / GAIN_MARGIN


FULL, STIFF = "architecture", "architecture, stiffest"
FREE = "no joint constraint"
PROXY, SOFT = "proxy, stiffest", "proxy, as soft"
# Speed of the device after the touch, and of a session that is lost, m/s of the metric.
TOUCH_SPEED, LOST_SPEED = 2e-3, 0.04
WATCHED_S = 1.5
# Share of the touch that counts as rest, since a mechanism that swings by itself leaves some
# relative velocity of device and point. An unstable loop exceeds it.
FLOOR_SHARE = 0.05
# Largest delay tried, periods.
MOST_DELAY = 50


@dataclass(frozen=True, slots=True)
class Variant:
    """One rendering method of a scene.

    Attributes:
        name: of the method.
        setup: of its sessions.
        law: linear law at the scene's start.
        holds: whether it renders stiffness along all constrained directions.
        gains: stiffness and damping of the joint constraint, or of a proxy, N/m and N s/m.
    """

    name: str
    setup: Setup
    law: Law
    holds: bool
    gains: tuple[float, float]


def variants(scene: Scene, point: str = "", delay: int = 1) -> list[Variant]:
    """Return the rendering methods of a scene; 'stiffest' gains are those for the given delay.

    Args:
        scene: whose mechanism, device and hand are used.
        point: operational point; the first one if empty.
        delay: periods from measuring to acting.

    Raises:
        InvalidInputError: a delay below 0.
    """
    found = directions(scene, point)
    joint, mass = scene.controller.joint_constraint, scene.device.mass
    stiff = joint.stiffness, joint.damping
    if found.held.size:
        # Device's mass per unit of P_c along the direction with the largest gain.
        gain = found.held.T @ np.linalg.inv(np.diag(scene.device.inertias)) @ found.held
        loop = np.linalg.eigvalsh(gain)[-1:, None]
        stiff = stiffest_gains(scene, loop, 0 if joint.local else delay)
    kappa, beta = stiffest_proxy(scene, found.analysis, delay)
    return [
        _architecture(FULL, scene, point, delay),
        _architecture(STIFF, with_constraint(scene, *stiff), point, delay),
        _architecture(FREE, with_constraint(scene, 0.0, 0.0), point, delay),
        _proxy(PROXY, scene, point, delay, kappa, beta),
        _proxy(SOFT, scene, point, delay, joint.stiffness / mass, joint.damping / mass),
    ]


def _architecture(name: str, scene: Scene, point: str, delay: int) -> Variant:
    found = directions(scene, point)
    model = operational_model_of(found.analysis)
    law, joint = law_of(ControlArchitecture(scene), model), scene.controller.joint_constraint
    holds = joint.stiffness > 0.0 or not found.held.size
    return Variant(name, Setup(scene, point, delay), law, holds, (joint.stiffness, joint.damping))


def _proxy(name: str, scene: Scene, point: str, delay: int, kappa: float, beta: float) -> Variant:
    setup = Setup(scene, point, delay, partial(ProxyControl, stiffness=kappa, damping=beta))
    law, mass = ProxyControl(scene, kappa, beta).law(), scene.device.mass
    return Variant(name, setup, law, True, (kappa * mass, beta * mass))


def largest_delay(variant: Variant) -> int | None:
    """Return the delay margin of sessions, up to 50 periods; -1 if unstable without delay.

    The device is touched along all directions at once, without a hand; stability is judged by the
    velocity of the device relative to the operational point. None for a method without coupling
    along some direction: the device then moves on and does not come to rest.
    """
    if not variant.holds:
        return None
    setup = variant.setup
    scene = at_once(held_by_nobody(setup.scene))
    found = directions(scene, setup.point)
    mobility, normals = np.linalg.inv(np.diag(scene.device.inertias)), found.normals
    speeds = np.full(normals.shape[1], TOUCH_SPEED / np.sqrt(normals.shape[1]))
    impulse = normals @ np.linalg.solve(normals.T @ mobility @ normals, speeds)
    ticks = round(WATCHED_S / scene.simulation.period)
    floor = FLOOR_SHARE * TOUCH_SPEED

    def stable(delay: int) -> bool:
        case, push = replace(setup, scene=scene, delay=delay), impulse / scene.simulation.period
        watch = relative_speeds(normals)
        return comes_to_rest(case, push, watch, ticks, LOST_SPEED, floor)

    return _largest(stable)


def predicted_delay(variant: Variant) -> int:
    """Return the delay margin of the linear model of the loop."""
    setup = variant.setup
    found = directions(setup.scene, setup.point).analysis

    def stable(delay: int) -> bool:
        x, rows = found.inverse_inertia, found.rows
        return not diverges(tick_matrix(setup.scene, variant.law, x, rows, delay))

    return _largest(stable)


def _largest(stable: Callable[[int], bool]) -> int:
    """Return the largest stable delay, by bisection; -1 if there is none."""
    return bisect_left(range(MOST_DELAY + 1), True, key=lambda delay: not stable(delay)) - 1


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
        check_not_negative(delay=delay)
    cases = [
        Setup(of_first_user(load_scene(name)), delay=delay) for name in scenes for delay in delays
    ]
    columns, lost = shared(_compared, cases, workers, show)
    return RenderingComparison(tuple(chain.from_iterable(columns)), lost=lost)


def _compared(case: Setup) -> list[Column]:
    return side_by_side(case.scene, case.point, case.delay)


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
