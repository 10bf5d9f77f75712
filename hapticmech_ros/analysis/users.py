# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Felt impedance of scenes with several users, the others' arms included.

One user's device is pushed by a small multisine, the others hold the mechanism by their arms of
impedance Z, which stay where they took hold. With Y the admittance of the mechanism alone between
points, and b all points that the others hold, desired is

    v_a = (Y_aa - Y_ab Z (1 + Y_bb Z)⁻¹ Y_ba) F_a

Y is that of the simulator's own step, linearised (``analysis/felt_model.py``), converted to
continuous time: the push and the arms act all the time.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.linalg import block_diag, logm

from hapticmech_ros.analysis.felt_model import linear_point, response
from hapticmech_ros.analysis.impedance import (
    PUSH_N_PER_HZ,
    amplitudes,
    faded_in,
    free_directions,
    multisine,
)
from hapticmech_ros.analysis.scene_variants import NO_HAND, still
from hapticmech_ros.analysis.study import Results, Sheet, Show, complex_parts, silent
from hapticmech_ros.analysis.touch import fine_times, samples_of, scripted
from hapticmech_ros.device.hand import spring_gains
from hapticmech_ros.errors import InvalidInputError, listed
from hapticmech_ros.experiment.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    SMALL,
    about,
    dress,
    legend_outside,
    new_figure,
)
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational import Analyser
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.hand import (
    ArmHand,
    ConstantWrenchHand,
    Hand,
    SpringDamperHand,
    TargetHand,
)
from hapticmech_ros.session.shared_session import SharedSession
from hapticmech_ros.simulation import Simulator

FREQUENCIES_HZ = (1, 2, 3, 5, 7, 10, 14, 20, 30)
# Times in which the push fades in, the transient decays, and the response is analysed, s.
FADING_S, SETTLING_S, WINDOW_S = 0.5, 8.0, 1.0
# Rows of the script in a second, at least two a period: at 4 kHz eight a period would exceed a
# script's size limit.
ROWS_PER_S = 8000.0


@dataclass(frozen=True, slots=True)
class FeltBesideOthers:
    """A user's felt impedance along one direction.

    Attributes:
        point: operational point that the user holds.
        direction: (6,) of the push, largest part 1 N or 0.02 N m, world axes.
        frequencies: (k,) Hz.
        ratio: (k,) complex, felt over desired impedance: 1 is ideal, larger is heavier.
        desired: (k,) complex, desired impedance along the direction, N s/m or N m s/rad.
        alone: (k,) the same of the mechanism without other hands.
    """

    point: str
    direction: Array
    frequencies: Array
    ratio: Array
    desired: Array
    alone: Array

    def error(self, frequency: float) -> float:
        """Return the largest |ratio - 1| up to a frequency, Hz."""
        return float(np.abs(self.ratio - 1.0)[self.frequencies <= frequency].max())

    @property
    def share(self) -> Array:
        """(k,) the others' change of the felt impedance, relative to the mechanism alone."""
        return np.asarray(np.abs(self.desired / self.alone - 1.0))


def felt_beside_others(scene: Scene, point: str) -> list[FeltBesideOthers]:
    """Return a user's felt impedance along every direction that is free at the start.

    Args:
        scene: with several ``hands``; the one at the point pushes, those of the others hold still.
        point: operational point of the user who pushes.

    Raises:
        InvalidInputError: a point that is not held, a scripted hand, or a period that does not
            divide 1 s or is too long for 30 Hz.
    """
    period, frequencies = scene.simulation.period, np.array(FREQUENCIES_HZ, dtype=float)
    samples = round(WINDOW_S / period)
    if abs(samples * period - WINDOW_S) > 1e-9 or samples < 4 * frequencies[-1]:
        rule = f"must divide {WINDOW_S:g} s and be below {0.25 / frequencies[-1]:.4f} s"
        raise InvalidInputError("simulation.period", period, rule)
    resting = _holding_still(scene, point)
    simulator = Simulator(resting)
    terms = simulator.evaluate(simulator.initial_state())
    directions = free_directions(Analyser(simulator.mechanism, point).analyse(terms))
    desired, alone = admittances(resting, simulator, point, frequencies)
    rows = max(2, round(ROWS_PER_S * period))
    fine = fine_times(period, round((SETTLING_S + WINDOW_S) / period), rows)
    push = multisine(fine, FREQUENCIES_HZ, PUSH_N_PER_HZ * frequencies)
    push *= faded_in(fine, FADING_S)
    times = samples_of(fine, rows)
    last = slice(times.size - samples, None)
    given = amplitudes(times[last], samples_of(push, rows)[last], frequencies)
    calm, found = _twists(resting, point, fine, np.zeros((fine.size, 6)), times.size), []
    for direction in directions:
        moved = (
            _twists(resting, point, fine, push[:, None] * direction, times.size) - calm
        ) @ direction
        felt = given / amplitudes(times[last], moved[last], frequencies)
        wanted, free = (
            1.0 / np.einsum("i,kij,j->k", direction, one, direction) for one in (desired, alone)
        )
        found.append(FeltBesideOthers(point, direction, frequencies, felt / wanted, wanted, free))
    return found


