# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Solutions of A01 to A05 as the IFToMM library of computational benchmark problems takes them.

``python -m benchmarks.accuracy.submission``: for each problem a text file of its results, and what
the library's form asks for: accuracy, CPU time, processor, operating system, method.
"""

from __future__ import annotations

import platform
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from benchmarks.accuracy.cases import Case, cases
from benchmarks.accuracy.run import Watch, read_output, stepped
from benchmarks.machine import machine
from hapticmech_ros.cli import run_app
from hapticmech_ros.cli.console import OutOption, console
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.numerics import Array
from hapticmech_ros.simulation import MechanismState, Simulator

# s of each problem, and of them between two rows of its results.
DURATIONS = {"A01": 10.0, "A02": 10.0, "A03": 0.05, "A04": 10.0, "A05": 10.0}
ROWS = 1000
METHOD = (
    "Relative coordinates of a spanning tree; loops by closure rows, whose forces act by the "
    "dynamically consistent inverse of the joint-space inertia, with rank decided at every step; "
    "position and velocity projected in the mass metric after each step. Integrator {integrator}, "
    "step {step} s. hapticmech_ros {version} (Apache-2.0), Python with kernels compiled by Numba, "
    "one thread."
)

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


@dataclass(frozen=True, slots=True)
class Solution:
    """A problem's solution.

    Attributes:
        case: that was solved.
        integrator, step: by which; s.
        columns: names of the numbers of a row, with their units.
        rows: (n, m) time, s, outputs, m or rad, and mechanical energy less the work of constant
            efforts, J.
        energy_error: largest change of that energy, J; None where it is dissipated.
        position_error: largest difference from the reference at its times, m or rad; NaN if none.
        cpu_s: CPU time of all steps, s.
    """

    case: Case
    integrator: str
    step: float
    columns: tuple[str, ...]
    rows: Array
    energy_error: float | None
    position_error: float
    cpu_s: float

    @property
    def name(self) -> str:
        """Of its files."""
        return f"{self.case.problem}_{self.case.name}"

    def results(self) -> str:
        """Return the results file: a heading, then rows of numbers with tabs between them."""
        rows = ("\t".join(f"{number:.10e}" for number in row) for row in self.rows.tolist())
        return "\n".join(["\t".join(self.columns), *rows]) + "\n"

    def form(self) -> str:
        """Return what the form asks for, in Markdown."""
        about = machine()
        method = METHOD.format(
            integrator=self.integrator, step=f"{self.step:g}", version=version("hapticmech_ros")
        )
        error = (
            f"{self.position_error:.2e} (largest difference from the reference)"
            if self.energy_error is None
            else f"{self.energy_error:.2e} J (largest change of the mechanical energy);"
            f" {self.position_error:.1e} from the reference positions"
        )
        told = (
            ("Problem", f"{self.case.problem}, {self.case.title}"),
            ("Simulated", f"{self.rows[-1, 0]:g} s"),
            ("Accuracy", error),
            ("CPU time", f"{self.cpu_s:.4f} s"),
            ("CPU / GPU", f"{about['processor']}, one core"),
            (
                "Operating system",
                f"{platform.system()} {about['kernel']}, Python {about['python']}",
            ),
            ("Method description", method),
            ("Results file", f"{self.name}.txt"),
        )
        return "".join(f"- **{key}**: {value}\n" for key, value in told)


def solved(case: Case, duration: float) -> Solution:
    """Solve a problem by the integrator and step of its scene.

    Args:
        case: to solve.
        duration: s; output times of the reference beyond it are not compared.

    Raises:
        HapticMechError: a step that failed.
    """
    simulator, looked = Simulator(case.scene), Mechanism(case.scene)
    simulation = looked.scene.simulation
    steps = round(duration / simulation.period)
    watch = _Rows(_until(case, duration), simulation.period, looked, max(1, steps // ROWS), steps)
    cpu_s = stepped(watch, simulator, steps)
    dissipates = any(link.joint.damping for link in looked.scene.links) or any(
        spring.damping for spring in looked.scene.springs
    )
    off = np.abs(np.array(watch.energies) - watch.energies[0])
    return Solution(
        case,
        simulation.integrator,
        simulation.period,
        tuple(_columns(case)),
        np.array(watch.rows),
        None if dissipates else float(off.max()),
        max(watch.errors().values(), default=np.nan),
        cpu_s,
    )


class _Rows(Watch):
    """Keeps rows of results as well, one in so many samples and the last one, and all energies."""

    def __init__(
        self, case: Case, step: float, mechanism: Mechanism, every: int, last: int
    ) -> None:
        super().__init__(case, step, mechanism)
        self._every, self._last = every, last
        self.rows: list[list[float]] = []
        self.energies: list[float] = []

    def record(self, number: int, state: MechanismState) -> None:
        """Look at sample ``number``; 0 is the start."""
        super().record(number, state)
        self.energies.append(_energy(self._mechanism, state))
        if number % self._every == 0 or number == self._last:
            outputs = (read_output(self._mechanism, one, state) for one in self._case.outputs)
            self.rows.append([number * self._step, *chain(*outputs), self.energies[-1]])


def _until(case: Case, duration: float) -> Case:
    """Return a case that is compared up to a time, s."""
    outputs = []
    for output in case.outputs:
        if count := sum(time <= duration for time in output.times):
            times, values = output.times[:count], output.values[:count]
            outputs.append(replace(output, times=times, values=values))
    return replace(case, outputs=tuple(outputs))


def _columns(case: Case) -> Iterator[str]:
    yield "time (s)"
    for output in case.outputs:
        if output.kind == "joint":
            yield f"{output.name} (rad)"
        else:
            yield from (f"{output.name} {'xyz'[axis]} (m)" for axis in output.components)
    yield "energy (J)"


def _energy(mechanism: Mechanism, state: MechanismState) -> float:
    """Return the mechanical energy less the work of constant efforts since a coordinate's zero."""
    tree = mechanism.tree
    work = sum(
        joint.effort * float(state.q[tree.position_slice(index)][0])
        for index, joint in enumerate(tree.joints)
        if joint.effort
    )
    return float(sum(mechanism.energy(state.q, state.v))) - work


@app.command()
def submission(
    names: Annotated[list[str] | None, typer.Argument(help="of cases; all if none")] = None,
    out: OutOption = Path("iftomm"),
) -> None:
    """Solve the problems, and write their results files and forms."""
    out.mkdir(parents=True, exist_ok=True)
    for case in cases():
        if names and case.name not in names:
            continue
        found = solved(case, DURATIONS[case.problem])
        (out / f"{found.name}.txt").write_text(found.results(), encoding="utf-8")
        (out / f"{found.name}.md").write_text(found.form(), encoding="utf-8")
        console.print(f"{found.name}\n{found.form()}", highlight=False, markup=False)


if __name__ == "__main__":
    run_app(app)
