# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ablation: from options to results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import typer

from benchmarks.ablation.findings import (
    AblationStep,
    Unused,
    ablation_steps,
    moves_alike,
    side_by_side,
    time_in_turn,
    unused,
)
from benchmarks.ablation.loop import PARTS
from benchmarks.ablation.scenes import ladder, pairs
from benchmarks.machine import MachineResults, machine
from hapticmech_ros.analysis.study import Marked, Sheet, Show, judged, silent
from hapticmech_ros.cli.console import OutOption
from hapticmech_ros.cli.study import JsonOption, carry_out


@dataclass(frozen=True, slots=True)
class Settings:
    """How long to look.

    Attributes:
        rounds: turns of each scene.
        ticks: that are timed in a turn.
        checked: ticks after which the scenes of a pair are compared.
    """

    rounds: int = 60
    ticks: int = 100
    checked: int = 200


@dataclass(frozen=True)
class AblationResults(MachineResults):
    """All that was found.

    Attributes:
        settings: how long was looked.
        ladder: scenes, each with one feature more.
        unused: pairs with and without something that is not used.
    """

    NAME: ClassVar[str] = "bench_ablation"
    FAULT: ClassVar[str] = "scenes that are compared do not move alike"

    settings: Settings
    ladder: tuple[AblationStep, ...]
    unused: tuple[Unused, ...]

    @property
    def sound(self) -> bool:
        """Whether the scenes of all pairs move as they are to."""
        return all(pair.alike for pair in self.unused)

    def sheets(self) -> Iterator[Sheet]:
        """Yield what each feature costs, and what things cost that are there and not used."""
        numbers = ("nv", "m", "rank", "p50", "p90", "p99", "ratio", "more", "±")
        rows = tuple(
            (
                step.name,
                *(str(number) for number in (step.nv, step.rows, step.rank)),
                *(f"{value:.1f}" for value in (step.median_us, step.p90_us, step.p99_us)),
                f"{step.ratio:.2f}",
                f"{step.increment_us:+.1f}",
                f"{step.error_us:.1f}",
                *(f"{step.parts_us[part]:.1f}" for part in PARTS),
            )
            for step in self.ladder
        )
        yield Sheet("a tick of the session, µs", ("scene", *numbers, *PARTS), rows)
        rows = tuple(
            (
                one.name,
                f"{one.without_us:.1f}",
                f"{one.having_us:.1f}",
                f"{one.increment_us:+.2f}",
                f"{one.error_us:.2f}",
                Marked(one.verdict, "yellow" if one.costs else "green")
                if one.alike
                else judged("does not move alike", False),
            )
            for one in self.unused
        )
        yield Sheet(
            "what is not used",
            ("", "without", "with it", "difference", "±", "verdict"),
            rows,
            ("verdict",),
        )


def run_ablation(settings: Settings, show: Show = silent) -> AblationResults:
    """Compare the scenes of each pair, and time."""
    steps, couples = ladder(), pairs()
    alike = [moves_alike(pair, settings.checked) for pair in couples]
    show("timing the ladder")
    found = ablation_steps(steps, *time_in_turn(steps, settings.rounds, settings.ticks, show))
    compared = []
    for pair, same in zip(couples, alike, strict=True):
        show(f"timing the pair: {pair.name}")
        scenes = pair.without.scene(), pair.having.scene()
        times = side_by_side(scenes, settings.rounds, settings.ticks)
        compared.append(unused(pair, same, *times))
    return AblationResults(machine(), settings, found, tuple(compared))


def ablation(
    rounds: Annotated[int, typer.Option(min=2, help="turns of each scene")] = 60,
    ticks: Annotated[int, typer.Option(min=1, help="ticks timed in a turn")] = 100,
    checked: Annotated[int, typer.Option(min=1, help="ticks after which pairs are compared")] = 200,
    quick: Annotated[bool, typer.Option("--quick", help="5 turns of 100 ticks")] = False,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Add features to a scene one at a time: what a tick costs more, and what is not used costs."""
    settings = Settings(5, 100, 100) if quick else Settings(rounds, ticks, checked)
    carry_out(lambda show: run_ablation(settings, show), out, json_only)
