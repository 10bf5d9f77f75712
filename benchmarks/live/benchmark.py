# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of the live page: pictures a second, and from mouse to force, in a graph too."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
import typer

from benchmarks.machine import MachineResults, machine
from hapticmech_ros.analysis.study import Sheet, Show, number, silent
from hapticmech_ros.cli.console import OutOption
from hapticmech_ros.cli.study import JsonOption, carry_out
from hapticmech_ros.live.commands import Open, Reset
from hapticmech_ros.live.settings import OWN_HAND, VISER, changes_of
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.numerics import Array
from hapticmech_ros.system.installation import refuse_unmet

if TYPE_CHECKING:
    from benchmarks.live.browser import Page
    from benchmarks.live.served import Served

# Of the scene that is dragged: the mouse moves a pixel at a time, so often a second.
DRAGGED, MOVES, MOVES_HZ = "five_bar", 150, 60.0
# Counts the frames in which something is drawn: a page whose scene stands still draws nothing.
_COUNTING = """(() => { window.drawn = 0; let fresh = true;
  const draw = WebGL2RenderingContext.prototype.clear;
  WebGL2RenderingContext.prototype.clear = function(...given) {
    if (fresh) { window.drawn += 1; fresh = false; requestAnimationFrame(() => { fresh = true; }); }
    return draw.apply(this, given); }; })()"""
# When the browser told the page of a move, ms of the wall clock, and where the mouse was.
_LISTENING = """window.moves = []; addEventListener('pointermove', e => window.moves.push(
  [performance.timeOrigin + performance.now(), e.clientX]), true)"""
_FRAMES = """new Promise(done => { const begun = performance.now(), first = window.drawn;
  setTimeout(() => done(1000 * (window.drawn - first) / (performance.now() - begun)), %d); })"""


@dataclass(frozen=True, slots=True)
class Seen:
    """What was measured of one scene.

    Attributes:
        scene: by name.
        frames_hz: pictures that the browser drew.
        factor: simulated over real time meanwhile.
    """

    scene: str
    frames_hz: float
    factor: float


@dataclass(frozen=True)
class LiveResults(MachineResults):
    """Pictures a second of scenes, and times from a move of the mouse to its force.

    Attributes:
        seen: by scene.
        from_mouse: p50 and p95, ms, from when the mouse moved.
        from_page: likewise, from when the browser, which waits for its frames, told the page.
        moves: of the mouse.
        graph_mouse, graph_page: likewise, until the wrench arrives in a running graph.
        jumps: of the mouse there.
    """

    NAME: ClassVar[str] = "bench_live"

    seen: tuple[Seen, ...]
    from_mouse: tuple[float, float]
    from_page: tuple[float, float]
    moves: int
    graph_mouse: tuple[float, float]
    graph_page: tuple[float, float]
    jumps: int

    def sheets(self) -> Iterator[Sheet]:
        """Yield pictures by scene, then the times."""
        yield Sheet(
            "pictures of the live page, headless Chromium, software rendering",
            ("scene", "pictures/s", "real-time factor"),
            tuple(
                (s.scene, number(s.frames_hz, ".0f"), number(s.factor, ".2f")) for s in self.seen
            ),
        )
        yield Sheet(
            f"from a move of the mouse to a tick with its force, {DRAGGED}",
            ("from", "p50, ms", "p95, ms"),
            (
                ("the mouse", *(number(value, ".0f") for value in self.from_mouse)),
                ("the page's event", *(number(value, ".0f") for value in self.from_page)),
            ),
            caption=f"{self.moves} moves",
        )
        yield Sheet(
            f"from a jump of the mouse to its wrench in a graph, {DRAGGED}",
            ("from", "p50, ms", "p95, ms"),
            (
                ("the mouse", *(number(value, ".0f") for value in self.graph_mouse)),
                ("the page's event", *(number(value, ".0f") for value in self.graph_page)),
            ),
            caption=f"{self.jumps} jumps",
        )


