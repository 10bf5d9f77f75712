# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Stability limits of scenes: Z-width, M-width, penetration, and results of the experiment.

Z-width: the stiffest stable joint constraint over its damping.

Position channels are off, to test the wall alone: along the constrained directions n_i the device
is coupled to a mechanism that does not move. The signal is the velocity of the device relative to
the operational point, n_iᵀ ė / √m_ℓ, in m/s.

M-width: the lightest and the heaviest mechanism that a device renders stably.

The mechanism's inertias are scaled, and with them the felt inertia X⁻¹. The hand is a mass rigidly
fixed to the device, or the scene's own hand, which stays where it took hold. Stability is judged by
the command to the device: if the loop is unstable, the actuators' limits lead to a limit cycle,
which is less visible in the hand's force.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, groupby
from typing import ClassVar

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hapticmech_ros.analysis.experience import (
    Experience,
    Yield,
    directions,
    experience,
    penetration,
)
from hapticmech_ros.analysis.impedance import TORQUE_UNIT
from hapticmech_ros.analysis.linear_loop import (
    FINE,
    NOBODY,
    Held,
    delayed_stiffness,
    diverges,
    frontier,
    held_by,
    law_of,
    lightest_mass,
    passive_stiffness,
    tick_matrix,
)
from hapticmech_ros.analysis.scene_variants import (
    at_once,
    at_rate,
    held_by_nobody,
    held_still,
    of_first_user,
    scaled,
    with_constraint,
    with_loop,
    without_channel,
)
from hapticmech_ros.analysis.study import (
    NOTHING,
    SharedResults,
    Sheet,
    Show,
    number,
    shared,
    silent,
)
from hapticmech_ros.analysis.touch import MassHeldDevice, Setup, comes_to_rest, relative_speeds
from hapticmech_ros.control import ControlArchitecture
from hapticmech_ros.control.measurements import operational_model_of
from hapticmech_ros.errors import (
    HapticMechError,
    InvalidInputError,
    check_not_negative,
    check_one_of,
)
from hapticmech_ros.experiment.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SMALL,
    VERMILION,
    about,
    dress,
    new_figure,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.hand import TargetHand
from hapticmech_ros.session import Sample, Session
from hapticmech_ros.system.workers import Workers

# N, of the push of one period, or of G times the push if that is larger: no limit is reached, and a
# decaying command stays near it.
TOUCH_N = 0.5
LOST_N = 8.0 * TOUCH_N
# Length of the response, s: with a mass fixed to the device, which reacts within samples; with the
# scene's hand, which oscillates; and of the scene's hand with a heavy mechanism.
WATCHED_S, SWINGING_S, SLOW_S = 0.6, 2.0, 6.0
# Range of the search, felt over device inertia.
LIGHTEST, HEAVIEST = 1e-3, 300.0
HEAVY = (10.0, 100.0, HEAVIEST)


@dataclass(frozen=True, slots=True)
class MPoint:
    """The lightest and the heaviest felt inertia of a scene, over the device's.

    Inertias are 1 / λ_max(Λ_d X): along the direction that is felt lightest.

    Attributes:
        scene: its name.
        delay: periods from measuring to acting.
        local: whether the device closes the force channel.
        hand: ``mass`` or ``scene``.
        share: mass of the hand over that of the device; 0 for the scene's hand.
        own: felt inertia of the unscaled mechanism.
        measured: lightest stable inertia, from sessions.
        predicted: lightest stable inertia by eigenvalues of the linear model; None for a nonlinear
            hand.
        rule: m_a / (m_d + 2 m_a) for a hand with mass; None for the scene's hand.
        heaviest: heaviest stable inertia of 10, 100 and 300 times the device's; 0 if none is.
    """

    scene: str
    delay: int
    local: bool
    hand: str
    share: float
    own: float
    measured: float | None
    predicted: float | None
    rule: float | None
    heaviest: float


