# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Lists, checks and plans of scenes as lines and tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from hapticmech_ros.analysis.study import Marked, Sheet
from hapticmech_ros.cli.console import WIDEST_NAME, console, say

if TYPE_CHECKING:
    from hapticmech_ros.formats import LeftOut
    from hapticmech_ros.offline.assembly_search import AssemblySearch, LoopResidual
    from hapticmech_ros.plan.scene_plan import ClosurePlan, SceneCheck, ScenePlan
    from hapticmech_ros.plan.step_accuracy import StepAccuracy, StepChoices
    from hapticmech_ros.scene import Scene

SHAPES_SHOWN = 60
ASSEMBLIES_SHOWN = 5
NUMBERS = {"rows", "bytes"}


def show_plan(plan: ScenePlan) -> None:
    """Print a plan."""
    for name, text in _lines(plan):
        say(f"{name:<22} {text}", hang=23)
    if plan.closures:
        console.print(_closures(plan.closures))
    console.print(_arrays(plan))


def show_scenes(scenes: Sequence[tuple[str, str]]) -> None:
    """Print names and purposes of scenes."""
    table = Table.grid(padding=(0, 1, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column()
    for name, purpose in scenes:
        table.add_row(escape(name), escape(purpose))
    console.print(table, highlight=False)


def show_steps(found: StepChoices) -> None:
    """Print the settings that were tried, and those to use."""
    heading = f"error of {found.wanted_m:g} m (references differ by {found.reference_m:.0e} m)"
    best, rows = found.best, list[tuple[str, ...]]()
    for one in found.tried:
        if one.failed:
            rows.append((one.integrator, str(one.substeps), "-", "-", one.failed))
            continue
        enough = "" if one.error_m <= found.wanted_m else "not accurate enough"
        words = "least time" if one is best else enough
        times = f"{1e6 * one.time_s:.1f}"
        rows.append((one.integrator, str(one.substeps), f"{one.error_m:.1e}", times, words))
    columns = ("integrator", "substeps", "error, m", "µs in a period", "")
    console.print(_table(heading, columns, rows))
    if best is not None:
        settings = f"integrator={best.integrator}", f"substeps={best.substeps}"
        text = " ".join(f"--set simulation.{setting}" for setting in settings)
        say(text)


def show_check(check: SceneCheck, left: LeftOut) -> None:
    """Print properties of a scene, parts of its model file that are not used, and warnings."""
    lines = {
        "scene": check.scene,
        "mechanism": f"{check.links} links of {check.mass_kg:.4g} kg, {check.joints} moving joints",
        "degrees of freedom": f"{check.mobility}"
        + (f": {check.nv} of joints, {check.rank} taken by loops" if check.rank else ""),
    }
    if check.fitted:
        lines["fitted loops"] = check.fitted
    for name, text in lines.items():
        say(f"{name:<20} {text}", hang=21)
    if check.closures:
        closures = [map(str, closure) for closure in check.closures]
        console.print(_table("closures", ("name", "kind", "rows", "independent"), closures))
    points = []
    for point in check.points:
        felt = "-" if point.mass_kg is None else f"{point.mass_kg[0]:.3g} to {point.mass_kg[1]:.3g}"
        margin = (
            f"{point.loop.periods} periods" if point.loop.periods >= 0 else Marked("none", "yellow")
        )
        points.append((point.name, point.link, str(point.rank), str(point.count), felt, margin))
    columns = ("name", "link", "free", "blocked", "felt mass, kg", "delay margin")
    title = "operational points at the start: free and blocked directions"
    console.print(_table(title, columns, points))
    for name, text in _accuracy(check.accuracy):
        say(f"{name:<20} {text}", hang=21)
    changing = [note for note in left.notes if note.rank < 2]
    for note in changing:
        say(f"model file: {note}")
    for warning in check.warnings:
        say(f"warning: {warning}", "yellow")
    for note in left.notes[len(changing) :]:
        say(f"not used: {note}")
    if left.shapes:
        more = len(left.shapes) - SHAPES_SHOWN
        rest = f" and {more} more, which --json lists" if more > 0 else ""
        text = f"shapes of the model: {', '.join(left.shapes[:SHAPES_SHOWN])}{rest}"
        say(text)


def show_assemblies(scene: Scene, found: AssemblySearch) -> None:
    """Print how far loops are open as written, and the configurations that close them."""
    from hapticmech_ros.mechanism.tolerances import NEAR_SINGULAR
    from hapticmech_ros.offline.assembly_search import initial_state

    loops = [
        (written.name, written.kind, _open_by(written), _open_by(best))
        for written, best in zip(found.written, found.residuals, strict=True)
    ]
    console.print(_table("loops", ("name", "kind", "open as written", "at best"), loops))
    tried = f"{found.closed} of {found.starts} starts closed"
    if not found.found:
        say(
            f"no configuration closes all loops: {tried}. Check lengths and frames of the loops "
            "that are open at best, or try more --starts",
            "red",
        )
        return
    say(f"{tried}; the nearest to the start as written first:")
    for one in found.found[:ASSEMBLIES_SHOWN]:
        notes = [f"joints moved by up to {one.moved:.3g} (rad, or m per length)"]
        if one.beyond:
            notes.append(f"beyond their stops: {', '.join(one.beyond)}")
        if one.least < NEAR_SINGULAR:
            notes.append(f"next to a singular position: relative σ {one.least:.1e}")
        say(f"- {'; '.join(notes)}")
    text = f"initial_state: {initial_state(scene, found.found[0].q)}"
    say(text)


def _open_by(loop: LoopResidual) -> str:
    """Return how far a loop is open, with units."""
    parts = [] if loop.distance is None else [f"{loop.distance:.3g} m"]
    return ", ".join(parts + ([] if loop.angle is None else [f"{loop.angle:.3g} rad"]))


def _accuracy(found: StepAccuracy) -> Iterator[tuple[str, str]]:
    if found.failed:
        return
    if found.left_out:
        yield "left out", f"{found.left_out} (--seconds gives it more)"
        return
    if not (found.exchanged_j or found.position_m or found.rotation_rad or found.force_n):
        seconds = f"{found.duration_s:g} s of the scene's experiment"
        yield "accuracy of steps", f"not tested: nothing moves in the {seconds}; give it a hand"
        return
    yield (
        "accuracy of steps",
        f"over {found.duration_s:g} s, ten times shorter steps change the operational point by"
        f" {found.position_m:.1e} m and {found.rotation_rad:.1e} rad, and the force by"
        f" {found.force_n:.1e} N",
    )
    done_again = f"; {found.refined} steps were divided" if found.refined else ""
    yield (
        "energy of steps",
        f"error of {found.surplus_j:.1e} J, with {found.exchanged_j:.1e} J exchanged{done_again}",
    )


def _lines(plan: ScenePlan) -> Iterator[tuple[str, str]]:
    yield "scene", plan.scene
    still = f"; {plan.still_joints} fixed or locked" if plan.still_joints else ""
    yield "mechanism", f"{plan.topology}: {_counted(plan.joints)}{still}"
    yield "coordinates", f"nq = {plan.nq}, nv = {plan.nv}, mobility {plan.mobility}"
    yield "task space", f"{plan.task_space}, {plan.task_rows} rows"
    gravity = ", ".join(f"{part:g}" for part in plan.gravity)
    yield "gravity", f"({gravity}) m/s²" if any(plan.gravity) else "none"
    others = [name for name in plan.points if name != plan.analysed]
    beside = f"; not analysed: {', '.join(others)}" if others else ""
    yield "operational points", f"{len(plan.points)}: {plan.analysed} is held and analysed{beside}"
    redundant = ", ".join(plan.redundant_rows) or "none"
    yield (
        "closure rows",
        f"{plan.rows}, active at the start {plan.active_rows} of rank {plan.rank};"
        f" redundant: {redundant}",
    )
    yield "passive elements", _counted(plan.elements) or "none"
    steps = f"{plan.substeps} substep{'s' if plan.substeps > 1 else ''} of {plan.stages} stages"
    yield "integrator", f"{plan.integrator}, {1e3 * plan.period:g} ms in {steps}"
    for choice in plan.choices:
        yield choice.about, f"{choice.taken} ({choice.why})"


def _counted(numbers: Mapping[str, int]) -> str:
    return ", ".join(f"{number} {name}" for name, number in numbers.items() if number)


def _closures(closures: tuple[ClosurePlan, ...]) -> Sheet:
    return _table(
        "closures",
        ("name", "kind", "rows", "at the start", "redundant rows"),
        [
            (
                one.name,
                one.kind,
                str(one.rows),
                "active" if one.active else "open, can latch" if one.can_latch else "open",
                ", ".join(one.redundant) or "-",
            )
            for one in closures
        ],
    )


def _arrays(plan: ScenePlan) -> Sheet:
    rows = [
        (array.name, " × ".join(map(str, array.shape)), str(array.size_bytes))
        for array in plan.arrays
    ]
    total = sum(array.size_bytes for array in plan.arrays)
    rows.append(("total", "", str(total)))
    return _table("arrays of a tick", ("array", "shape", "bytes"), rows)


def _table(title: str, columns: Sequence[str], rows: Iterable[Iterable[str]]) -> Sheet:
    words = tuple(column for column in columns if column not in NUMBERS)
    return Sheet(title, tuple(columns), tuple(map(tuple, rows)), words, kept=WIDEST_NAME)
