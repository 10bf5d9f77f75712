# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech run``, ``topics``, ``policy`` and ``parameters``: the graph of nodes, its tables.

How a running graph is, and how it was: one line meanwhile, a table at the end.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import typer

from hapticmech_ros.cli.console import (
    ComposedOption,
    SceneArgument,
    TransportOption,
    console,
    errors,
    progress_of,
    say,
    seconds_of,
)
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.files import PARAMETER_FILE_LIMIT, check_file
from hapticmech_ros.system.discovery import Discovery, choose_discovery
from hapticmech_ros.system.readiness import report_ready
from hapticmech_ros.wire.topics import DEVICE, MECHANISM

if TYPE_CHECKING:
    from hapticmech_ros.graph.lockstep import LockstepRun
    from hapticmech_ros.graph.processes import AuxiliaryProcess, Graph
from collections.abc import Iterator

from rich.markup import escape

from hapticmech_ros.system.readiness import Report
from hapticmech_ros.wire.topics import ANALYSER, CONTROLLER, REAL_DEVICES

DEVICES = {DEVICE, *REAL_DEVICES}
Reports = Mapping[str, Report]


def line_of(reports: Reports) -> str:
    """Return a graph's state in one line: rendering, felt constraints, rate, deadlines missed."""
    parts = []
    for name, report in sorted(reports.items()):
        kind, figures = name.rpartition("/")[2], report.figures
        where = name.strip("/").rpartition("/")[0]
        if kind in DEVICES:
            rate, missed = figures.get("achieved_rate_hz", "-"), _share(figures)
            line = f"{report.sentence}, {rate} Hz, missed {missed}"
            if "periods_without_sample" in figures:
                line += f", no sample in {_share(figures, 'periods_without_sample')}"
        elif kind == ANALYSER or not report.well:
            line = report.sentence if kind == ANALYSER else f"{kind}: {report.sentence}"
        else:
            continue
        parts.append(f"{where}: {line}" if where else line)
    return "; ".join(parts)


def show_ends(reports: Reports, endings: Reports) -> None:
    """Print each node's last state, and its counts."""
    if not endings:
        return
    from hapticmech_ros.analysis.study import Sheet

    rows = []
    for name, ending in sorted(endings.items()):
        # Nodes end one after the other: inputs that the last ones then miss are no fault.
        sentence = reports.get(name, ending).sentence
        figures = ending.figures
        ages = [figures.get(f"message_age_{share}_us", "") for share in ("p50", "p99")]
        age = " / ".join(f"{float(us) / 1e3:.2f}" for us in ages) if all(ages) else "-"
        rate = figures.get("achieved_rate_hz", "-")
        rows.append((name, sentence, rate, _share(figures), age))
    headings = ("node", "at the end", "Hz", "missed", "age p50 / p99, ms")
    console.print(Sheet("", headings, tuple(rows), ("at the end",)))
    for name, ending in sorted(endings.items()):
        for note in _notes(ending):
            say(f"{name}: {note}")


def nothing_rendered(reports: Reports, endings: Reports) -> str:
    """Return why nothing was rendered by a whole graph; empty if something was, or it was none."""
    kinds = {name.rpartition("/")[2]: report for name, report in endings.items()}
    if not ({MECHANISM, ANALYSER, CONTROLLER} <= set(kinds) and DEVICES & set(kinds)):
        return ""
    if any(int(report.figures.get("engagements", "0")) > 0 for report in endings.values()):
        return ""
    why = [
        f"{name}: {reports.get(name, report).sentence}"
        for name, report in sorted(endings.items())
        if not reports.get(name, report).well
    ]
    return f"nothing was rendered: {'; '.join(why) or 'it ended too soon'}"


def _share(figures: Mapping[str, str], what: str = "missed_deadlines") -> str:
    """Return the share of periods with missed deadlines, or another count; "-" without."""
    periods, missed = figures.get("periods"), figures.get(what)
    if periods is None or missed is None:
        return "-"
    return f"{int(missed) / max(int(periods), 1):.1%}"