def m_width(scene: Scene, point: str = "", delay: int = 1, share: float | None = 1.0) -> MPoint:
    """Return the lightest and the heaviest stable felt inertia.

    Args:
        scene: with any device; its ``controller.force_channel.local`` is kept.
        point: operational point; the first one if empty.
        delay: periods from measuring to acting.
        share: mass of a hand fixed to the device over the device's; None for the scene's hand.

    Raises:
        InvalidInputError: a negative share, a delay below 0, or a scene's hand that does not hold
            at a place: the device then never comes to rest.
    """
    if share is None and not isinstance(scene.hand, TargetHand):
        raise InvalidInputError("hand", scene.hand.kind, "must hold the device at a place")
    case = _Case(scene, point, delay, share)
    # The search is over 1 / inertia: large values are unstable.
    guess = 1.0 if share in (None, 0.0) else 1.0 / lightest_mass(1.0, share or 0.0)
    bounds = 1.0 / HEAVIEST, 1.0 / LIGHTEST
    watched = WATCHED_S if share is not None else SWINGING_S
    measured = frontier(lambda lightness: case.stable(lightness, watched), guess, *bounds)
    predicted = frontier(case.predicted, guess, *bounds, FINE) if case.held is not None else None
    seconds = SLOW_S if share is None else WATCHED_S
    heavy = [one for one in HEAVY if case.stable(1.0 / one, seconds)]
    return MPoint(
        scene=scene.name,
        delay=delay,
        local=scene.controller.force_channel.local,
        hand="scene" if share is None else "mass",
        share=share or 0.0,
        own=case.own,
        measured=None if measured is None else case.felt(measured),
        predicted=None if predicted is None else case.felt(predicted),
        rule=None if share is None else lightest_mass(1.0, share),
        heaviest=max(heavy, default=0.0),
    )


class _Case:
    def __init__(self, scene: Scene, point: str, delay: int, share: float | None) -> None:
        self._scene = at_once(held_still(scene) if share is None else held_by_nobody(scene))
        self._point, self._delay, self._share = point, delay, share
        self._analysis = Session(self._scene, point).tick().analysis
        inertia = self._inertia = np.diag(scene.device.inertias)
        x = self._analysis.inverse_inertia
        self.own = 1.0 / float(np.linalg.eigvals(inertia @ x).real.max())
        zero = np.zeros((6, 6))
        fixed = None if share is None else Held(zero, zero, share * inertia)
        self.held = held_by(self._scene) if fixed is None else fixed
        found = self._analysis
        free = found.spectrum.wrenches[:, found.weights < 1.0].sum(axis=1)
        self._push = np.zeros(6)
        self._push[found.rows] = free
        self._push *= TOUCH_N / _size(self._push)

    def stable(self, lightness: float, seconds: float) -> bool:
        """Return whether a session with a mechanism this light comes to rest after a touch."""
        scene, share = self._scaled(lightness), self._share
        device = None if share is None else lambda one: MassHeldDevice(one, share)
        setup = Setup(scene, self._point, self._delay, device=device)
        ticks = round(seconds / scene.simulation.period)
        push = min(1.0, 1.0 / lightness) * self._push
        return comes_to_rest(setup, push, _command, ticks, LOST_N)

    def predicted(self, lightness: float) -> bool:
        """Return whether the linear model of the loop is stable."""
        if self.held is None:
            return False
        sample = Session(self._scaled(lightness), self._point, self._delay).tick()
        found, law = sample.analysis, law_of(ControlArchitecture(self._scene), sample.model)
        x, rows = found.inverse_inertia, found.rows
        return not diverges(tick_matrix(self._scene, law, x, rows, self._delay, self.held))

    def felt(self, lightness: float) -> float:
        """Return the least felt inertia of a mechanism this light, by X_τ, over the device's."""
        model = Session(self._scaled(lightness), self._point, self._delay).tick().model
        return 1.0 / float(np.linalg.eigvals(self._inertia @ model.inverse_inertia).real.max())

    def _scaled(self, lightness: float) -> Scene:
        return scaled(self._scene, 1.0 / (lightness * self.own))


def _command(sample: Sample) -> Array:
    wrench = sample.output.device.copy()
    wrench[3:] /= TORQUE_UNIT
    return wrench


def _size(wrench: Array) -> float:
    return float(max(np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:]) / TORQUE_UNIT))


