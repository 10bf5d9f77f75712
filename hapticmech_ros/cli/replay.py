# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech bag replay``: recorded inputs into a live graph, and its outputs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from hapticmech_ros.cli.bag import Align, BagArgument, Storage
from hapticmech_ros.cli.console import ComposedOption, say
from hapticmech_ros.cli.graph import (
    ParametersOption,
    SettingOption,
    arguments_of,
    in_lockstep,
    settings_of,
    stop_by_signals,
)
from hapticmech_ros.system.installation import refuse_without_ros


def replay(
    bag: BagArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="bag folder to make")],
    feed: Annotated[
        list[str] | None,
        typer.Option(help="hand, device or external; several, but not hand with device"),
    ] = None,
    scene: Annotated[
        str, typer.Option(help="shipped scene, or path", show_default="the recorded one")
    ] = "",
    namespace: Annotated[str, typer.Option(show_default="the recorded one")] = "",
    control_rate: Annotated[
        float, typer.Option(min=0.0, max=10000.0, help="Hz; 0: the scene's own")
    ] = 0.0,
    duration: Annotated[float, typer.Option(min=0.0, help="s; 0: the whole recording")] = 0.0,
    composed: ComposedOption = False,
    params_file: ParametersOption = None,
    settings: SettingOption = None,
    storage: Annotated[
        Storage, typer.Option("--storage", "-s", metavar="mcap|sqlite3")
    ] = Storage.mcap,
    align: Annotated[
        Align, typer.Option(help="stamp, start, or nearest, for a session that was recorded live")
    ] = Align.stamp,
    exact: Annotated[
        bool, typer.Option("--exact", help="exit code 1 if any control topic differs in a bit")
    ] = False,
) -> None:
    """Feed a session's inputs into a graph in lockstep, record its outputs, and compare."""
    from hapticmech_ros.bag.compare import compare
    from hapticmech_ros.bag.reader import BagReader
    from hapticmech_ros.cli.bag_tables import show_comparison
    from hapticmech_ros.graph.lockstep import LockstepRun
    from hapticmech_ros.graph.lockstep import replay as run_replay
    from hapticmech_ros.wire.topics import topic_of

    refuse_without_ros(os.environ)
    stop = stop_by_signals()
    run = LockstepRun(
        scene,
        control_rate=control_rate,
        duration=duration,
        out=out,
        storage=storage.value,
        feed_from=bag,
        feed=tuple(feed or ["hand"]),
        composed=composed,
        namespace=namespace,
        parameters=settings_of(settings or []),
        arguments=arguments_of(params_file),
        shown=True,
    )
    ticks = in_lockstep(run_replay, run, stop)
    say(f"replayed {ticks} ticks into {out}")
    with BagReader(out) as recorded:
        found = {name: topic_of(name) for name in recorded.topics}
    control = [name for name, topic in found.items() if topic and topic.rate == "control"]
    compared = compare(bag, out, control, align.value)
    show_comparison(compared)
    if exact and not compared.is_exact:
        raise typer.Exit(1)