def _notes(report: Report) -> Iterator[str]:
    """Yield notes of faults."""
    figures = report.figures
    for key, what in (
        ("failures", "failures, the last: {last_failure}"),
        ("refused_messages", "messages refused, the last: {last_refusal}"),
        ("steps_inaccurate", "inaccurate steps"),
        ("dropped_periods", "periods dropped"),
        ("periods_without_sample", "periods in which the device did not answer"),
        ("clock_steps", "steps of the clock, the last: {last_clock_step}"),
    ):
        count = figures.get(key, "0")
        if count != "0":
            given = {k: figures.get(k, "") for k in ("last_failure", "last_refusal")}
            yield f"{count} {what.format(**given, last_clock_step=figures.get('last_clock_step'))}"
    without = int(figures.get("lost_without_processor", "0"))
    paused = int(figures.get("lost_while_sender_paused", "0"))
    if without or paused:
        yield (
            f"rendering ended {figures['losses']} times because of a silence: {without} times this "
            f"process had no processor, {paused} times the sender had paused (docs/realtime.md)"
        )


CHECK_PERIOD_S = 0.2
# Longest wait for a recorder to subscribe to every topic after the nodes are up, s.
HEARS_WITHIN_S = 20.0

NamespaceOption = Annotated[str, typer.Option(help="put nodes and topics under this name")]
StorageOption = Annotated[str, typer.Option(help="mcap or sqlite3")]
ParametersOption = Annotated[
    Path | None, typer.Option("--params-file", exists=True, help="ROS parameter file, all nodes")
]
SettingOption = Annotated[
    list[str] | None, typer.Option("--set", "-p", help="[NODE.]PARAMETER=VALUE, any number")
]


