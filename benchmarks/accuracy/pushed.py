# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes pushed ten times as hard as by their hands: ``python -m benchmarks.accuracy.pushed``.

What the hand of a shipped scene does to the mechanism in the experiment is done to it again and
again, ten times as large, for a minute. The energy of the state is compared with work and losses
after every step: it is off by less than 1e-6 of what was exchanged, or an error, or the state's
account tells of it: by its surplus, or by inaccurate steps.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hapticmech_ros import Session
from hapticmech_ros.analysis.study import Sheet
from hapticmech_ros.cli import run_app
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.loading import load_scene, shipped_scenes
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.simulation import MechanismState, Simulator
from hapticmech_ros.system.workers import answers

HARDER, MINUTE = 10.0, 60.0
# Share of what was exchanged by which an account may be off and say nothing.
ALLOWED = 1e-6

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@dataclass(frozen=True, slots=True)
class Pushed:
    """What was seen of a scene.

    Attributes:
        scene: its name.
        reached: s that were simulated.
        exchanged: sum of the steps' work, losses and changes of contacts' energy, J.
        off: largest difference of the energy from work and losses, J.
        made: most that contacts gave back of what they had lost, as the state's account has it, J.
        untold: what of ``off`` the surplus in the state's account does not tell, J.
        refined, inaccurate: of the state's account.
        ended: why it ended early; empty if it did not.
    """

    scene: str
    reached: float
    exchanged: float
    off: float
    made: float
    untold: float
    refined: int
    inaccurate: int
    ended: str

    @property
    def silent(self) -> bool:
        """Whether the account is off, and nothing says so."""
        told = max(self.untold, self.made) <= ALLOWED * self.exchanged
        return not (told or self.inaccurate or self.ended)


def pushed(name: str, duration: float = MINUTE) -> Pushed:
    """Return what is seen of a shipped scene."""
    scene = load_scene(name)
    simulator, pushes = Simulator(scene), HARDER * _pushes(scene)
    wrenches = np.zeros((len(simulator.mechanism.point_names), 6))
    state, ended = simulator.initial_state(), ""
    start, exchanged, off, untold, made = _energy(simulator, state), 0.0, 0.0, 0.0, 0.0
    for step in range(round(duration / simulator.period)):
        wrenches[0] = pushes[step % len(pushes)]
        before = state.account
        try:
            state = simulator.step(state, wrenches)
        except HapticMechError as error:
            ended = str(error)
            break
        now = state.account
        changes = (
            now.work_in - before.work_in,
            now.damping_loss - before.damping_loss,
            now.latch_loss - before.latch_loss,
            now.contact_loss - before.contact_loss,
            now.contact_energy - before.contact_energy,
        )
        exchanged += sum(map(abs, changes))
        paid = now.work_in - now.damping_loss - now.latch_loss - now.contact_loss
        apart = _energy(simulator, state) - start - paid
        off, untold = max(off, abs(apart)), max(untold, abs(apart - now.surplus))
        made = max(made, now.contact_made)
    account = state.account
    return Pushed(
        *(name, state.time, exchanged, off, made, untold),
        *(account.refined, account.inaccurate, ended),
    )


def _pushes(scene: Scene) -> Array:
    """Return what the hand does to the mechanism (ticks, 6) in the scene's experiment, N, N m."""
    period, delay = scene.simulation.period, scene.hand.start_delay
    ticks, first = round((delay + scene.experiment.duration) / period), round(delay / period)
    return np.array(Session(scene).run(ticks)["on_mechanism"][first:])


def _energy(simulator: Simulator, state: MechanismState) -> float:
    return sum(simulator.mechanism.energy(state.q, state.v)) + state.account.contact_energy


@app.command()
def every_scene(
    names: Annotated[list[str] | None, typer.Argument(help="Scenes; all if left out.")] = None,
    duration: Annotated[float, typer.Option(min=0.001, help="s of each.")] = MINUTE,
    processes: Annotated[int, typer.Option(min=1, help="That share the work.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = Path("bench"),
) -> None:
    """Push shipped scenes ten times as hard as their hands do.

    Ends with 1 if an energy is off by more than 1e-6 of what was exchanged, and nothing says so.
    """
    out.mkdir(parents=True, exist_ok=True)
    found, rows = [], []
    measure = partial(pushed, duration=duration)
    for one in answers(measure, names or list(shipped_scenes()), processes):
        print(one, flush=True)
        found.append(one)
        shares = np.array((one.off, one.made, one.untold)) / max(one.exchanged, 1e-300)
        numbers = (f"{one.reached:.3g}", f"{one.exchanged:.3g}", f"{one.off:.1e}")
        counts = (str(one.refined), str(one.inaccurate), one.ended)
        rows.append((one.scene, *numbers, *(f"{share:.1e}" for share in shares), *counts))
    headings = (
        *("scene", "s", "exchanged, J", "energy off by, J", "of what was exchanged"),
        *("made by contacts", "not told", "refined", "inaccurate", "ended"),
    )
    table = Sheet(f"pushed {HARDER:g} times as hard", headings, tuple(rows), ("ended",))
    print(table.markdown())
    text = json.dumps([asdict(one) for one in found], indent=1)
    (out / "bench_pushed.json").write_text(text, encoding="utf-8")
    if any(one.silent for one in found):
        raise typer.Exit(1)


if __name__ == "__main__":
    run_app(app)
