"""The ablation from settings to files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from hapticmech_ros.bench.ablation.agreement import Agreement, agreement
from hapticmech_ros.bench.ablation.findings import Rung, Unused, rungs, unused
from hapticmech_ros.bench.ablation.ladder import ladder
from hapticmech_ros.bench.ablation.pairs import pairs
from hapticmech_ros.bench.ablation.timing import Show, time_in_turn, time_pair
from hapticmech_ros.bench.ablation.variant import Variant
from hapticmech_ros.bench.machine import machine
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.plan.scene_plan import plan_scene

JSON_NAME, PLOT_NAME = "bench_ablation.json", "bench_ablation.png"


@dataclass(frozen=True, slots=True)
class Settings:
    """How long to look.

    Attributes:
        rounds: turns of each scene.
        ticks: that are timed in a turn.
        checked: ticks in which kernels are compared with the readable implementation.

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


@dataclass(frozen=True, slots=True)
class Results:
    """All that was found.

    Attributes:
        machine: cores, kernel, versions.
        settings: how long was looked.
        rungs: scenes of the ladder.
        unused: pairs with and without something that is not used.
    """

    machine: Mapping[str, object]
    settings: Settings
    rungs: tuple[Rung, ...]
    unused: tuple[Unused, ...]

    @property
    def sound(self) -> bool:
        """Whether kernels and the readable implementation agree everywhere."""
        agree = [*(rung.agrees for rung in self.rungs), *(pair.agrees for pair in self.unused)]
        return all(agree)

    def document(self) -> dict[str, object]:
        """Return the results as plain dictionaries, lists and numbers."""
        pairs_found = [
            {**asdict(one), "share": one.share, "costs": one.costs, "verdict": one.verdict}
            for one in self.unused
        ]
        return {
            "machine": dict(self.machine),
            "settings": asdict(self.settings),
            "ladder": [asdict(rung) for rung in self.rungs],
            "unused": pairs_found,
            "sound": self.sound,
        }


def run_ablation(settings: Settings, out: Path, show: Show = lambda line: None) -> Results:
    """Check, time, and write ``bench_ablation.json`` and ``bench_ablation.png`` into ``out``."""
    from hapticmech_ros.bench.ablation.figure import draw

    steps, couples = ladder(), pairs()
    sides = [side for pair in couples for side in (pair.without, pair.having)]
    step_agreements = _agreements(steps, settings, show)
    side_agreements = _agreements(sides, settings, show)
    show("timing the ladder")
    times = time_in_turn(steps, settings.rounds, settings.ticks, show)
    plans = [plan_scene(step.scene()) for step in steps]
    found = rungs([step.name for step in steps], plans, step_agreements, times)
    compared = []
    for index, pair in enumerate(couples):
        show(f"timing the pair: {pair.name}")
        both = time_pair(pair.without, pair.having, settings.rounds, settings.ticks)
        agree = side_agreements[2 * index].held and side_agreements[2 * index + 1].held
        compared.append(unused(pair, agree, *both))
    results = Results(machine(), settings, found, tuple(compared))
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(results.document(), indent=1, ensure_ascii=False, allow_nan=False)
    (out / JSON_NAME).write_text(text + "\n", encoding="utf-8")
    draw(results.rungs, results.unused, out / PLOT_NAME)
    return results


def _agreements(variants: Sequence[Variant], settings: Settings, show: Show) -> list[Agreement]:
    found = []
    for variant in variants:
        show(f"checking {variant.name}")
        found.append(agreement(variant.scene(), settings.checked))
    return found
