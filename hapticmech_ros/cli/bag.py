# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech bag``: record, play, info, check, repair and replay."""

from __future__ import annotations

import json
import os
import time
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

from hapticmech_ros.cli.commands import Commands
from hapticmech_ros.cli.console import ComposedOption, TransportOption, say
from hapticmech_ros.cli.graph import (
    ParametersOption,
    SettingOption,
    arguments_of,
    in_lockstep,
    settings_of,
    stop_by_signals,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.system.installation import refuse_without_ros

app = Commands(
    "Record, play, check, compare, replay and repair rosbag2 bags.",
    "bag info bags/live",
    "bag check bags/live",
)
MEGABYTE = 1_000_000


class Storage(str, Enum):
    """Storage of a bag."""

    mcap = "mcap"
    sqlite3 = "sqlite3"


class Align(str, Enum):
    """How stamps of two bags belong together."""

    stamp = "stamp"
    nearest = "nearest"
    start = "start"


BagArgument = Annotated[Path, typer.Argument(help="bag folder, or one .mcap or .db3 file")]
NamespaceOption = Annotated[str, typer.Option("--namespace", help="namespace of the graph")]
JsonOption = Annotated[
    Path | None, typer.Option("--json", help="also write everything into this file")
]


@app.command("record", "bag record --all --out bags/live", "bag record device/state --duration 5")
def record(
    topics: Annotated[
        list[str] | None, typer.Argument(help="topics; all if neither these nor --regex are given")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", "-a", help="every topic")] = False,
    regex: Annotated[
        str, typer.Option("--regex", "-e", help="topics in whose names this is found")
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="folder to make", show_default="rosbag2_<date>-<time>"),
    ] = None,
    storage: Annotated[
        Storage, typer.Option("--storage", "-s", metavar="mcap|sqlite3")
    ] = Storage.mcap,
    split_size: Annotated[
        float | None, typer.Option(help="begin a new file at this size, MB", min=0.01)
    ] = None,
    split_duration: Annotated[
        float | None, typer.Option(help="begin a new file after so long, s", min=0.01)
    ] = None,
    namespace: NamespaceOption = "",
    duration: Annotated[float | None, typer.Option(help="end after so long, s", min=0.01)] = None,
    use_sim_time: Annotated[
        bool, typer.Option("--use-sim-time", help="times of reception by /clock")
    ] = False,
    transport: TransportOption = "auto",
) -> None:
    """Record topics of the running graph, also those that appear later, until Ctrl-C."""
    refuse_without_ros(os.environ)
    from hapticmech_ros.nodes.bags.bag_recorder import RecordOptions
    from hapticmech_ros.nodes.bags.bag_recorder import record as record_bag

    if everything and (topics or regex):
        rule = "cannot be together with topics or --regex"
        raise InvalidInputError("--all", topics or regex, rule)
    options = RecordOptions(
        path=out or Path(time.strftime("rosbag2_%Y_%m_%d-%H_%M_%S")),
        topics=tuple(topics or ()),
        regex=regex,
        namespace=namespace,
        storage=storage.value,
        split_bytes=None if split_size is None else round(split_size * MEGABYTE),
        split_s=split_duration,
        duration_s=duration,
        use_sim_time=use_sim_time,
        transport=transport,
    )
    raise typer.Exit(record_bag(options))


@app.command("play", "bag play bags/live --rate 0.5 --clock 100", "bag play bags/live --loop")
def play(
    bag: BagArgument,
    topics: Annotated[list[str] | None, typer.Argument(help="topics of the bag; or all")] = None,
    rate: Annotated[float, typer.Option("--rate", "-r", help="speed", min=1e-3)] = 1.0,
    start_offset: Annotated[
        float, typer.Option(help="leave out so much of the beginning, s", min=0.0)
    ] = 0.0,
    duration: Annotated[
        float | None, typer.Option(help="play so much of the bag, s", min=1e-3)
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", "-l", help="begin anew at the end")] = False,
    remap: Annotated[
        list[str] | None, typer.Option("--remap", "-m", help="FROM:=TO; may be repeated")
    ] = None,
    clock: Annotated[float, typer.Option(help="publish /clock at this rate, Hz", min=0.0)] = 0.0,
    paused: Annotated[bool, typer.Option("--paused", "-p", help="begin paused")] = False,
    namespace: Annotated[
        str, typer.Option("--namespace", help="put node and topics under this name")
    ] = "",
    wait_for_subscribers: Annotated[
        float, typer.Option(help="wait so long at most for subscribers of every topic, s", min=0.0)
    ] = 0.0,
) -> None:
    """Publish a bag's messages as they were recorded; the space key pauses."""
    refuse_without_ros(os.environ)
    from hapticmech_ros.nodes.bags.bag_player import PlayOptions
    from hapticmech_ros.nodes.bags.bag_player import play as play_bag

    options = PlayOptions(
        path=bag,
        topics=tuple(topics or ()),
        rate=rate,
        start_offset_s=start_offset,
        duration_s=duration,
        loop=loop,
        remaps=dict(_remap(text) for text in remap or ()),
        clock_hz=clock,
        paused=paused,
        namespace=namespace,
        wait_s=wait_for_subscribers,
    )
    raise typer.Exit(play_bag(options))


@app.command("info", "bag info bags/live", "bag info bags/live --json")
def info(
    bag: BagArgument,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """Print the contents of a bag."""
    from hapticmech_ros.bag.check import inspect_bag
    from hapticmech_ros.cli.bag_tables import show_info

    found = inspect_bag(bag)
    if as_json:
        print(json.dumps(found.as_dict(), indent=2))
    else:
        show_info(found)


@app.command("check", "bag check bags/live", "bag check bags/original bags/slower --tolerance 1e-6")
def check(
    bag: BagArgument,
    other: Annotated[
        Path | None, typer.Argument(help="second bag: compare it with the first")
    ] = None,
    topics: Annotated[
        list[str] | None, typer.Option("--topics", "-t", help="compare this one; may be repeated")
    ] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="largest deviation allowed, in each field's unit", min=0.0)
    ] = None,
    exact: Annotated[
        bool, typer.Option("--exact", help="nothing missing, every bit the same")
    ] = False,
    align: Annotated[
        Align,
        typer.Option(
            help="stamp: same stamps; nearest ones; start: nearest, from each bag's start"
        ),
    ] = Align.stamp,
    report: JsonOption = None,
) -> None:
    """Check that one bag is whole, or that a second one holds the same as the first.

    Ends with exit code 1 if the bag is damaged or empty, or the second one deviates too much.
    """
    from hapticmech_ros.bag.check import check as check_bag
    from hapticmech_ros.bag.compare import compare
    from hapticmech_ros.cli.bag_tables import show_check, show_comparison

    if other is None:
        checked = check_bag(bag)
        show_check(checked)
        _write(report, checked.as_dict())
        raise typer.Exit(0 if checked.is_sound else 1)
    compared = compare(bag, other, tuple(topics or ()), align.value)
    show_comparison(compared)
    _write(report, compared.as_dict())
    failures = []
    if (exact or tolerance is not None) and not any(t.matched for t in compared.topics):
        failures.append("no message of one bag has a counterpart in the other")
    if tolerance is not None and not compared.largest <= tolerance:
        failures.append(f"a deviation of {compared.largest:g} is above {tolerance:g}")
    if exact and not compared.is_exact:
        failures.append("messages are missing or differ")
    for failure in failures:
        say(failure, "red")
    raise typer.Exit(1 if failures else 0)


@app.command("repair", "bag repair bags/live", "bag repair bags/live --out bags/whole")
def repair(
    bag: BagArgument,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="folder to make", show_default="<BAG>_repaired"),
    ] = None,
) -> None:
    """Write a new bag with everything that can be read of a damaged or unfinished one."""
    from hapticmech_ros.bag.repair import repair as repair_bag
    from hapticmech_ros.cli.bag_tables import show_repair

    done = repair_bag(bag, out)
    show_repair(done)
    raise typer.Exit(0 if done.messages else 1)


@app.command(
    "replay",
    "bag replay bags/live --out bags/same --exact",
    "bag replay bags/live --out bags/slower --control-rate 500",
)
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
        Align,
        typer.Option(
            help="compare messages of the same stamp, or time since the start, or, for a session "
            "that was recorded live, the nearest"
        ),
    ] = Align.stamp,
    exact: Annotated[
        bool, typer.Option("--exact", help="exit code 1 if any control topic differs in a bit")
    ] = False,
) -> None:
    """Run a graph in lockstep on a recording's inputs, record its outputs, and compare."""
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


def _remap(text: str) -> tuple[str, str]:
    source, arrow, target = text.partition(":=")
    if not (source and arrow and target):
        raise InvalidInputError("--remap", text, "must be FROM:=TO")
    return source, target


def _write(path: Path | None, report: dict[str, Any]) -> None:
    if path is not None:
        text = json.dumps(report, indent=2, default=str, allow_nan=False)
        path.write_text(text + "\n", encoding="utf-8")
