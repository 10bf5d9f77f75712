"""The graph's benchmark from plan to files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from hapticmech_ros.bench.checks import Expected, expected
from hapticmech_ros.bench.children import Teller
from hapticmech_ros.bench.comparison import Comparison, compare
from hapticmech_ros.bench.goals import Verdict, verdicts
from hapticmech_ros.bench.graphs import graph_environment, probe_command
from hapticmech_ros.bench.machine import machine
from hapticmech_ros.bench.plan import Plan, scene_at_rate
from hapticmech_ros.bench.run import SETTLES_S, Run, measure
from hapticmech_ros.scene import load_scene
from hapticmech_ros.wire.topic import ANALYSER, CONTROLLER, DEVICE, MECHANISM

# Node that answers -> the clocked one whose samples it answers.
ANSWERING = {CONTROLLER: DEVICE, ANALYSER: MECHANISM}
JSON_NAME, PLOT_NAME = "bench_graph.json", "bench_graph.png"

# Told before each run, and when all is done.
Show = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Results:
    """All that a benchmark found.

    Attributes:
        machine: cores, kernel, versions.
        plan: what was run.
        session: what the real graph was expected to do.
        runs: in the order of time.
        comparisons: real and bare graph by configuration.
        goals: verdicts.
    """

    machine: Mapping[str, object]
    plan: Plan
    session: Expected
    runs: tuple[Run, ...]
    comparisons: tuple[Comparison, ...]
    goals: tuple[Verdict, ...]

    @property
    def sound(self) -> bool:
        """Whether every run gave figures and passed its checks, and both graphs are alike."""
        alike = all(one.alike is None or one.alike.held for one in self.comparisons)
        return alike and all(run.sound for run in self.runs)

    def document(self) -> dict[str, object]:
        """Return the results as plain dictionaries, lists and numbers."""
        return {**asdict(self), "sound": self.sound}


def run_benchmark(plan: Plan, out: Path, show: Show = lambda stage: None) -> Results:
    """Run all steps of a plan and write results into ``out``.

    Writes ``bench_graph.json``, ``bench_graph.png``, ``nodes.log`` (what the nodes printed) and
    ``scenes/``, copies of the scene at the plan's rates.

    Raises:
        SceneError: no such scene, or it refuses a rate.
        BenchError: ROS does not start.
    """
    from hapticmech_ros.bench.plot import plot

    scene = load_scene(plan.scene)
    point = scene.operational_point().name
    scenes = {rate: scene_at_rate(plan.scene, rate, out / "scenes") for rate in plan.rates_hz}
    (out / "nodes.log").unlink(missing_ok=True)
    show("simulating the same without ROS")
    session = expected(scene, plan.seconds + SETTLES_S)
    about = {**machine(), "rmw": _middleware()}
    runs: list[Run] = []
    for step in plan.steps():
        show(f"{step.configuration}: {step.kind} graph, run {step.repeat} of {plan.repeats}")
        path = scenes[step.configuration.rate_hz]
        runs.append(measure(step, path, point, plan.seconds, out, session))
        if runs[-1].failure:
            show(f"  no figures: {runs[-1].failure}")
    comparisons = tuple(
        compare(configuration, runs, ANSWERING, point) for configuration in plan.configurations()
    )
    results = Results(about, plan, session, tuple(runs), comparisons, verdicts(comparisons))
    text = json.dumps(results.document(), indent=1, ensure_ascii=False, allow_nan=False)
    (out / JSON_NAME).write_text(text + "\n", encoding="utf-8")
    plot(comparisons, out / PLOT_NAME, plan.seconds, plan.repeats)
    return results


def _middleware() -> str:
    with Teller(probe_command(), graph_environment()) as probe:
        return str(probe.of("ready")[0].get("rmw"))
