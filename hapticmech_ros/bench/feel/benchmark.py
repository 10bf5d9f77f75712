"""The feel of scenes, from plan to files."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from hapticmech_ros.bench.feel.figure import draw
from hapticmech_ros.bench.feel.impedance import felt
from hapticmech_ros.bench.feel.over_graph import felt_over_graph
from hapticmech_ros.bench.feel.row import Row
from hapticmech_ros.bench.feel.stability.variations import with_loop
from hapticmech_ros.scene import load_scene

JSON_NAME, PLOT_NAME = "bench_feel.json", "bench_feel.png"
# What closes force channel and joint constraint: the device, or the controller alone.
LOOPS = {"device": True, "controller": False}
# A session, or a graph of nodes in one process or in four.
OVER = ("session", "composed", "processes")

Show = Callable[[str], None]


def run_feel(
    scenes: Sequence[str],
    delays: Sequence[int],
    out: Path,
    show: Show = lambda line: None,
    over: str = "session",
) -> list[Row]:
    """Measure every scene with both loops and each delay; write JSON and picture into ``out``.

    Over a graph the loop is closed in the device, and the delay is what it is.

    Args:
        scenes: names or paths.
        delays: periods from measuring to acting, each 0 or more.
        out: folder, made if it is not there.
        show: told of each scene.
        over: of :data:`OVER`.

    Raises:
        SceneError: a scene that cannot be loaded.
        InvalidInputError: as :func:`~hapticmech_ros.bench.feel.impedance.felt`.
    """
    rows = []
    for name in scenes:
        loaded = load_scene(name)
        show(f"{loaded.name}: {loaded.description}")
        if over != "session":
            directions = felt_over_graph(loaded, over == "composed")
            rows += [Row(loaded.name, over, 1, one) for one in directions]
            continue
        for loop, local in LOOPS.items():
            for delay in delays:
                directions = felt(with_loop(loaded, local), delay=delay)
                rows += [Row(loaded.name, loop, delay, one) for one in directions]
    out.mkdir(parents=True, exist_ok=True)
    written = json.dumps([row.document() for row in rows], indent=1, ensure_ascii=False)
    (out / JSON_NAME).write_text(written + "\n", encoding="utf-8")
    draw(rows, out / PLOT_NAME)
    return rows
