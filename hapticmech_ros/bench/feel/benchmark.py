"""The feel of scenes, from plan to files."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from hapticmech_ros.bench.feel.figure import draw
from hapticmech_ros.bench.feel.impedance import felt
from hapticmech_ros.bench.feel.row import Row
from hapticmech_ros.scene import Scene, load_scene

JSON_NAME, PLOT_NAME = "bench_feel.json", "bench_feel.png"
# How the force channel is closed: by the device, or by the controller alone.
LOOPS = {"device": True, "controller": False}

Show = Callable[[str], None]


def run_feel(
    scenes: Sequence[str], delays: Sequence[int], out: Path, show: Show = lambda line: None
) -> list[Row]:
    """Measure every scene with both loops and each delay; write JSON and picture into ``out``.

    Args:
        scenes: names or paths.
        delays: periods from measuring to acting, each 0 or more.
        out: folder, made if it is not there.
        show: told of each scene.

    Raises:
        SceneError: a scene that cannot be loaded.
        InvalidInputError: as :func:`~hapticmech_ros.bench.feel.impedance.felt`.
    """
    rows = []
    for name in scenes:
        loaded = load_scene(name)
        show(f"{loaded.name}: {loaded.description}")
        for loop, local in LOOPS.items():
            for delay in delays:
                directions = felt(with_loop(loaded, local), delay=delay)
                rows += [Row(loaded.name, loop, delay, one) for one in directions]
    out.mkdir(parents=True, exist_ok=True)
    written = json.dumps([row.document() for row in rows], indent=1, ensure_ascii=False)
    (out / JSON_NAME).write_text(written + "\n", encoding="utf-8")
    draw(rows, out / PLOT_NAME)
    return rows


def with_loop(scene: Scene, local: bool) -> Scene:
    """Return a scene whose force channel is closed in the device, or is not."""
    controller = scene.controller
    force = controller.force_channel.model_copy(update={"local": local})
    return scene.model_copy(
        update={"controller": controller.model_copy(update={"force_channel": force})}
    )