def run(
    scene: SceneArgument = "five_bar",
    composed: ComposedOption = False,
    namespace: NamespaceOption = "",
    hold: Annotated[
        list[str] | None,
        typer.Option(
            help="operational point to hold; several: a device each, in its namespace",
            show_default="what the scene's hands hold, or its first one",
        ),
    ] = None,
    control_rate: Annotated[
        float, typer.Option(min=0.0, max=10000.0, help="Hz; 0: the scene's own")
    ] = 0.0,
    network_delay: Annotated[
        str,
        typer.Option(help="one-way delay to the device, such as 50ms"),
    ] = "",
    device: Annotated[
        list[str] | None,
        typer.Option(
            help="driver of the device (docs/drivers.md): simulated, haply, or relay (of "
            "ros2_control). Of several hands also POINT=haply, any number",
            show_default="simulated",
        ),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="node to run here, any number; others run elsewhere. Of several hands also "
            "POINT, all nodes of one, or POINT/NODE"
        ),
    ] = None,
    record: Annotated[Path | None, typer.Option(help="bag to record everything into")] = None,
    storage: StorageOption = "mcap",
    view: Annotated[bool, typer.Option(help="also publish markers, frames, URDF")] = False,
    live: Annotated[
        bool, typer.Option(help="also serve a page to this machine's browser (docs/live.md)")
    ] = False,
    params_file: ParametersOption = None,
    settings: SettingOption = None,
    use_sim_time: Annotated[bool, typer.Option(help="follow an external /clock")] = False,
    lockstep: Annotated[
        bool, typer.Option(help="advance by messages, as fast as possible, with repeatable bits")
    ] = False,
    duration: Annotated[
        float, typer.Option(min=0.0, help="s from when all nodes are up; 0: until Ctrl-C")
    ] = 0.0,
    respawn: Annotated[
        bool, typer.Option(help="start a node again that has ended by itself")
    ] = False,
    rate: Annotated[
        float, typer.Option(min=0.0, help="lockstep: times real time at most; 0: no limit")
    ] = 0.0,
    transport: TransportOption = "auto",
    discovery: Annotated[
        Discovery | None,
        typer.Option(
            metavar="localhost|subnet",
            help="range of discovery; default: as the environment sets it",
        ),
    ] = None,
) -> None:
    """Start the nodes on SCENE and keep them running until Ctrl-C."""
    from hapticmech_ros.graph.lockstep import LockstepRun, run_lockstep
    from hapticmech_ros.graph.processes import SHARING_NICE, AuxiliaryProcess, Graph, LoadWatch
    from hapticmech_ros.live.settings import VISER
    from hapticmech_ros.loading import load_scene
    from hapticmech_ros.system.cpu_list import available_cores
    from hapticmech_ros.system.installation import refuse_unmet, refuse_without_ros
    from hapticmech_ros.wire.topics import PAGE, VIEWER

    refuse_without_ros(os.environ)
    if live and not lockstep:
        refuse_unmet([VISER])
    choose_discovery(os.environ, discovery)
    delay = seconds_of("--network-delay", network_delay) if network_delay else 0.0
    loaded = load_scene(scene, control_rate, delay)
    named = hold or (loaded.held_points if loaded.hands else ())
    held = tuple(loaded.operational_point(name).name for name in named)
    if len(set(held)) < len(held):
        raise InvalidInputError("hold", held, "each point can be held once")
    drivers = drivers_of(device or (), held or loaded.held_points)
    nodes = nodes_of(only or (), drivers, held)
    parameters = settings_of(settings or [])
    if params_file is None:
        refuse_one_device_twice(nodes, parameters)
    given = {"network_delay": delay, "transport": "" if transport == "auto" else transport}
    parameters |= {name: value for name, value in given.items() if value}
    arguments = arguments_of(params_file)
    stop = stop_by_signals()
    is_simulated = set(drivers.values()) == {"simulated"}
    for option, value, is_wrong, rule in (
        ("--live", live, live, "in lockstep there is no page"),
        ("--only", only, only, "lockstep runs all nodes"),
        ("--device", device, not is_simulated, "in lockstep the device is simulated"),
        ("--respawn", respawn, respawn, "in lockstep a lost node ends the run"),
    ):
        if lockstep and is_wrong:
            raise InvalidInputError(option, value, rule)
    if lockstep:
        plan = LockstepRun(
            scene,
            control_rate=control_rate,
            duration=duration,
            rate=rate,
            out=record,
            storage=storage,
            composed=composed,
            namespace=namespace,
            hold=held,
            parameters=parameters,
            arguments=arguments,
            shown=True,
        )
        say(f"running {scene} in lockstep; Ctrl-C ends it")
        ticks = in_lockstep(run_lockstep, plan, stop)
        say(f"{ticks} ticks, {ticks * loaded.simulation.period:g} s")
        return
    given = {"control_rate": control_rate, "use_sim_time": use_sim_time}
    parameters |= {name: value for name, value in given.items() if value}
    nodes += [*([VIEWER] if view else []), *([PAGE] if live else [])]
    recorder = None
    if record is not None and record.exists():
        raise BagError(f"{record} exists: choose another place for --record")
    whole = True
    try:
        with ExitStack() as stack:
            graph = stack.enter_context(
                Graph(
                    scene, composed, namespace, parameters, None, nodes, held, arguments, shown=True
                )
            )
            say(f"running {scene}; Ctrl-C ends it")
            if record is not None:
                recorder = _recorder(record, storage, transport, graph)
            pages = [
                AuxiliaryProcess(name, page, "without a page", partial(say, where=errors))
                for name, page in graph.pages.items()
            ]
            # A line at the end of the terminal, for a person.
            line = stack.enter_context(console.status("starting")) if console.is_terminal else None
            left, up, ends, load = CHECK_PERIOD_S, None, None, None
            rate = 1.0 / loaded.simulation.period
            watch = LoadWatch(rate, available_cores(), composed, len(held) or 1)
            while left > 0.0:
                time.sleep(min(CHECK_PERIOD_S, left))
                if stop():
                    break
                if respawn:
                    for sentence in graph.respawn():
                        say(sentence, where=errors)
                else:
                    graph.check()
                    for page in pages:
                        page.look()
                if recorder is not None:
                    recorder.look()
                reports = graph.reports()
                if line is not None and reports:
                    line.update(escape(line_of(reports)))
                if up is not None and load is None and not use_sim_time:
                    load = watch.look(reports)
                    for sentence in () if load is None else load.sentences():
                        say(sentence)
                    if load is not None and load.saturates and graph.leave_share():
                        say(f"nodes run at nice {SHARING_NICE} now: others need a share")
                if up is None and graph.is_ready():
                    up = time.monotonic()
                if ends is None and up is not None and _receives(recorder, graph, up):
                    report_ready()
                    ends = time.monotonic() + (duration or float("inf"))
                if ends is not None:
                    left = ends - time.monotonic()
    finally:
        if recorder is not None:
            whole = recorder.end()
    show_ends(graph.reports(), graph.endings())
    unrendered = "" if use_sim_time else nothing_rendered(graph.reports(), graph.endings())
    if unrendered:
        say(unrendered, where=errors)
    if unrendered or not whole:
        raise typer.Exit(1)


