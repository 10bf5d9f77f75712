"""The comparison from plan to files."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from hapticmech_ros.bench.feel.comparison.figure import draw
from hapticmech_ros.bench.feel.comparison.side_by_side import Column, side_by_side
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene, load_scene
from hapticmech_ros.workers import worker_pool

JSON_NAME, PLOT_NAME = "bench_feel_compare.json", "bench_feel_compare.png"

Show = Callable[[str], None]


def run_comparison(
    scenes: Sequence[str],
    delays: Sequence[int],
    out: Path,
    processes: int = 1,
    show: Show = lambda line: None,
) -> list[Column]:
    """Compare the ways to render every scene at each delay; write JSON and picture into ``out``.

    Args:
        scenes: names or paths.
        delays: periods from measuring to acting, each 0 or more.
        out: folder, made if it is not there.
        processes: that share the scenes; it changes no figure.
        show: told of each scene that is done.

    Raises:
        SceneError: a scene that cannot be loaded.
        InvalidInputError: no process; as
            :func:`~hapticmech_ros.bench.feel.comparison.side_by_side.side_by_side`.
    """
    if processes < 1:
        raise InvalidInputError("processes", processes, "must be 1 or more")
    for delay in delays:
        if delay < 0:
            raise InvalidInputError("delay", delay, "must be 0 or more periods")
    cases = [(load_scene(name), delay) for name in scenes for delay in delays]
    columns: list[Column] = []
    if processes == 1:
        for case in cases:
            columns += _told(_compared(case), show)
    else:
        # Forked, a process would lack the threads that this one has.
        with worker_pool(processes) as pool:
            for found in pool.map(_compared, cases):
                columns += _told(found, show)
    out.mkdir(parents=True, exist_ok=True)
    written = json.dumps([one.document() for one in columns], indent=1, ensure_ascii=False)
    (out / JSON_NAME).write_text(written + "\n", encoding="utf-8")
    draw(columns, out / PLOT_NAME)
    return columns


def _compared(case: tuple[Scene, int]) -> list[Column]:
    scene, delay = case
    return side_by_side(scene, delay=delay)


def _told(columns: list[Column], show: Show) -> list[Column]:
    show(f"{columns[0].scene}, {columns[0].delay} periods of delay")
    return columns
