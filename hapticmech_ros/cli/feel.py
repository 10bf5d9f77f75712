# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``hapticmech feel``: transparency, stability limits and passivity of scenes on their devices."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hapticmech_ros.cli.commands import Commands
from hapticmech_ros.cli.console import ChangesOption, OutOption, with_changes, words
from hapticmech_ros.cli.study import (
    ClusterOption,
    JsonOption,
    ProcessesOption,
    carry_out,
    numbers,
    workers_of,
)
from hapticmech_ros.errors import check_one_of

# A closed loop, a spatial one, contacts, and nothing but free directions.
SAMPLE = ("five_bar", "door", "peg_in_hole", "spatial_arm")
DELAYS, ALL_DELAYS = "0,1,2,5,10", "0,1,2,5,10,20,50"
RATES, ALL_RATES = "500,2000", "250,500,1000,2000,4000"
OUT = Path("feel")

AllScenes = Annotated[
    list[str] | None, typer.Argument(help="shipped scenes or paths; all shipped ones if none")
]
SampleScenes = Annotated[
    list[str] | None, typer.Argument(help=f"shipped scenes or paths; {', '.join(SAMPLE)} if none")
]
PeriodsOption = Annotated[str, typer.Option(help="periods from measuring to acting, with commas")]
AllOption = Annotated[bool, typer.Option("--all", help="all shipped scenes, delays and rates")]

app = Commands(
    "Measure what the hand feels: transparency, stability limits, passivity.",
    "feel impedance five_bar",
    "feel limits five_bar",
)


@app.command("impedance", "feel impedance five_bar", "feel impedance door --delays 1,5")
def impedance(
    scenes: AllScenes = None,
    delays: PeriodsOption = "1",
    over: Annotated[
        str,
        typer.Option(help="session; composed, processes or lockstep: a recorded graph of nodes"),
    ] = "session",
    changes: ChangesOption = None,
    out: OutOption = OUT,
    json_only: JsonOption = False,
) -> None:
    """Measure felt over desired impedance along the free directions, over frequency."""
    from hapticmech_ros.analysis.transparency import OVER, transparency
    from hapticmech_ros.loading import shipped_scenes

    periods = numbers("--delays", delays, int)
    check_one_of("--over", over, OVER)
    chosen = with_changes(scenes or list(shipped_scenes()), changes, out)
    carry_out(lambda show: transparency(chosen, periods, show, over), out, json_only)


@app.command("users", "feel users two_users", "feel users two_users --json")
def users(
    scenes: Annotated[
        list[str], typer.Argument(help="scenes with several hands, shipped ones or paths")
    ],
    changes: ChangesOption = None,
    out: OutOption = OUT,
    json_only: JsonOption = False,
) -> None:
    """Measure what each of several users feels while the others hold on by their arms."""
    from hapticmech_ros.analysis.users import users as felt_by_users
    from hapticmech_ros.loading import load_scene

    loaded = [load_scene(name) for name in with_changes(scenes, changes, out)]
    carry_out(lambda show: felt_by_users(loaded, show), out, json_only)


@app.command("limits", "feel limits five_bar --what z", "feel limits --all --processes 4")
def limits(
    scenes: SampleScenes = None,
    delays: PeriodsOption = "",
    rates: Annotated[str, typer.Option(help="further rates of the loop, Hz, with commas")] = "",
    what: Annotated[
        str, typer.Option(help="z: Z-width; m: M-width; loads: drift and energy")
    ] = "z,m,loads",
    device: Annotated[str, typer.Option(help="preset instead of the scenes' devices")] = "",
    everything: AllOption = False,
    processes: ProcessesOption = 2,
    cluster: ClusterOption = "",
    changes: ChangesOption = None,
    out: OutOption = OUT,
    json_only: JsonOption = False,
) -> None:
    """Find Z-width and M-width, measured in sessions and predicted by eigenvalues and rules."""
    from hapticmech_ros.analysis.limits import cases_of
    from hapticmech_ros.analysis.limits import limits as measured_limits
    from hapticmech_ros.analysis.scene_variants import with_device
    from hapticmech_ros.loading import load_scene

    periods = numbers("--delays", delays or (ALL_DELAYS if everything else DELAYS), int)
    hertz = numbers("--rates", rates or (ALL_RATES if everything else RATES), float)
    chosen = with_changes(_sampled(scenes, everything), changes, out)
    loaded = [load_scene(name) for name in chosen]
    if device:
        loaded = [with_device(scene, device) for scene in loaded]
    cases = cases_of(loaded, periods, hertz, words(what))
    with workers_of(processes, cluster) as workers:
        carry_out(lambda show: measured_limits(cases, workers, show), out, json_only)


@app.command("compare", "feel compare five_bar", "feel compare door --delays 1,5")
def compare(
    scenes: SampleScenes = None,
    delays: PeriodsOption = "1",
    everything: AllOption = False,
    processes: ProcessesOption = 2,
    cluster: ClusterOption = "",
    changes: ChangesOption = None,
    out: OutOption = OUT,
    json_only: JsonOption = False,
) -> None:
    """Render the same motions by the architecture, without joint constraints, and by a proxy."""
    from hapticmech_ros.analysis.comparison import compare as compare_renderings

    periods = numbers("--delays", delays, int)
    chosen = with_changes(_sampled(scenes, everything), changes, out)
    with workers_of(processes, cluster) as workers:
        carry_out(lambda show: compare_renderings(chosen, periods, workers, show), out, json_only)


@app.command("passivity", "feel passivity five_bar", "feel passivity door --seconds 2")
def passivity(
    scenes: AllScenes = None,
    devices: Annotated[
        str, typer.Option(help="presets, or scene for the scene's own, with commas")
    ] = "scene",
    hands: Annotated[
        str, typer.Option(help="scene, relaxed, firm, tremor, grips, with commas")
    ] = "scene,firm",
    delays: Annotated[str, typer.Option(help="ms each way, with commas")] = "0,50",
    seconds: Annotated[float, typer.Option(help="s of each trial", min=0.1)] = 5.0,
    processes: ProcessesOption = 2,
    cluster: ClusterOption = "",
    changes: ChangesOption = None,
    out: OutOption = OUT,
    json_only: JsonOption = False,
) -> None:
    """Test passivity over delay, jitter and loss: does the hand get more energy than it gave?"""
    from hapticmech_ros.analysis.passivity import passivity as try_passivity
    from hapticmech_ros.analysis.passivity import trials
    from hapticmech_ros.loading import shipped_scenes

    late = [1e-3 * delay for delay in numbers("--delays", delays, float)]
    chosen = with_changes(scenes or list(shipped_scenes()), changes, out)
    asked = trials(chosen, words(devices), words(hands), late, seconds)
    with workers_of(processes, cluster) as workers:
        carry_out(lambda show: try_passivity(asked, show, workers), out, json_only)


def _sampled(scenes: list[str] | None, everything: bool) -> list[str]:
    from hapticmech_ros.loading import shipped_scenes

    if scenes:
        return scenes
    return list(shipped_scenes()) if everything else list(SAMPLE)