# Dampings as shares of the one that is unstable without stiffness.
Z_WIDTH_SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)
# Relative speed of the device after the touch, m/s: commands stay within the device's limits, slew
# included, also at the stiffest walls; rounding is four orders of magnitude below it.
TOUCH_SPEED = 2e-5
# m/s; a decaying oscillation stays near the speed of the touch.
LOST_SPEED = 20.0 * TOUCH_SPEED
# Length of the response: cycles of the wall's oscillation, multiples of the loop's delay, and its
# bounds in ticks.
CYCLES, DELAYS = 10.0, 60
SHORTEST, LONGEST = 300, 8000
# Range of the search, N/m.
SOFTEST, STIFFEST = 1e-2, 1e8


@dataclass(frozen=True, slots=True)
class ZPoint:
    """The stiffest stable joint constraint at one damping.

    Attributes:
        scene: its name.
        rate_hz: of the loop.
        delay: periods from measuring to acting.
        hand: ``nobody``, or ``still`` for the scene's hand at the pose of grasp.
        loop: where the wall is closed: ``device`` or ``controller``.
        damping: b of the joint constraint, N s/m.
        mass: of the device along the direction that is unstable first, kg per unit of P_c.
        measured: k, N/m, from sessions; None if even the softest wall is unstable.
        predicted: k, N/m, at which the linear model of the loop has an eigenvalue on the unit
            circle; None as above, or for a nonlinear hand.
        rule: k, N/m, (b + B) / (T / 2 + t_d).
        passive: k, N/m, up to which the wall is passive by Colgate and Schenkel.
    """

    scene: str
    rate_hz: float
    delay: int
    hand: str
    loop: str
    damping: float
    mass: float
    measured: float | None
    predicted: float | None
    rule: float
    passive: float


class Wall:
    """The joint constraints of a scene at its start.

    Args:
        scene: with a joint constraint at its start.
        point: operational point; the first one if empty.

    Attributes:
        scene: without ramp and position channels.
        mass: of the device along the direction with the largest gain, 1 / λ_max(Λ_d⁻¹ P_c), kg.
        physical: damping of the device along it, N s/m per unit of P_c.
        local: whether the device closes the wall.

    Raises:
        InvalidInputError: a scene without a constraint at its start.
    """

    def __init__(self, scene: Scene, point: str = "") -> None:
        self.scene, self._point = without_channel(at_once(scene)), point
        self.local = scene.controller.joint_constraint.local
        found = directions(self.scene, point)
        self._analysis, self._normals = found.analysis, found.held
        if not self._normals.size:
            raise InvalidInputError(
                "scene", scene.name, "must have a joint constraint at its start"
            )
        mobility = np.linalg.inv(np.diag(scene.device.inertias))
        gain = self._normals.T @ mobility @ self._normals
        sizes, ways = np.linalg.eigh(gain)
        self.mass = 1.0 / float(sizes[-1])
        shape = mobility @ self._normals @ ways[:, -1]
        loss = np.array([scene.device.damping] * 3 + [scene.device.angular_damping] * 3)
        self.physical = float(shape @ (loss * shape)) * self.mass**2
        wrench = self._normals @ np.linalg.solve(gain, np.ones(len(sizes)))
        self._push = wrench * TOUCH_SPEED / np.sqrt(len(sizes))

    def stable(self, stiffness: float, damping: float, delay: int, hand: str) -> bool:
        """Return whether a session with these gains comes to rest after a touch.

        Args:
            stiffness: of the joint constraint, N/m.
            damping: of it, N s/m.
            delay: periods.
            hand: ``nobody`` or ``still``.
        """
        scene = self._with(stiffness, damping, hand)
        period = scene.simulation.period
        cycle = 2.0 * np.pi / np.sqrt(stiffness / self.mass) / period
        ticks = int(np.clip(CYCLES * cycle, max(SHORTEST, DELAYS * (delay + 1)), LONGEST))
        push = self._push / period
        setup = Setup(scene, self._point, delay)
        watch = relative_speeds(self._normals)
        return comes_to_rest(setup, push, watch, ticks, LOST_SPEED)

    def predicted(self, damping: float, delay: int, hand: str) -> float | None:
        """Return the stiffness, N/m, at which the linear model of the loop becomes unstable."""
        held = NOBODY if hand == "nobody" else held_by(self.scene)
        if held is None:
            return None
        model = operational_model_of(self._analysis)

        def stable(stiffness: float) -> bool:
            scene = self._with(stiffness, damping, hand)
            law = law_of(ControlArchitecture(scene), model)
            rows, x = self._analysis.rows, model.inverse_inertia
            return not diverges(tick_matrix(scene, law, x, rows, delay, held))

        period = self.scene.simulation.period
        guess = damping / (period * (0.5 + self.late(delay)))
        return frontier(stable, guess, SOFTEST, STIFFEST, FINE)

    def late(self, delay: int) -> int:
        """Return the delay of the wall, periods, in a loop with a delay of ``delay`` periods."""
        return 0 if self.local else delay

    def most_damping(self, delay: int) -> float:
        """Return B, N s/m, at which a damper alone is unstable: T B / m = 2 sin(π / (4 d + 2)).

        d is the delay of the wall, :meth:`late`.

        Raises:
            InvalidInputError: a delay below 0.
        """
        check_not_negative(delay=delay)
        largest = 2.0 * np.sin(np.pi / (4 * self.late(delay) + 2))
        return float(self.mass * largest / self.scene.simulation.period)

    def _with(self, stiffness: float, damping: float, hand: str) -> Scene:
        scene = with_constraint(self.scene, stiffness, damping)
        return held_by_nobody(scene) if hand == "nobody" else held_still(scene)


