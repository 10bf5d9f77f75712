# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ablation: from options to results."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import typer
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.ablation.agreement import Agreement, agreement
from benchmarks.ablation.findings import (
    ERRORS,
    AblationStep,
    Unused,
    ablation_steps,
    time_in_turn,
    time_pair,
    unused,
)
from benchmarks.ablation.loop import PARTS
from benchmarks.ablation.scenes import Variant, ladder, pairs
from benchmarks.machine import MachineResults, machine
from hapticmech_ros.analysis.study import Marked, Sheet, Show, judged, silent
from hapticmech_ros.cli.console import OutOption
from hapticmech_ros.cli.study import JsonOption, carry_out
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.experiment.figure_style import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    SMALL,
    TEXT,
    VERMILION,
    dress,
    legend,
    new_figure,
)
from hapticmech_ros.plan.scene_plan import plan_scene

COLOURS = dict(zip(PARTS, (BLUE, PURPLE, ORANGE, VERMILION), strict=True))
CAPTION = (
    "Left: a tick of the session; each scene has one feature more than the one above it. Bars are "
    "medians of the parts, the mark is the median of whole ticks, the line ends at their 99th "
    "percentile; numbers are times the first scene. Right: scenes with something that they do not "
    "use, less the same without it; lines are three standard errors."
)


@dataclass(frozen=True, slots=True)
class Settings:
    """How long to look.

    Attributes:
        rounds: turns of each scene.
        ticks: that are timed in a turn.
        checked: ticks in which kernels are compared with uncompiled ones.

    Raises:
        InvalidInputError: a number below 1; of rounds, below 2.
    """

    rounds: int = 60
    ticks: int = 100
    checked: int = 200

    def __post_init__(self) -> None:
        for name, value, least in (
            ("rounds", self.rounds, 2),
            ("ticks", self.ticks, 1),
            ("checked ticks", self.checked, 1),
        ):
            if value < least:
                raise InvalidInputError(name, value, f"must be {least} or more")


@dataclass(frozen=True)
class AblationResults(MachineResults):
    """All that was found.

    Attributes:
        settings: how long was looked.
        ladder: scenes, each with one feature more.
        unused: pairs with and without something that is not used.
    """

    NAME: ClassVar[str] = "bench_ablation"
    FAULT: ClassVar[str] = "kernels differ from their Python"

    settings: Settings
    ladder: tuple[AblationStep, ...]
    unused: tuple[Unused, ...]

    @property
    def sound(self) -> bool:
        """Whether kernels and their Python agree everywhere."""
        agree = [*(step.agrees for step in self.ladder), *(pair.agrees for pair in self.unused)]
        return all(agree)

    def sheets(self) -> Iterator[Sheet]:
        """Yield what each feature costs, and what things cost that are there and not used."""
        numbers = ("nv", "m", "rank", "apart", "p50", "p90", "p99", "ratio", "more", "±")
        rows = tuple(
            (
                step.name,
                *(str(number) for number in (step.nv, step.rows, step.rank)),
                f"{step.apart:.0e}" if step.agrees else judged(f"{step.apart:.0e}", False),
                *(f"{value:.1f}" for value in (step.median_us, step.p90_us, step.p99_us)),
                f"{step.ratio:.2f}",
                f"{step.increment_us:+.1f}",
                f"{step.error_us:.1f}",
                *(f"{step.parts_us[part]:.1f}" for part in PARTS),
            )
            for step in self.ladder
        )
        yield Sheet("a tick of the session, µs", ("scene", *numbers, *PARTS), rows)
        headings = ("", "without", "with it", "difference", "±", "verdict")
        rows = tuple(
            (
                one.name,
                f"{one.without_us:.1f}",
                f"{one.having_us:.1f}",
                f"{one.increment_us:+.2f}",
                f"{one.error_us:.2f}",
                Marked(one.verdict, "yellow" if one.costs else "green")
                if one.agrees
                else judged("implementations do not agree", False),
            )
            for one in self.unused
        )
        yield Sheet("what is not used", headings, rows, ("verdict",))

    def figures(self) -> Mapping[str, Figure]:
        """Return parts of a tick, scene by scene, and what is not used beside it."""
        height = 0.42 * max(len(self.ladder), len(self.unused)) + 1.4
        figure = new_figure(13.0, height, CAPTION)
        left, right = figure.subplots(1, 2, width_ratios=(2.0, 1.0))
        _ladder(left, self.ladder)
        _pairs(right, self.unused)
        return {"bench_ablation.png": figure}


