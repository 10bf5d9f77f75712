"""The integrators by name: as functions, and as numbers for kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import pinocchio as pin

from hapticmech_ros.mechanism.implicit import REACHED, WEIGHTS, linearly_implicit
from hapticmech_ros.mechanism.integrator import Advance, Motion, rk2, rk4, semi_implicit_euler
from hapticmech_ros.mechanism.model import Array

Integrator = Callable[[pin.Model, Motion, Array, Array, float], Advance]

INTEGRATORS: dict[str, Integrator] = {
    "rk4": rk4,
    "rk2": rk2,
    "semi_implicit_euler": semi_implicit_euler,
    "linearly_implicit": linearly_implicit,
}


class Scheme(NamedTuple):
    """One of the rules above as numbers, for kernels.

    Attributes:
        weights: of the stages in the sums of θ̇, v̇ and powers.
        fractions: of the step, at which the second and later stages are.
        late: positions move with the rates at the step's end, not with the sum of θ̇.
        corrected: θ̇ of later stages is J_r(θ)⁻¹ v rather than v.
        implicit: stages are those of :mod:`~hapticmech_ros.mechanism.implicit`.
    """

    weights: tuple[float, ...]
    fractions: tuple[float, ...]
    late: bool = False
    corrected: bool = False
    implicit: bool = False


SCHEMES: dict[str, Scheme] = {
    "rk4": Scheme((1 / 6, 1 / 3, 1 / 3, 1 / 6), (0.5, 0.5, 1.0), corrected=True),
    "rk2": Scheme((0.0, 1.0), (0.5,)),
    "semi_implicit_euler": Scheme((1.0,), (), late=True),
    "linearly_implicit": Scheme(
        tuple(WEIGHTS.tolist()),
        tuple(REACHED.sum(axis=1).tolist()[1:]),
        corrected=True,
        implicit=True,
    ),
}
