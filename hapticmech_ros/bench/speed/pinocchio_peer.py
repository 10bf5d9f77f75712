"""Pinocchio as a peer: its dynamics under the classical Runge-Kutta rule, in a lean loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from hapticmech_ros.arrays import Array
from hapticmech_ros.bench.accuracy.cases import Output
from hapticmech_ros.bench.speed.contender import (
    Contender,
    Method,
    Reading,
    Setting,
    State,
    UnsuitableError,
)
from hapticmech_ros.bench.speed.pinocchio_dynamics import NAME, PinocchioDynamics
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.scene import Scene

# The closures' pull a: so much per second, or per step. A fixed one keeps the order of the rule;
# where singular positions are passed only a strong one holds.
RATE, GAIN = "pull times s", "pull times step"
SETTINGS: tuple[Setting, ...] = (
    {RATE: 5.0},
    {RATE: 20.0},
    {GAIN: 0.02},
    {GAIN: 0.1},
    {GAIN: 0.3},
)
# Of the proximal solver: with a smaller μ redundant closures lose digits.
SOFTNESS, ACCURACY, ITERATIONS = 1e-8, 1e-11, 5


class PinocchioPeer:
    """Pinocchio by ``constraintDynamics`` or ``aba``, which are C++; the rule is Python."""

    name = NAME
    methods = (Method("rk4", 4, SETTINGS),)

    def missing(self) -> str:
        """Return why it cannot run here: this package needs it anyway."""
        return ""

    def contender(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> Contender:
        """Return the scene ready to run."""
        return _Pinocchio(scene, start, step, setting)


class _Pinocchio:
    def __init__(self, scene: Scene, start: State, step: float, setting: Setting) -> None:
        pull = setting.get(RATE, 0.0) + setting.get(GAIN, 0.0) / step
        self._dynamics = PinocchioDynamics(scene, pull, SOFTNESS, ACCURACY, ITERATIONS)
        self._start, self._step = start, step
        model = self._dynamics.model
        # Only then are coordinates numbers that add up.
        self._advance = self._in_numbers if model.nq == model.nv else self._on_manifold
        if "planar" in self._dynamics.tree.joint_types:
            raise UnsuitableError(NAME, scene.name, "a planar joint")
        self.restart()

    def restart(self) -> None:
        """Go back to the initial state."""
        self._q, self._v = self._start.q.copy(), self._start.v.copy()

    def advance(self, steps: int) -> None:
        """Take so many steps."""
        with np.errstate(over="ignore", invalid="ignore"):
            self._advance(steps)
        if not np.isfinite(self._q).all():
            raise FloatingPointError("Pinocchio's motion is lost")

    def read(self, outputs: Sequence[Output]) -> Reading:
        """Return what outputs are now, m or rad."""
        return self._dynamics.read(self._q, outputs)

    def _in_numbers(self, steps: int) -> None:
        """Step q and v as numbers; copies only where a result would be overwritten."""
        rate, step, half, sixth = (
            self._dynamics.acceleration,
            self._step,
            0.5 * self._step,
            self._step / 6.0,
        )
        q, v = self._q, self._v
        for _ in range(steps):
            first = rate(q, v).copy()
            v2 = v + half * first
            second = rate(q + half * v, v2).copy()
            v3 = v + half * second
            third = rate(q + half * v2, v3).copy()
            v4 = v + step * third
            fourth = rate(q + step * v3, v4)
            q = q + sixth * (v + 2.0 * (v2 + v3) + v4)
            v = v + sixth * (first + 2.0 * (second + third) + fourth)
        self._q, self._v = q, v

    def _on_manifold(self, steps: int) -> None:
        """Step on the configuration manifold: stages in coordinates θ around the step's start."""
        rate, tree, step = self._dynamics.acceleration, self._dynamics.tree, self._step
        half, sixth = 0.5 * step, step / 6.0
        move, model = pin.integrate, self._dynamics.model
        q, v = self._q, self._v
        for _ in range(steps):
            first = rate(q, v).copy()
            theta, v2 = half * v, v + half * first
            second = rate(move(model, q, theta), v2).copy()
            turn2, v3 = local_rates(tree, theta, v2), v + half * second
            theta = half * turn2
            third = rate(move(model, q, theta), v3).copy()
            turn3, v4 = local_rates(tree, theta, v3), v + step * third
            theta = step * turn3
            fourth = rate(move(model, q, theta), v4)
            q = move(model, q, sixth * (v + 2.0 * (turn2 + turn3) + local_rates(tree, theta, v4)))
            v = v + sixth * (first + 2.0 * (second + third) + fourth)
        self._q, self._v = q, v


def local_rates(tree: TreeModel, theta: Array, speed: Array) -> Array:
    """Return θ̇ (nv,) at θ for rates ``speed``: turns in space need the exponential's slope."""
    rates = speed.copy()
    for index, kind in enumerate(tree.joint_types):
        if kind == "free":
            at = tree.velocity_slice(index)
            rates[at] = pin.Jlog6(pin.exp6(theta[at])) @ speed[at]
        elif kind == "spherical":
            at = tree.velocity_slice(index)
            rates[at] = pin.Jlog3(pin.exp3(theta[at])) @ speed[at]
    return rates
