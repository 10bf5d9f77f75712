# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Transparency: felt over desired impedance of scenes, for both loops and several delays.

Over a graph of nodes a scripted hand pushes, and the device is recorded. The twist of the device is
fitted at the excitation's frequencies, also if a busy machine missed samples, and so is that of the
mechanism alone under the same F_h, the means of its samples, which gives the desired impedance: the
push moves the mechanism by centimetres, and a model linearised at its start would be off by some
percent.

The excitation has equal amplitudes at all frequencies: when a sample is missed, the device keeps an
old command meanwhile, and changes of F_h act as noise on a light device.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hapticmech_ros.analysis.felt_model import felt_model
from hapticmech_ros.analysis.impedance import (
    Felt,
    amplitudes,
    felt,
    free_directions,
    mechanism_twists,
    multisine,
)
from hapticmech_ros.analysis.scene_variants import LOOPS, of_first_user, with_loop
from hapticmech_ros.analysis.study import SharedResults, Sheet, Show, complex_parts, silent
from hapticmech_ros.analysis.touch import Setup, fine_times, write_script
from hapticmech_ros.bag import BagReader
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.experiment.figure_style import (
    BLUE,
    GREY,
    ORANGE,
    about,
    at_least,
    dress,
    legend_outside,
    new_figure,
)
from hapticmech_ros.graph.demo import record_graph, record_in_lockstep
from hapticmech_ros.loading import load_scene
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene, document_of
from hapticmech_ros.session import Session
from hapticmech_ros.wire.bounds import read
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.messages import DeviceStateMessage
from hapticmech_ros.wire.topics import DEVICE_STATE

FREQUENCIES_HZ = (1, 2, 3, 5, 7, 10, 14, 20, 30, 42)
# Amplitude at each frequency, N; settling time and measurement window, s.
PUSH_N = 0.05
SETTLING_S, WINDOW_S = 1.0, 4.0
# Duration in addition to that of the excitation, s.
SPARE_S = 0.3
# Share of samples that the device must have kept for a valid measurement. For two_link at 250 Hz,
# its processes stopped at random, the median error is 2 to 5 % with 99 % and 10 to 20 % with 95 %.
ENOUGH = 0.98


class FeelGraphError(HapticMechError):
    """A graph whose felt impedance could not be measured."""


def felt_over_graph(scene: Scene, over: str) -> list[Felt]:
    """Return the felt impedance along every free direction over a graph of a scene.

    Args:
        scene: to measure.
        over: one of :data:`OVER`, but not session.

    Raises:
        DemoError: a node ended, or the hand never started.
        LockstepError: the graph did not go on in lockstep.
        FeelGraphError: nothing was recorded, samples twice or out of order, or too few.
    """
    sample = Session(scene).tick()
    model = felt_model(scene)
    frequencies = np.array(FREQUENCIES_HZ, dtype=float)
    found = []
    for direction in free_directions(sample.analysis):
        with tempfile.TemporaryDirectory() as folder:
            times, forces, twists = _recorded(scene, direction, over, Path(folder))
        felt = _amplitudes(times, twists @ direction, frequencies)
        every, pushes = _without_gaps(times, forces, scene.simulation.period)
        later = np.concatenate((pushes[1:], pushes[-1:]))
        alone = mechanism_twists(Setup(scene, "", 1), 0.5 * (pushes + later))
        wanted = _amplitudes(every, alone @ direction, frequencies)
        steady = model.ratio(direction, frequencies)
        mass = 1.0 / float(direction @ sample.analysis.inverse_inertia @ direction)
        found.append(Felt(direction, mass, frequencies, wanted / felt, steady, steady))
    return found


def _amplitudes(times: Array, values: Array, frequencies: Array) -> Array:
    """Return the complex amplitudes (k,) of values (n,) after settling; times from the push on."""
    window = (times >= SETTLING_S) & (times < SETTLING_S + WINDOW_S)
    return amplitudes(times[window], values[window], frequencies)


def _without_gaps(times: Array, forces: Array, period: float) -> tuple[Array, Array]:
    """Return times (m,) of every period from the push on, and F_h (m, 6), held over gaps.

    Args:
        times: (n,) s, of the samples that there are.
        forces: (n, 6) F_h, N and N m.
        period: s.
    """
    places = np.round(times / period).astype(int)
    every = np.arange(places[-1] + 1)
    return period * every, forces[np.searchsorted(places, every, side="right") - 1]