def _holding_still(scene: Scene, point: str) -> Scene:
    """Return the scene without the hand at a point, and all others where they take hold.

    Raises:
        InvalidInputError: a point that is not held, or a hand whose impedance is not known.
    """
    if point not in scene.held_points or len(scene.held_points) < 2:
        rule = f"must be one of several points that are held, here {listed(scene.held_points)}"
        raise InvalidInputError("point", point, rule)
    hands = []
    for name in scene.held_points:
        own = scene.held_at(name)
        if name != point and not isinstance(own.hand, TargetHand | ConstantWrenchHand):
            rule = "must be an arm, spring_damper or constant_wrench, whose impedance is known"
            raise InvalidInputError("hand", own.hand.kind, rule)
        holds = name != point and isinstance(own.hand, TargetHand)
        hand = still(own.hand) if holds else NO_HAND
        entry = {"point": name, "hand": hand, "device": own.device}
        hands.append(entry | {"controller": own.controller, "connection": own.connection})
    return scene.with_(hands=hands)


def hand_impedance(hand: Hand, s: complex) -> Array:
    """Return Z(s) (6, 6) of a hand that holds still, N s/m and N m s/rad, world axes.

    It is s M + D + K / s; behind a grip with Z_g = D_g + K_g / s it is (1 / Z + 1 / Z_g)⁻¹.

    Args:
        hand: an arm, a spring and damper, or none.
        s: complex frequency, 1/s; not 0.
    """
    if not isinstance(hand, ArmHand | SpringDamperHand):
        return np.zeros((6, 6), dtype=complex)
    stiffness, damping = spring_gains(hand)
    along = damping + stiffness / s
    if isinstance(hand, ArmHand):
        along += s * np.repeat((hand.mass, hand.angular_inertia), 3)
        if hand.grip is not None:
            held, lost = spring_gains(hand.grip)
            grip = lost + held / s
            along = along * grip / (along + grip)
    return np.diag(along)


def _twists(scene: Scene, point: str, times: Array, pushes: Array, ticks: int) -> Array:
    """Return twists (ticks, 6) of the device that is pushed, given the rows of a hand's script."""
    with scripted(times, pushes) as hand:
        hands = [
            one.model_copy(update={"hand": hand}) if one.point == point else one
            for one in scene.hands
        ]
        session = SharedSession(scene.model_copy(update={"hands": tuple(hands)}))
    return session.run(ticks)[point]["device_true_twist"]


def admittances(
    scene: Scene, simulator: Simulator, point: str, frequencies: Array
) -> tuple[Array, Array]:
    """Return the admittance of a mechanism at a point, with the others' arms and without.

    Args:
        scene: with several ``hands``.
        simulator: of the scene.
        point: operational point, of one of them.
        frequencies: (k,) Hz, not 0.

    Returns:
        Twist per wrench, (k, 6, 6) complex each, world axes, m/s and rad/s per N and N m.
    """
    names = [point, *(name for name in scene.held_points if name != point)]
    state, period = simulator.initial_state(), simulator.period
    points = [linear_point(simulator, state, name) for name in names]
    size, width = len(points[0].step), 6 * len(points)
    whole = np.eye(size + width)
    whole[:size, :size] = points[0].step
    whole[:size, size:] = np.hstack([one.push for one in points])
    rates = np.real(logm(whole)) / period
    shown = np.vstack([one.twist for one in points])
    # s = i ω of ẋ = A x + B u.
    y = response(rates[:size, :size], rates[:size, size:], shown, 2j * np.pi * frequencies)
    hands, held = [scene.held_at(name).hand for name in names[1:]], []
    for one, frequency in zip(y, frequencies, strict=True):
        s = 2j * np.pi * frequency
        z = block_diag(*(hand_impedance(hand, s) for hand in hands))
        shared = np.linalg.solve(np.eye(len(z)) + one[6:, 6:] @ z, one[6:, :6])
        held.append(one[:6, :6] - one[:6, 6:] @ z @ shared)
    return np.array(held), y[:, :6, :6]


CAPTION = (
    "Impedance that a user's hand feels along each direction that the mechanism leaves free, "
    "beside the desired one: the mechanism with the others' arms on it."
)
TABLE_CAPTION = (
    "error: felt over desired impedance less 1, complex; arms: by how much the others' arms change "
    "what is felt"
)