def z_width(
    scene: Scene,
    point: str = "",
    delay: int = 1,
    hand: str = "nobody",
    shares: Sequence[float] = Z_WIDTH_SHARES,
) -> list[ZPoint]:
    """Return the stiffest stable joint constraint at each damping.

    Args:
        scene: with a joint constraint at its start, with any device and hand.
        point: operational point; the first one if empty.
        delay: periods from measuring to acting.
        hand: ``nobody``, or ``still`` for the scene's.
        shares: dampings as shares of the one that is unstable without stiffness.

    Raises:
        InvalidInputError: no constraint, a delay below 0, another hand, or a share outside (0, 1).
    """
    check_one_of("hand", hand, ("nobody", "still"))
    for share in shares:
        if not 0.0 < share < 1.0:
            raise InvalidInputError("share of damping", share, "must be between 0 and 1")
    wall, period = Wall(scene, point), scene.simulation.period
    found = []
    for share in shares:
        damping = share * wall.most_damping(delay)
        rule = delayed_stiffness(wall.physical, damping, period, wall.late(delay) * period)
        predicted = wall.predicted(damping, delay, hand)
        measured = frontier(
            lambda stiffness, b=damping: wall.stable(stiffness, b, delay, hand),  # type: ignore[misc]
            rule,
            SOFTEST,
            STIFFEST,
        )
        passive = passive_stiffness(wall.physical, damping, period)
        loop = "device" if wall.local else "controller"
        found.append(
            ZPoint(
                *(scene.name, 1.0 / period, delay, hand, loop, damping, wall.mass),
                *(measured, predicted, rule, passive),
            )
        )
    return found


Z_CAPTION = (
    "Stiffest stable joint constraint over damping, without a hand, closed by the "
    "controller or (crosses) in the device. Marks: sessions. "
    "Lines: eigenvalues of the loop. Dotted: the rule (b + B) / (T / 2 + t_d). Right: the same "
    "without units, m the device's mass along the constraint and τ = T / 2 + t_d; what little "
    "differs is the shortest delay."
)
# Marks of a group of the M-width are between 1 / APART and APART times their place.
APART = 1.25
M_CAPTION = (
    "Lightest felt inertia that is stable, over the mass of a hand fixed to the device, both "
    "over the device's. Marks: sessions, set apart sideways about the mass that they are of. Line: "
    "the rule m_a / (m_d + 2 m_a). Left of the dashed line: the scene's own hand, without mass."
)