def topics(
    cpp: Annotated[
        bool, typer.Option("--cpp", help="offsets of the flat messages, as a C++ header, instead")
    ] = False,
) -> None:
    """Print the table of topics, as in docs/topics.md."""
    from hapticmech_ros.wire.table import cpp_header, markdown

    print(cpp_header() if cpp else markdown(), end="")


def policy(
    namespace: Annotated[str, typer.Option(help="of the graph")] = "/",
    enclaves: Annotated[str, typer.Option(help="path of the enclaves")] = "/hapticmech",
) -> None:
    """Print a policy for SROS2: topics and services of each node. See SECURITY.md."""
    from hapticmech_ros.wire.table import policy as written

    print(written(namespace, enclaves), end="")


def parameters() -> None:
    """Print the table of the nodes' parameters, as in docs/nodes.md."""
    from hapticmech_ros.nodes.parameter_table import markdown

    print(markdown(), end="")


def stop_by_signals() -> Callable[[], bool]:
    """Return a function that tells whether SIGINT or SIGTERM has come.

    Its handler takes no lock, which what it interrupts could hold.
    """
    came: list[int] = []
    # Also where a shell has switched SIGINT off, as for jobs in the background.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: came.append(number))
    return lambda: bool(came)


def in_lockstep(run: Callable[..., int], plan: LockstepRun, stop: Callable[[], bool]) -> int:
    """Run a graph in lockstep with a bar, print how its nodes ended, and return the ticks.

    Args:
        run: ``run_lockstep`` or ``replay``.
        plan: its settings.
        stop: whether to end it.
    """
    ends = list[tuple[Reports, Reports]]()
    try:
        with progress_of("ticks") as show:
            return run(plan, os.environ, stop, show, lambda *found: ends.append(found))
    finally:
        for found in ends:
            show_ends(*found)


def drivers_of(devices: Sequence[str], held: Sequence[str]) -> dict[str, str]:
    """Return the driver of the device at each point that is held.

    Args:
        devices: drivers, for all points, or ``point=driver``; of several for one the last counts.
        held: points.

    Raises:
        InvalidInputError: a driver or a point that there is none of.
    """
    from hapticmech_ros.nodes.entry import DRIVERS

    drivers = dict.fromkeys(held, "simulated")
    for word in devices:
        point, named, driver = word.rpartition("=")
        if driver not in DRIVERS:
            rule = f"must be one of {', '.join(DRIVERS)}, or POINT=DRIVER"
            raise InvalidInputError("--device", word, rule)
        if named and point not in drivers:
            rule = f"{point} is not held: must be one of {', '.join(held)}"
            raise InvalidInputError("--device", word, rule)
        drivers |= dict.fromkeys([point] if named else held, driver)
    return drivers