@dataclass(frozen=True, slots=True)
class Row:
    """A user's felt impedance along one direction.

    Attributes:
        scene: its name.
        period: s.
        felt: along the direction.
    """

    scene: str
    period: float
    felt: FeltBesideOthers

    def document(self) -> dict[str, object]:
        """Return the row as plain lists and numbers."""
        found = self.felt
        return {
            "scene": self.scene,
            "period": self.period,
            "point": found.point,
            "direction": found.direction.tolist(),
            "frequencies_hz": found.frequencies.tolist(),
            **complex_parts(found, ("ratio", "desired", "alone")),
            "error_to_10_hz": found.error(10.0),
        }


@dataclass(frozen=True)
class Users(Results):
    """Felt impedance of scenes with several users.

    Attributes:
        rows: one for each user and direction.
    """

    NAME: ClassVar[str] = "users"

    rows: tuple[Row, ...]

    def document(self) -> list[dict[str, object]]:
        """Return the rows as plain dictionaries."""
        return [row.document() for row in self.rows]

    def sheets(self) -> Iterator[Sheet]:
        """Yield a row for each scene, period and user, with the worst of its directions."""
        lines, headings = [], ("scene", "user at", "period, ms", "directions")
        hertz: tuple[str, ...] = ()
        for key, group in groupby(self.rows, lambda row: (row.scene, row.felt.point, row.period)):
            found = [row.felt for row in group]
            worst = np.max([np.abs(one.ratio - 1.0) for one in found], axis=0)
            hertz = tuple(f"{one:g} Hz" for one in found[0].frequencies)
            shares = [one.share for one in found]
            arms = f"{100.0 * np.min(shares):.0f} to {100.0 * np.max(shares):.0f} %"
            errors = (f"{100.0 * one:.2g} %" for one in worst)
            scene, point, period = key
            lines.append((scene, point, f"{1e3 * period:g}", str(len(found)), *errors, arms))
        yield Sheet(
            "error of felt impedance beside others, worst direction",
            (*headings, *hertz, "arms"),
            tuple(lines),
            ("user at",),
            TABLE_CAPTION,
        )

    def figures(self) -> Mapping[str, Figure]:
        """Return felt and desired impedance over frequency, a panel for each user."""
        users = list(dict.fromkeys((row.scene, row.felt.point) for row in self.rows))
        figure = new_figure(
            9.0, 1.2 + 2.6 * len(users), about([row.scene for row in self.rows], CAPTION)
        )
        panels = figure.subplots(len(users), 2, squeeze=False)
        for (size, phase), (scene, point) in zip(panels, users, strict=True):
            mine = [row for row in self.rows if (row.scene, row.felt.point) == (scene, point)]
            least = min(row.period for row in mine)
            for row in mine:
                if row.period == least:
                    _draw(size, phase, row.felt)
            dress(size, "frequency (Hz)", "impedance (dB, 0 is 1 N s/m)")
            dress(phase, "frequency (Hz)", "phase (°)")
            size.set_title(f"{scene}, user at {point}", fontsize=SMALL, loc="left")
        lines = panels[0][0].get_lines()[:3]
        legend_outside(figure, lines, ["desired", "mechanism alone", "felt"], 3)
        return {"users.png": figure}


def users(scenes: Sequence[Scene], show: Show = silent) -> Users:
    """Measure every user's felt impedance in some scenes.

    Args:
        scenes: with several ``hands`` each.
        show: called with each scene.

    Returns:
        Felt impedance of every user along every free direction.

    Raises:
        InvalidInputError: as :func:`~hapticmech_ros.analysis.users.felt_beside_others`.
    """
    rows: list[Row] = []
    for scene in scenes:
        for point in scene.held_points:
            show(f"{scene.name}, {point}: {scene.description}")
            found = felt_beside_others(scene, point)
            rows += [Row(scene.name, scene.simulation.period, one) for one in found]
    return Users(tuple(rows))


def _draw(size: Axes, phase: Axes, found: FeltBesideOthers) -> None:
    felt = found.ratio * found.desired
    ways: tuple[tuple[Array, str, dict[str, Any]], ...] = (
        (found.desired, BLUE, {"linewidth": 1.4, "alpha": 0.7}),
        (found.alone, GREY, {"linewidth": 0.9, "linestyle": "dotted"}),
        (felt, ORANGE, {"marker": "o", "markersize": 3.5, "linestyle": "none", "alpha": 0.8}),
    )
    for values, colour, style in ways:
        size.semilogx(found.frequencies, 20.0 * np.log10(np.abs(values)), color=colour, **style)
        phase.semilogx(found.frequencies, np.rad2deg(np.angle(values)), color=colour, **style)
