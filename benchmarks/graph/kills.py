"""Nodes killed without warning, and started again: how long the device pushes on, and who suffers.

A node chosen at random is ended by SIGKILL while the device renders. Measured are the time from the
kill to the first sample of the device whose actuators are at zero, by the samples' own stamps, and
the time from the restart of the node until the device renders again. No other node may end.
"""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import typer

from benchmarks.children import Teller, finding_benchmarks, wait_until
from hapticmech_ros.analysis.study import Results, Sheet, Show, judged, silent
from hapticmech_ros.cli.console import OutOption, SceneArgument
from hapticmech_ros.cli.study import JsonOption, carry_out
from hapticmech_ros.graph import Graph, private_environment
from hapticmech_ros.nodes.entry import NODES
from hapticmech_ros.scene import load_scene

WATCH = "benchmarks.graph.force_watch"
DEVICE = "haptic_device"
WITHIN_S = 20.0
# Rendering for this long before the next kill: engaged, the force let in.
SETTLED_S = 0.7
GOAL_ZERO_S = 0.020
GOAL_RESUMED_S = 2.0


@dataclass(frozen=True, slots=True)
class Kill:
    """One node's end and return.

    Attributes:
        victim: its name.
        zero_after_s: from the kill to the first sample without force; None for the device itself,
            whose force ends with it.
        resumed_after_s: from the restart to the first sample with force.
        others_alive: whether every other node went on.
    """

    victim: str
    zero_after_s: float | None
    resumed_after_s: float
    others_alive: bool

    @property
    def good(self) -> bool:
        """Whether the device let go and came back in time, and nobody else ended."""
        zero = self.zero_after_s is None or self.zero_after_s <= GOAL_ZERO_S
        return zero and self.resumed_after_s <= GOAL_RESUMED_S and self.others_alive


@dataclass(frozen=True)
class KillResults(Results):
    """What came of all kills.

    Attributes:
        kills: in the order of time.
    """

    NAME: ClassVar[str] = "bench_kills"

    kills: tuple[Kill, ...]

    def sheets(self) -> Iterator[Sheet]:
        """Yield a line for each kill."""
        headings = ("killed", "zero force after, ms", "rendering again after, s", "others")
        rows = tuple(
            (
                kill.victim,
                "with it" if kill.zero_after_s is None else f"{1e3 * kill.zero_after_s:.1f}",
                f"{kill.resumed_after_s:.2f}",
                judged("went on", True) if kill.others_alive else judged("ended", False),
            )
            for kill in self.kills
        )
        yield Sheet("nodes killed", headings, rows)

    def notes(self) -> Iterable[str]:
        """Return the worst of all kills."""
        return [verdict(self.kills)]


def run_kills(scene: str, kills: int, seed: int, told: Show = silent) -> list[Kill]:
    """Kill and restart ``kills`` nodes of a running graph, one after the other.

    Raises:
        BenchError: the device never renders, or not again.
    """
    chance = random.Random(seed)
    environment = finding_benchmarks(private_environment())
    found = []
    with (
        Teller([sys.executable, "-m", WATCH], environment) as watch,
        Graph(scene, environment=environment) as graph,
    ):
        for _ in range(kills):
            _wait_for_settled(watch)
            victim = chance.choice(list(NODES))
            found.append(_kill(graph, watch, victim))
            told(_line(found[-1]))
    return found


def _kill(graph: Graph, watch: Teller, victim: str) -> Kill:
    before = len(watch.of("off"))
    killed_ns = time.time_ns()
    graph.kill(victim)
    zero_after = None
    if victim != DEVICE:
        wait_until(lambda: len(watch.of("off")) > before, WITHIN_S, "the device to let go")
        zero_after = (watch.of("off")[before]["stamp_ns"] - killed_ns) / 1e9
    alive = graph.ended() == [victim]
    seen = len(watch.of("on"))
    restarted_ns = time.time_ns()
    graph.restart(victim)
    if victim == DEVICE:
        # The watcher last heard "on" of a device that is no more.
        wait_until(lambda: len(watch.of("off")) > before, WITHIN_S, "the device to be back")
    wait_until(lambda: len(watch.of("on")) > seen, WITHIN_S, "the device to render again")
    resumed_after = (watch.of("on")[seen]["stamp_ns"] - restarted_ns) / 1e9
    return Kill(victim, zero_after, resumed_after, alive and not graph.ended())


def _wait_for_settled(watch: Teller) -> None:
    """Wait until the device has rendered without a break for a while."""

    def settled() -> bool:
        on, off = watch.of("on"), watch.of("off")
        if not on:
            return False
        since = on[-1]["stamp_ns"]
        unbroken = not off or off[-1]["stamp_ns"] < since
        return unbroken and bool(time.time_ns() - since > SETTLED_S * 1e9)

    wait_until(settled, WITHIN_S, "the device to render", watch.check)


def verdict(kills: Sequence[Kill]) -> str:
    """Return the worst of all kills, in a sentence."""
    zeros = [k.zero_after_s for k in kills if k.zero_after_s is not None]
    resumed = [k.resumed_after_s for k in kills]
    alive = all(k.others_alive for k in kills)
    word = "PASS" if all(k.good for k in kills) else "FAIL"
    return (
        f"{word}: {len(kills)} kills; zero force after {1e3 * max(zeros, default=0.0):.1f} ms at "
        f"worst (goal {1e3 * GOAL_ZERO_S:g} ms), rendering again {max(resumed):.2f} s after the "
        f"restart at worst (goal {GOAL_RESUMED_S:g} s), other nodes "
        f"{'all went on' if alive else 'ended too'}"
    )


def _line(kill: Kill) -> str:
    zero = "with it" if kill.zero_after_s is None else f"after {1e3 * kill.zero_after_s:.1f} ms"
    return f"{kill.victim}: force gone {zero}, back {kill.resumed_after_s:.2f} s after the restart"


def kills(
    scene: SceneArgument = "five_bar",
    number: Annotated[int, typer.Option("--kills", min=1, help="how many")] = 20,
    seed: Annotated[int, typer.Option(help="of the choice of victims")] = 0,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Kill nodes at random and start them again: how fast the device lets go and comes back."""
    load_scene(scene)
    carry_out(lambda show: KillResults(tuple(run_kills(scene, number, seed, show))), out, json_only)