def run_ablation(settings: Settings, show: Show = silent) -> AblationResults:
    """Check, and time."""
    steps, couples = ladder(), pairs()
    sides = [side for pair in couples for side in (pair.without, pair.having)]
    step_agreements = _agreements(steps, settings, show)
    side_agreements = _agreements(sides, settings, show)
    show("timing the ladder")
    times = time_in_turn(steps, settings.rounds, settings.ticks, show)
    plans = [plan_scene(step.scene()) for step in steps]
    found = ablation_steps([step.name for step in steps], plans, step_agreements, times)
    compared = []
    for index, pair in enumerate(couples):
        show(f"timing the pair: {pair.name}")
        both = time_pair(pair.without, pair.having, settings.rounds, settings.ticks)
        agree = side_agreements[2 * index].held and side_agreements[2 * index + 1].held
        compared.append(unused(pair, agree, *both))
    return AblationResults(machine(), settings, found, tuple(compared))


def ablation(
    rounds: Annotated[int, typer.Option(help="turns of each scene")] = 60,
    ticks: Annotated[int, typer.Option(help="ticks timed in a turn")] = 100,
    checked: Annotated[int, typer.Option(help="ticks compared with uncompiled ones")] = 200,
    quick: Annotated[bool, typer.Option("--quick", help="5 turns of 100 ticks")] = False,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Add features to a scene one at a time: what a tick costs more, and what is not used costs."""
    settings = Settings(5, 100, 100) if quick else Settings(rounds, ticks, checked)
    carry_out(lambda show: run_ablation(settings, show), out, json_only)


def _agreements(variants: Sequence[Variant], settings: Settings, show: Show) -> list[Agreement]:
    found = []
    for variant in variants:
        show(f"checking {variant.name}")
        found.append(agreement(variant.scene(), settings.checked))
    return found


def _ladder(axes: Axes, steps: Sequence[AblationStep]) -> None:
    for row, step in enumerate(steps):
        at = 0.0
        for part in PARTS:
            label = part if row == 0 else None
            axes.barh(row, step.parts_us[part], 0.62, left=at, color=COLOURS[part], label=label)
            at += step.parts_us[part]
        axes.plot((step.median_us, step.p99_us), (row, row), color=GREY, linewidth=1.2)
        axes.plot(step.median_us, row, "|", color=BLACK, markersize=11)
        text = f" {step.ratio:.2f}"
        axes.annotate(text, (step.p99_us, row), va="center", fontsize=SMALL, color="#555555")
    axes.set_yticks(range(len(steps)), [step.name for step in steps])
    axes.invert_yaxis()
    dress(axes, "time (µs)", "")
    legend(axes, len(PARTS))


def _pairs(axes: Axes, found: Sequence[Unused]) -> None:
    for row, one in enumerate(found):
        axes.barh(row, one.increment_us, 0.62, color=ORANGE if one.costs else SKY)
        reach = ERRORS * one.error_us
        ends = (one.increment_us - reach, one.increment_us + reach)
        axes.plot(ends, (row, row), color=BLACK, linewidth=1.2)
    axes.axvline(0.0, color=GREY, linewidth=1.0)
    axes.set_yticks(range(len(found)), [one.name for one in found])
    axes.invert_yaxis()
    dress(axes, "difference of a tick (µs)", "")
    axes.set_title("not used", fontsize=TEXT, loc="left")
