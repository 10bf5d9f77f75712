"""The memory benchmark from settings to files."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from hapticmech_ros.bench.machine import machine
from hapticmech_ros.bench.memory.graph_run import MINUTE, RATE_HZ, watch_graph
from hapticmech_ros.bench.memory.session_run import watch_session
from hapticmech_ros.bench.memory.trend import HOUR, WARM_UP_SHARE
from hapticmech_ros.bench.memory.watch import Grown, Watch, grown
from hapticmech_ros.bench.plan import LAYOUTS, Layout
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import load_scene

JSON_NAME, PLOT_NAME = "bench_memory.json", "bench_memory.png"

Show = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Settings:
    """What to watch, and for how long.

    Attributes:
        scene: shipped scene, or path of a file.
        hours: simulated by the session; 0 leaves it out.
        minutes: of the graph; 0 leaves it out.
        period: s between samples of the graph.
        layout: of the graph's processes.
        warm_up: share of the time that is not looked at.

    Raises:
        InvalidInputError: a number out of its range, nothing to do, or an unknown layout.
    """

    scene: str = "five_bar"
    hours: float = 1.0
    minutes: float = 60.0
    period: float = 5.0
    layout: Layout = "separate"
    warm_up: float = WARM_UP_SHARE

    def __post_init__(self) -> None:
        for name, value in (("hours", self.hours), ("minutes", self.minutes)):
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidInputError(name, value, "must be 0 or more")
        if self.hours == 0.0 and self.minutes == 0.0:
            raise InvalidInputError("hours and minutes", (0.0, 0.0), "must not both be 0")
        if not 0.0 < self.period <= 600.0:
            raise InvalidInputError("period", self.period, "must be above 0, at most 600 s")
        if self.layout not in LAYOUTS:
            raise InvalidInputError("layout", self.layout, f"must be one of {', '.join(LAYOUTS)}")
        if not 0.0 <= self.warm_up < 1.0:
            raise InvalidInputError("warm-up", self.warm_up, "must be 0 to below 1")


@dataclass(frozen=True, slots=True)
class Results:
    """All that was found.

    Attributes:
        machine: cores, kernel, versions.
        settings: what was watched.
        grown: by process.
        watches: samples of the ``session`` and of the ``graph``.
        said: by node, what it said of itself last.
    """

    machine: Mapping[str, object]
    settings: Settings
    grown: tuple[Grown, ...]
    watches: Mapping[str, Watch]
    said: Mapping[str, str]

    @property
    def flat(self) -> bool:
        """Whether nothing grows."""
        return all(one.trend.flat for one in self.grown)

    def document(self) -> dict[str, object]:
        """Return the results as plain dictionaries, lists and numbers."""
        processes = [
            {
                **asdict(one),
                "bytes_per_hour": one.trend.per_hour,
                "verdict": one.trend.verdict,
            }
            for one in self.grown
        ]
        samples = {
            name: {"times": watch.times, "resident": watch.resident}
            for name, watch in self.watches.items()
        }
        return {
            "machine": dict(self.machine),
            "settings": asdict(self.settings),
            "processes": processes,
            "said": dict(self.said),
            "samples": samples,
            "flat": self.flat,
        }


def run_memory(settings: Settings, out: Path, show: Show = lambda line: None) -> Results:
    """Watch session and graph, one after the other, and write results into ``out``.

    Writes ``bench_memory.json``, ``bench_memory.png`` and ``memory_nodes.log``.

    Raises:
        InvalidInputError: too short to say anything.
        BenchError: the graph did not work.
    """
    from hapticmech_ros.bench.memory.figure import draw

    out.mkdir(parents=True, exist_ok=True)
    watches: dict[str, Watch] = {}
    found: list[Grown] = []
    said: dict[str, str] = {}
    if settings.hours:
        scene = load_scene(settings.scene)
        ticks = round(settings.hours * HOUR / scene.simulation.period)
        watches["session"] = watch_session(scene, ticks, show)
        found += grown("session", watches["session"], ticks, settings.warm_up)
    if settings.minutes:
        watches["graph"], said = watch_graph(
            settings.scene, settings.minutes, settings.period, out, settings.layout, show
        )
        periods = round(settings.minutes * MINUTE * RATE_HZ)
        found += grown("graph", watches["graph"], periods, settings.warm_up)
    results = Results(machine(), settings, tuple(found), watches, said)
    text = json.dumps(results.document(), indent=1, ensure_ascii=False, allow_nan=False)
    (out / JSON_NAME).write_text(text + "\n", encoding="utf-8")
    draw(results.watches, settings.warm_up, out / PLOT_NAME)
    return results