def nodes_of(
    only: Sequence[str],
    drivers: Mapping[str, str] = MappingProxyType({}),
    held: Sequence[str] = (),
) -> list[str]:
    """Return the graph's nodes that are to run here, with drivers of devices among them.

    Args:
        only: nodes; of several hands also points, or ``point/node``. All of them if there are none.
        drivers: of devices by the point that is held, where not simulated.
        held: points of the hands, if there are several. Their nodes are called ``point/node``.

    Raises:
        InvalidInputError: a node that there is none of.
    """
    from hapticmech_ros.nodes.entry import DRIVERS, NODES

    several = len(held) > 1
    chosen: dict[str, str] = {}
    for point in held or tuple(drivers)[:1] or ("",):
        for name in NODES:
            space = f"{point}/" if several and name != MECHANISM else ""
            if not only or any(_names(word, space + name) for word in only):
                driver = DRIVERS[drivers.get(point, "simulated")]
                chosen[space + name] = space + (driver if name == DEVICE else name)
    for word in only:
        if not any(_names(word, node) for node in chosen):
            known = ", ".join([*NODES, *(held if several else ())])
            rule = f"must be one of {known}" + (", or POINT/NODE" if several else "")
            raise InvalidInputError("--only", word, rule)
    return list(chosen.values())


def refuse_one_device_twice(nodes: Sequence[str], settings: Collection[str] = ()) -> None:
    """Refuse drivers of one kind for several points, which would drive the same real device.

    Args:
        nodes: that run here.
        settings: parameters that are set; ``/point/driver.parameter`` distinguishes them.

    Raises:
        InvalidInputError: there are such.
    """
    from hapticmech_ros.nodes.entry import DRIVERS

    for kind, driver in DRIVERS.items():
        points = [node.rpartition("/")[0] for node in nodes if _names(driver, node)]
        configured = [p for p in points if any(f"/{p}/{driver}." in name for name in settings)]
        if kind != "simulated" and len(points) > 1 and configured != points:
            rule = f"each of {', '.join(points)} needs a device of its own: name them in "
            rule += f"--params-file, or by --set /POINT/{driver}.PARAMETER=VALUE"
            raise InvalidInputError("--device", kind, rule)


def _names(name: str, node: str) -> bool:
    """Return whether a word is a node's whole name, its point, or its name at every point."""
    return name in (node, *node.split("/"))


def arguments_of(params_file: Path | None) -> tuple[str, ...]:
    """Return nodes' arguments for a parameter file; ROS would wait for a pipe.

    Raises:
        FileError: no regular file, or too large.
    """
    if params_file is None:
        return ()
    check_file(params_file, PARAMETER_FILE_LIMIT)
    return "--params-file", str(params_file)


def settings_of(texts: list[str]) -> dict[str, object]:
    """Return parameters given as ``[node.]name=value``; values are YAML, as ROS reads them."""
    from hapticmech_ros.files.yaml_text import read_yaml

    found: dict[str, object] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (equals and name):
            raise InvalidInputError("--set", text, "must be [NODE.]PARAMETER=VALUE")
        found[name] = read_yaml(value, f"--set {text}")
    return found


def _recorder(record: Path, storage: str, transport: str, graph: Graph) -> AuxiliaryProcess:
    """Start a recorder of everything beside a graph."""
    from hapticmech_ros.graph.processes import AuxiliaryProcess, start_process

    command = [sys.executable, "-m", "hapticmech_ros", "bag", "record", "--all"]
    command += ["--out", str(record), "--storage", storage, "--transport", transport]
    loss = f"the bag {record} is incomplete (hapticmech bag repair {record} may help)"
    process = start_process(command, os.environ | graph.notified)
    return AuxiliaryProcess("the recorder", process, loss, partial(say, where=errors))


def _receives(recorder: AuxiliaryProcess | None, graph: Graph, up: float) -> bool:
    """Return whether a recorder receives a graph that is up since a time, or the wait is over."""
    if recorder is None or recorder.has_ended or graph.is_up(recorder.process):
        return True
    if time.monotonic() - up < HEARS_WITHIN_S:
        return False
    say(f"after {HEARS_WITHIN_S:g} s the recorder does not receive every topic", where=errors)
    return True