def _recorded(
    scene: Scene, direction: Array, over: str, folder: Path
) -> tuple[Array, Array, Array]:
    """Return times (n,), s, from the push on, F_h and twists (n, 6) of a graph."""
    period, seconds = scene.simulation.period, SETTLING_S + WINDOW_S + SPARE_S
    time = fine_times(period, round(seconds / period))
    push = multisine(time, FREQUENCIES_HZ, np.full(len(FREQUENCIES_HZ), PUSH_N))
    script = folder / "push.csv"
    write_script(script, time, push[:, None] * direction)
    document = document_of(scene)
    document["hand"] = {"kind": "scripted", "file": script.name}
    path = folder / "felt.yaml"
    # JSON is YAML.
    path.write_text(json.dumps(document), encoding="utf-8")
    bag = folder / "bag"
    record = record_in_lockstep if over == "lockstep" else record_graph
    run = record(str(path), bag, over == "composed", seconds)
    if run.interruptions:
        reasons = [run.reason(), *([] if run.load is None else run.load.sentences())]
        raise FeelGraphError("; ".join(reasons))
    with BagReader(bag) as reader:
        (name,) = [one for one in reader.topics if one.endswith(f"/{DEVICE_STATE.name}")]
        samples = [read(DeviceStateMessage, decode(data)) for _, _, data in reader.serialized(name)]
    return from_the_push_on(
        np.array([one.stamp_ns for one in samples], dtype=float) * 1e-9,
        np.array([one.sample.hand_wrench for one in samples]),
        np.array([one.sample.twist for one in samples]),
        period,
    )


def from_the_push_on(
    stamps: Array, forces: Array, twists: Array, period: float
) -> tuple[Array, Array, Array]:
    """Return times (m,), s, F_h (m, 6) and twists (m, 6) of a device from its hand's push on.

    Args:
        stamps: (n,) s, of its samples.
        forces: (n, 6) F_h, N and N m.
        twists: (n, 6) m/s and rad/s.
        period: s, in which there should be a sample.

    Raises:
        FeelGraphError: no push, samples that are repeated, out of order, or too few.
    """
    pushed = np.flatnonzero(np.abs(forces).max(axis=1) > 0.0)
    if pushed.size < 100:
        raise FeelGraphError("no hand wrench was recorded, or rendering was interrupted")
    begun = slice(pushed[0], None)
    # While the recorder discovers the graph, messages arrive over paths of different delay.
    if not (np.diff(stamps[begun]) > 0.0).all():
        raise FeelGraphError("samples of the device are recorded twice, or out of order")
    times = stamps[begun] - stamps[pushed[0]]
    kept = np.count_nonzero((times >= SETTLING_S) & (times < SETTLING_S + WINDOW_S))
    if kept < ENOUGH * WINDOW_S / period:
        raise FeelGraphError(
            f"machine too busy: the device kept {kept / WINDOW_S:.0f} of {1.0 / period:.0f} "
            f"samples per second (rule: {ENOUGH:.0%}; by messages instead of time: --over lockstep)"
        )
    return times, forces[begun], twists[begun]


# Measured with a session, or with a graph of nodes in one process or in four, or in four that
# advance by messages instead of by time.
OVER = ("session", "composed", "processes", "lockstep")
FIGURE_CAPTION = (
    "Felt over desired impedance along each free direction of each scene, at the smallest delay. "
    "With the loop in the device it corrects commands by what the hand has done since. Dotted: "
    "3 dB."
)
TABLE_CAPTION = (
    "steady: error to 10 Hz that the model leaves once the start has died away; "
    "model: how far it is from what was measured, to 30 Hz"
)
# Smallest span of the phase's axis, degrees.
LEAST_PHASE = 1.0
CIRCLES = {"marker": "o", "markersize": 4.0, "fillstyle": "none", "linestyle": "none"}


@dataclass(frozen=True, slots=True)
class Row:
    """Felt impedance along one direction of a scene.

    Attributes:
        scene: its name.
        loop: where the force channel is closed, device or controller; for a graph, its layout.
        delay: periods from measuring to acting.
        felt: felt impedance along the direction.
    """

    scene: str
    loop: str
    delay: int
    felt: Felt

    def document(self) -> dict[str, object]:
        """Return the row as plain lists and numbers."""
        found = self.felt
        return {
            "scene": self.scene,
            "loop": self.loop,
            "delay_periods": self.delay,
            "direction": found.direction.tolist(),
            "mass": found.mass,
            "frequencies_hz": found.frequencies.tolist(),
            **complex_parts(found, ("ratio", "predicted", "steady")),
            "error_to_10_hz": found.error(10.0),
            "error_to_30_hz": found.error(30.0),
            "steady_error_to_10_hz": found.steady_error(10.0),
            "model_error_to_30_hz": found.model_error(30.0),
            "bandwidth_hz": found.bandwidth,
        }