def z_width_figure(points: Sequence[ZPoint]) -> Figure:
    """Return the Z-width of the first scene, with and without units."""
    figure = new_figure(12.0, 4.6, about([points[0].scene], Z_CAPTION))
    left, right = figure.subplots(1, 2)
    first = points[0].scene
    alone = [one for one in points if one.hand == "nobody" and one.scene == first]
    shown = [one for one in alone if one.loop == "controller"]
    groups = sorted({(one.delay, one.rate_hz) for one in shown}, key=latency, reverse=True)
    colours = colormaps["viridis"](np.linspace(0.0, 0.9, len(groups)))
    for colour, group in zip(colours, groups, strict=True):
        rows = [one for one in shown if (one.delay, one.rate_hz) == group]
        label = f"{group[0]} at {group[1]:.0f} Hz"
        tau = latency(group)
        dampings = np.array([one.damping for one in rows])
        scale = np.array([one.mass for one in rows]) / tau
        _walls(left, rows, dampings, np.ones(len(rows)), colour, label)
        _walls(right, rows, dampings / scale, scale / tau, colour, label)
        rules = [one.rule for one in rows]
        left.plot(dampings, rules, color=colour, linestyle=":", linewidth=1.0)
    near = [one for one in alone if one.loop == "device"]
    for delay, mark in zip(sorted({one.delay for one in near}), "x+", strict=False):
        rows = [one for one in near if one.delay == delay]
        walls = [np.nan if one.measured is None else one.measured for one in rows]
        label = f"{delay}, in the device"
        left.plot(
            [one.damping for one in rows], walls, mark, color=VERMILION, markersize=7, label=label
        )
    ends = np.array([0.0, 1.0])
    right.plot(ends, ends, color=GREY, linestyle=":", linewidth=1.2)
    right.set_ylim(0.0, 1.1)
    left.set_xscale("log")
    left.set_yscale("log")
    dress(left, "damping B (N s/m)", f"stiffness K of {first} (N/m)")
    dress(right, "B τ / m (1)", "K τ² / m (1)")
    handles, names = left.get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="outside right upper",
        fontsize=SMALL,
        frameon=False,
        title="delay, periods",
    )
    return figure


def latency(group: tuple[int, float]) -> float:
    """Return τ = T / 2 + t_d, s, of a delay in periods and a rate in Hz."""
    return (0.5 + group[0]) / group[1]


def _walls(
    axes: Axes, rows: Sequence[ZPoint], x: Array, unit: Array, colour: Array, label: str
) -> None:
    measured = np.array([np.nan if one.measured is None else one.measured for one in rows])
    predicted = np.array([np.nan if one.predicted is None else one.predicted for one in rows])
    axes.plot(x, measured / unit, "o", markersize=5, color=colour, label=label)
    axes.plot(x, predicted / unit, color=colour, linewidth=1.2)


