"""The accuracy benchmark from settings to files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from hapticmech_ros.bench.accuracy.plan import Setting
from hapticmech_ros.bench.accuracy.report import markdown
from hapticmech_ros.bench.accuracy.run import Run, measure
from hapticmech_ros.bench.machine import machine

JSON_NAME, TABLE_NAME = "bench_accuracy.json", "bench_accuracy.md"
PLOT_NAME = "bench_accuracy.png"

# Told before each run, and what it found.
Show = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Results:
    """All that the benchmark found.

    Attributes:
        machine: cores, kernel, versions.
        runs: in the order of the settings.
    """

    machine: Mapping[str, object]
    runs: tuple[Run, ...]

    @property
    def sound(self) -> bool:
        """Whether every case that ran with its own step and integrator came within tolerance."""
        return all(run.kept is True for run in self.runs if run.own)

    def document(self) -> dict[str, object]:
        """Return the results as plain dictionaries, lists and numbers."""
        runs = [
            {**asdict(run), "error": run.error, "real_time": run.real_time} for run in self.runs
        ]
        return {"machine": dict(self.machine), "runs": runs, "sound": self.sound}


def run_accuracy(
    settings: Sequence[Setting],
    out: Path,
    show: Show = lambda line: None,
    figure: Path | None = None,
) -> Results:
    """Carry out all runs and write results into ``out``.

    Writes ``bench_accuracy.json``, ``bench_accuracy.md`` (the table, at steps nearest each case's
    own) and the plot, ``bench_accuracy.png`` or ``figure``.
    """
    from hapticmech_ros.bench.accuracy.figure import draw

    out.mkdir(parents=True, exist_ok=True)
    runs = []
    for number, setting in enumerate(settings, start=1):
        show(f"{number} of {len(settings)}: {setting}")
        runs.append(measure(setting))
        if runs[-1].failure:
            show(f"  failed: {runs[-1].failure}")
    results = Results(machine(), tuple(runs))
    text = json.dumps(results.document(), indent=1, ensure_ascii=False, allow_nan=False)
    (out / JSON_NAME).write_text(text + "\n", encoding="utf-8")
    known = list({setting.case.name: setting.case for setting in settings}.values())
    (out / TABLE_NAME).write_text(markdown(runs, known), encoding="utf-8")
    draw(runs, known, figure or out / PLOT_NAME)
    return results