@dataclass(frozen=True)
class Transparency(SharedResults):
    """Felt impedance of scenes.

    Attributes:
        rows: one for each direction.
    """

    NAME: ClassVar[str] = "impedance"
    FAULT: ClassVar[str] = "not every scene was measured"

    rows: tuple[Row, ...]

    def document(self) -> list[dict[str, object]]:
        """Return the rows as plain dictionaries."""
        return [row.document() for row in self.rows]

    def sheets(self) -> Iterator[Sheet]:
        """Yield a row for each scene, loop and delay, with the worst of its directions."""
        lines = []
        for key, group in groupby(self.rows, lambda row: (row.scene, row.loop, row.delay)):
            found = [row.felt for row in group]
            lines.append(
                (
                    *map(str, (*key, len(found))),
                    _percent(max(one.error(10.0) for one in found)),
                    _percent(max(one.error(30.0) for one in found)),
                    f"{min(one.bandwidth for one in found):g}",
                    _percent(max(one.steady_error(10.0) for one in found)),
                    _percent(max(one.model_error(30.0) for one in found)),
                )
            )
        headings = ("scene", "loop in", "delay", "directions", "to 10 Hz", "to 30 Hz", "3 dB, Hz")
        yield Sheet(
            "error of felt impedance, worst direction",
            (*headings, "steady", "model"),
            tuple(lines),
            ("loop in",),
            TABLE_CAPTION,
        )

    def figures(self) -> Mapping[str, Figure]:
        """Return magnitude and phase of felt over desired impedance."""
        figure = new_figure(9.0, 4.0, about([row.scene for row in self.rows], FIGURE_CAPTION))
        sizes, phases = figure.subplots(1, 2)
        least = min((row.delay for row in self.rows), default=0)
        legend: dict[str, Line2D] = {}
        for row in self.rows:
            if row.delay != least:
                continue
            colour = ORANGE if row.loop == "controller" else BLUE
            ways = (
                ("measured", row.felt.ratio, {"linewidth": 1.0}),
                ("predicted by the model", row.felt.predicted, CIRCLES),
            )
            for way, ratio, style in ways:
                for axes, values in (
                    (sizes, 20.0 * np.log10(np.abs(ratio))),
                    (phases, np.rad2deg(np.angle(ratio))),
                ):
                    (line,) = axes.semilogx(
                        row.felt.frequencies, values, color=colour, alpha=0.7, **style
                    )
                legend.setdefault(f"loop in {row.loop}, {way}", line)
        for level in (-3.0, 3.0):
            sizes.axhline(level, color=GREY, linestyle=":", linewidth=1.0)
        dress(sizes, "frequency (Hz)", "magnitude (dB)")
        dress(phases, "frequency (Hz)", "phase (°)")
        at_least(phases, span=LEAST_PHASE)
        legend_outside(figure, list(legend.values()), list(legend), 2)
        return {"impedance.png": figure}


def transparency(
    scenes: Sequence[str], delays: Sequence[int], show: Show = silent, over: str = "session"
) -> Transparency:
    """Measure every scene with both loops and each delay.

    Over a graph the loop is closed in the device, and the delay is that of the graph.

    Args:
        scenes: names or paths.
        delays: periods from measuring to acting, each 0 or more.
        show: called with each scene.
        over: one of :data:`OVER`.

    Returns:
        Felt impedance of every scene, loop, delay and direction.

    Raises:
        SceneError: a scene that cannot be loaded.
        InvalidInputError: as :func:`~hapticmech_ros.analysis.impedance.felt`.
        FeelGraphError: no scene's graph could be measured.
    """
    rows, refused = list[Row](), list[str]()
    for name in scenes:
        scene = of_first_user(load_scene(name))
        show(f"{scene.name}: {scene.description}")
        if over != "session":
            try:
                found = felt_over_graph(scene, over)
            except FeelGraphError as error:
                # The other scenes' minutes shall not be lost.
                refused.append(f"{scene.name}: {error}")
                continue
            rows += [Row(scene.name, over, 1, one) for one in found]
            continue
        for loop, local in LOOPS.items():
            for delay in delays:
                directions = felt(with_loop(scene, local), delay=delay)
                rows += [Row(scene.name, loop, delay, one) for one in directions]
    if refused and not rows:
        raise FeelGraphError("; ".join(refused))
    return Transparency(tuple(rows), lost=tuple(f"not measured: {one}" for one in refused))


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"