def m_width_figure(points: Sequence[MPoint]) -> Figure:
    """Return the M-width of every scene."""
    figure = new_figure(8.5, 4.2, about([one.scene for one in points], M_CAPTION))
    axes = figure.subplots()
    shares = np.geomspace(0.15, 6.0, 60)
    rule = [lightest_mass(1.0, share) for share in shares]
    axes.plot(shares, rule, color=BLACK, linewidth=1.2, label="rule")
    alone = 0.1
    axes.axvline(0.13, color=GREY, linestyle="--", linewidth=1.0)
    scenes = list(dict.fromkeys(one.scene for one in points))
    few = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)
    colours = few if len(scenes) <= len(few) else colormaps["tab20"](range(20))
    # Series that agree would hide each other.
    apart = iter(np.geomspace(1.0 / APART, APART, 2 * len(scenes)))
    for index, scene in enumerate(scenes):
        for local, mark in ((True, "o"), (False, "x")):
            sideways = next(apart)
            rows = [one for one in points if one.scene == scene and one.local is local]
            x = [sideways * (one.share or alone) for one in rows]
            y = [np.nan if one.measured is None else one.measured for one in rows]
            label = f"{scene}, loop in {'device' if local else 'controller'}"
            colour = colours[index % len(colours)]
            axes.plot(x, y, mark, markersize=6, fillstyle="none", color=colour, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    dress(axes, "mass of the hand / mass of the device (1)", "lightest felt / device inertia (1)")
    figure.legend(loc="outside right upper", fontsize=SMALL, frameon=False)
    return figure


# Masses of hands fixed to the device, relative to the device's mass.
SHARES = (1.0 / 3.0, 1.0, 3.0)
WHAT = ("z", "m", "loads")


@dataclass(frozen=True, slots=True)
class Load:
    """Results of steady pushes and of the scene's own experiment.

    Attributes:
        scene: its name.
        delay: periods from measuring to acting.
        yields: displacements by a push along each direction; empty if the session failed.
        experience: results of the experiment.
    """

    scene: str
    delay: int
    yields: tuple[Yield, ...]
    experience: Experience


@dataclass(frozen=True, slots=True)
class Case:
    """One measurement.

    Attributes:
        what: ``z``, ``m`` or ``loads``.
        scene: to measure.
        delay: periods.
        hand: for ``z``, ``nobody`` or ``still``.
        share: for ``m``, mass of the hand over that of the device; None for the scene's hand.
    """

    what: str
    scene: Scene
    delay: int
    hand: str = "nobody"
    share: float | None = None

    def __str__(self) -> str:
        rate = f"{1.0 / self.scene.simulation.period:.0f} Hz"
        names = {"z": "Z-width", "m": "M-width", "loads": "loads"}
        return f"{names[self.what]} of {self.scene.name}, {rate}, {self.delay} periods of delay"


Found = ZPoint | MPoint | Load


def cases_of(
    scenes: Sequence[Scene],
    delays: Sequence[int],
    rates: Sequence[float],
    what: Sequence[str] = WHAT,
) -> list[Case]:
    """Return the measurements: each delay at a scene's own rate, and each rate with one period.

    Args:
        scenes: to measure.
        delays: periods from measuring to acting.
        rates: Hz, further rates for Z-widths.
        what: any of ``z``, ``m`` and ``loads``.

    Raises:
        InvalidInputError: a delay below 0, a rate below 10 Hz, or an unknown measurement.
    """
    for delay in delays:
        check_not_negative(delay=delay)
    for name in what:
        check_one_of("what", name, WHAT)
    cases = []
    for scene in map(of_first_user, scenes):
        hands = ["nobody", "still"] if isinstance(scene.hand, TargetHand) else ["nobody"]
        if "z" in what and directions(scene).held.size:
            late = with_loop(scene, False)
            own = [(late, delay) for delay in delays]
            others = [(at_rate(late, rate), 1) for rate in rates]
            kept = {(one.simulation.period, delay): one for one, delay in [*others, *own]}
            for (_, delay), one in kept.items():
                cases += [Case("z", one, delay, hand) for hand in hands]
            near = with_loop(scene, True)
            cases += [Case("z", near, delay) for delay in sorted({min(delays), max(delays)})]
        if "m" in what:
            shares = [*SHARES, *([None] if len(hands) > 1 else [])]
            cases += [Case("m", with_loop(scene, True), 1, share=share) for share in shares]
            cases.append(Case("m", with_loop(scene, False), 1, share=1.0))
        if "loads" in what:
            cases.append(Case("loads", scene, 1))
    return cases


def _measured(case: Case) -> list[Found]:
    """Carry out one measurement.

    Returns:
        Its results.

    Raises:
        HapticMechError: a scene that cannot run.
    """
    if case.what == "z":
        return list(z_width(case.scene, delay=case.delay, hand=case.hand))
    if case.what == "m":
        return [m_width(case.scene, delay=case.delay, share=case.share)]
    setup = Setup(case.scene, delay=case.delay)
    try:
        yields = tuple(penetration(setup))
    except HapticMechError:
        yields = ()
    return [Load(case.scene.name, case.delay, yields, experience(setup))]


@dataclass(frozen=True)
class Limits(SharedResults):
    """All results.

    Attributes:
        z_width: stiffest stable joint constraints.
        m_width: lightest and heaviest stable inertias.
        loads: penetration, and results of experiments.
    """

    NAME: ClassVar[str] = "limits"

    z_width: tuple[ZPoint, ...]
    m_width: tuple[MPoint, ...]
    loads: tuple[Load, ...]

    def sheets(self) -> Iterator[Sheet]:
        """Yield a table for each kind of measurement."""
        if self.z_width:
            yield _z_sheet(self.z_width)
        if self.m_width:
            yield _m_sheet(self.m_width)
        if self.loads:
            yield _load_sheet(self.loads)

    def figures(self) -> Mapping[str, Figure]:
        """Return Z-width of the first scene and M-width of all scenes, measured and predicted."""
        z, m = self.z_width, self.m_width
        return {
            **({"z_width.png": z_width_figure(z)} if z else {}),
            **({"m_width.png": m_width_figure(m)} if m else {}),
        }


def limits(cases: Sequence[Case], workers: Workers = 1, show: Show = silent) -> Limits:
    """Carry out all measurements.

    Args:
        cases: from :func:`cases_of`.
        workers: that share the cases; they do not affect the results.
        show: called after each case.

    Returns:
        Results of all cases.

    Raises:
        InvalidInputError: no process.
    """
    measured, lost = shared(_measured, cases, workers, show)
    found = list(chain.from_iterable(measured))
    return Limits(
        tuple(one for one in found if isinstance(one, ZPoint)),
        tuple(one for one in found if isinstance(one, MPoint)),
        tuple(one for one in found if isinstance(one, Load)),
        lost=lost,
    )


def _z_sheet(points: Sequence[ZPoint]) -> Sheet:
    """Return the stiffest stable joint constraint at each rate, delay and hand, and its damping.

    Further columns: range of the ratio of measured to eigenvalue limit over all dampings, and ratio
    of measured limit to the rule at the smallest damping and at that of the stiffest constraint.
    """
    lines = []
    for (scene, rate, delay, hand, loop), group in groupby(
        points, lambda one: (one.scene, one.rate_hz, one.delay, one.hand, one.loop)
    ):
        rows = list(group)
        best = max(rows, key=lambda one: one.measured or 0.0)
        seen = [_ratio(one.measured, one.predicted) for one in rows]
        known = [one for one in seen if one is not None]
        lines.append(
            (
                *(scene, f"{rate:.0f}", str(delay), hand, loop),
                number(best.measured, ".3g"),
                f"{best.damping:.3g}",
                f"{min(known):.2f} - {max(known):.2f}" if known else NOTHING,
                ", ".join(number(_ratio(one.measured, one.rule), ".2f") for one in (rows[0], best)),
            )
        )
    headings = ("scene", "Hz", "delay", "hand", "loop in", "K N/m", "B N s/m", "/ eigen", "/ rule")
    return Sheet("stiffest stable joint constraint", headings, tuple(lines))


def _m_sheet(points: Sequence[MPoint]) -> Sheet:
    lines = tuple(
        (
            *(one.scene, str(one.delay), "device" if one.local else "controller"),
            "the scene's" if one.hand == "scene" else f"{one.share:.2f} m_d",
            f"{one.own:.2f}",
            *(number(value, ".3f") for value in (one.measured, one.predicted, one.rule)),
            f"{one.heaviest:g}",
        )
        for one in points
    )
    headings = ("delay", "loop in", "hand", "own", "lightest", "eigen", "rule", "heaviest")
    return Sheet("stable felt inertia over the device's inertia", ("scene", *headings), lines)


def _load_sheet(loads: Sequence[Load]) -> Sheet:
    """Return the penetration that deviates most from F / k, and results of the experiments."""
    lines = []
    for load in loads:
        seen = load.experience
        depths = [one.error / one.expected for one in load.yields if one.held]
        contact = seen.contact_error
        lines.append(
            (
                *(load.scene, str(len(depths))),
                f"{max(depths, key=lambda one: abs(one - 1.0)):.4f}" if depths else NOTHING,
                f"{1e3 * seen.drift_rms:.3f}" + ("" if seen.kept else " (lost)"),
                f"{1e3 * seen.penetration_rms:.3f}",
                NOTHING if contact is None else f"{100.0 * contact:.2g} %",
                f"{1e3 * seen.hand_energy:.3f}",
                f"{1e3 * seen.left_energy:.3f}",
            )
        )
    headings = ("constraints", "depth k/F", "drift mm", "depth mm", "contact", "E_h mJ", "rest mJ")
    return Sheet("penetration, drift, contact error, energy", ("scene", *headings), tuple(lines))


def _ratio(measured: float | None, predicted: float | None) -> float | None:
    return None if measured is None or not predicted else measured / predicted
