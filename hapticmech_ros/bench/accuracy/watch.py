"""What is read off the states of a run, by a mechanism of its own."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.bench.accuracy.cases import Case, Output
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism import Mechanism
from hapticmech_ros.simulation import MechanismState

# Of a step: output times are written in decimals, samples are multiples of the step.
ON_TIME = 1e-6


class Watch:
    """Compares the samples of a run with what its case says.

    A mechanism of its own, so that looking leaves no trace in the one that is stepped and timed.

    Args:
        case: what has to come out.
        step: s, between samples.
        mechanism: of the case's scene; evaluated, never stepped.

    Attributes:
        closure_error: largest residual of active closures, m or rad.
        energy_error: largest difference from the case's energy, J; None if it has none.
        ranks: (time s, rank) of the first sample, and of each whose rank differs from the one
            before.

    Raises:
        InvalidInputError: samples miss an output time.
    """

    def __init__(self, case: Case, step: float, mechanism: Mechanism) -> None:
        self._case, self._step, self._mechanism = case, step, mechanism
        self._numbers = [[_number(time, step) for time in o.times] for o in case.outputs]
        self._wanted = {number for numbers in self._numbers for number in numbers}
        self._found: dict[int, list[list[float]]] = {}
        self.closure_error = 0.0
        self.energy_error = None if case.energy is None else 0.0
        self.ranks: list[tuple[float, int]] = []

    def see(self, number: int, state: MechanismState) -> None:
        """Look at sample ``number``; 0 is the start."""
        self.closure_error = max(self.closure_error, state.closure_error)
        if any(state.active):
            rank = self._mechanism.closing_terms(state.q, state.active).space.rank
            if not self.ranks or self.ranks[-1][1] != rank:
                self.ranks.append((number * self._step, rank))
        if self._case.energy is not None and self.energy_error is not None:
            off = sum(self._mechanism.energy(state.q, state.v)) - self._case.energy
            self.energy_error = max(self.energy_error, abs(off))
        if number in self._wanted:
            self._found[number] = [self._read(output, state) for output in self._case.outputs]

    def errors(self) -> dict[str, float]:
        """Return the error of each output by its name, m or rad, once all samples were seen."""
        return {
            output.name: output.error([self._found[number][index] for number in numbers])
            for index, (output, numbers) in enumerate(
                zip(self._case.outputs, self._numbers, strict=True)
            )
        }

    def unexpected_ranks(self) -> int:
        """Return how many changes of rank are not within a step of a singular time."""
        singular = np.array(self._case.singular_times)
        return sum(
            not (np.abs(singular - time) <= 1.001 * self._step).any() for time, _ in self.ranks[1:]
        )

    def _read(self, output: Output, state: MechanismState) -> list[float]:
        tree = self._mechanism.tree
        if output.kind == "joint":
            place = tree.position_slice(tree.joint_names.index(output.name))
            return [float(state.q[place][k]) for k in output.components]
        pose = self._mechanism.frame_pose(state.q, output.name)
        return [float(pose.translation[k]) for k in output.components]


def _number(time: float, step: float) -> int:
    number = round(time / step)
    if abs(number - time / step) > ON_TIME:
        raise InvalidInputError("step", step, f"must divide {time:g} s, where the case is compared")
    return number