def run_benchmark(
    scenes: Sequence[str], rounds: int, seconds: float, jumps: int, show: Show = silent
) -> LiveResults:
    """Drag a scene, look at every one, then drag one in a graph.

    Args:
        scenes: by name.
        rounds: of drags.
        seconds: for which each scene is looked at.
        jumps: of the mouse in the graph.
        show: called with what is being done.

    Raises:
        BenchError: Chromium is not installed, or the page does not answer.
        InstallationError: viser is not installed.
    """
    refuse_unmet([VISER])
    # Here, as they need viser and what it brings.
    from benchmarks.live.browser import Browser
    from benchmarks.live.over_graph import drag_in_steps, running
    from benchmarks.live.served import Served

    names = list(dict.fromkeys((DRAGGED, *scenes)))
    with (
        tempfile.TemporaryDirectory() as folder,
        Served(names) as served,
        closing(Browser(Path(folder))) as browser,
    ):
        page = browser.page()
        page.prepare(_COUNTING)
        page.prepare(_LISTENING)
        served.opened_in(page)
        show(f"dragging {DRAGGED}")
        drags = [_drag(page, served) for _ in range(rounds)]
        seen = [_look(page, served, name, seconds, show) for name in scenes]
    with (
        tempfile.TemporaryDirectory() as folder,
        running(DRAGGED, Path(folder)) as (place, received),
        closing(Browser(Path(folder))) as browser,
    ):
        page = browser.page()
        page.prepare(_LISTENING)
        page.open(place)
        show(f"dragging {DRAGGED} in a graph")
        in_graph = drag_in_steps(page, received, DRAGGED, jumps)
    mouse, told = (np.concatenate([one[k] for one in drags]) for k in (0, 1))
    return LiveResults(
        machine(),
        tuple(seen),
        _shares(mouse),
        _shares(told),
        mouse.size,
        _shares(in_graph[0]),
        _shares(in_graph[1]),
        jumps,
    )


def _shares(taken: Array) -> tuple[float, float]:
    p50, p95 = 1e3 * np.percentile(taken, (50, 95))
    return float(p50), float(p95)


def _look(page: Page, served: Served, name: str, seconds: float, show: Show) -> Seen:
    from benchmarks.live.browser import wait_until

    show(name)
    served.process.send(Open(name, changes_of(load_scene(name), [OWN_HAND])))
    wait_until(lambda: page.text("live-scene") == name, f"{name} on the page")
    time.sleep(1.0)
    frames = float(page.ask(_FRAMES % round(1000 * seconds)))
    return Seen(name, frames, served.process.states[-1][1].factor)


def _drag(page: Page, served: Served) -> tuple[Array, Array]:
    """Return times, s, from moves (n,) and events (m,) to ticks that act on them."""
    from benchmarks.live.browser import wait_until
    from benchmarks.live.served import hold, sight

    states = served.process.states
    begun = time.monotonic()
    served.process.send(Reset())
    wait_until(lambda: states[-1][0] > begun + 1.0, "the session to begin anew")
    seen = sight(page, DRAGGED)
    x, y = seen.hand
    hold(page, (x, y))
    sent = np.zeros(MOVES)
    begun = time.monotonic()
    for move in range(MOVES):
        time.sleep(max(0.0, begun + move / MOVES_HZ - time.monotonic()))
        sent[move] = time.monotonic()
        page.mouse("mouseMoved", x - move, y, pressed=True)
    time.sleep(0.2)
    start = states[0][1].users[0].device[0, 3]
    drags = [drag for at, state in states if at > begun for drag in state.drags]
    goals = {drag.goal_at: (start - drag.goal[0]) * seen.scale for drag in drags}
    page.mouse("mouseReleased", x - MOVES, y)
    wait_until(lambda: not states[-1][1].drags, "the drag to end")
    times, pixels = np.array(list(goals)), np.array(list(goals.values()))

    def taken(moved: Array, at: Array) -> Array:
        acted = [
            times[pixels > pixel - 0.5][:1] - when for pixel, when in zip(moved, at, strict=True)
        ]
        return np.concatenate(acted)

    told = np.array([one for one in page.ask("window.moves") if 1.0 < x - one[1] < MOVES])
    page.ask("window.moves.length = 0")
    to_monotonic = time.monotonic() - time.time()
    return (
        taken(np.arange(float(MOVES)), sent),
        taken(x - told[:, 1], 1e-3 * told[:, 0] + to_monotonic),
    )


def live(
    scenes: Annotated[list[str] | None, typer.Argument(help="all shipped ones if none")] = None,
    rounds: Annotated[int, typer.Option(min=1, help="drags of 150 moves")] = 4,
    seconds: Annotated[float, typer.Option(min=0.5, help="s that each scene is looked at")] = 5.0,
    jumps: Annotated[int, typer.Option(min=1, help="jumps of the mouse in a graph")] = 200,
    quick: Annotated[bool, typer.Option(help="one drag, each scene a second, few jumps")] = False,
    out: OutOption = Path("bench"),
    json_only: JsonOption = False,
) -> None:
    """Count pictures of the live page, and time from the mouse to its force; needs Chromium."""
    if quick:
        rounds, seconds, jumps = 1, 1.0, 10
    chosen = scenes or list(shipped_scenes())
    carry_out(lambda show: run_benchmark(chosen, rounds, seconds, jumps, show), out, json_only)
