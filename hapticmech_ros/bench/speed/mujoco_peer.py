"""MuJoCo as a peer: its own loop over steps, closures as stiff as they stay stable."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from hapticmech_ros.bench.accuracy.cases import Output
from hapticmech_ros.bench.speed.contender import (
    EXTRA,
    Contender,
    Method,
    Reading,
    Setting,
    State,
)
from hapticmech_ros.bench.speed.mujoco_model import NAME, POINT, MujocoScene
from hapticmech_ros.scene import Scene

# Time constant of a closure in steps, with or without its exact inverse inertia in place of
# MuJoCo's estimate.
CONSTANT, EXACT = "time constant", "exact inertia"
# A shorter one is unstable under this rule.
IMPLICIT: tuple[Setting, ...] = ({CONSTANT: 2.0, EXACT: 1.0}, {CONSTANT: 2.0, EXACT: 0.0})
DISCRETE: tuple[Setting, ...] = (
    {CONSTANT: 1.0, EXACT: 1.0},
    {CONSTANT: 1.0, EXACT: 0.0},
    {CONSTANT: 2.0, EXACT: 1.0},
)
RUNGE_KUTTA: tuple[Setting, ...] = (
    *({CONSTANT: constant, EXACT: 0.0} for constant in (0.5, 1.0, 2.0, 4.0)),
    *({CONSTANT: constant, EXACT: 1.0} for constant in (0.7, 1.0)),
)
# The stiffest that it takes: MuJoCo clamps at this. Width, midpoint and power have no effect then.
SOLIMP = (0.9999, 0.9999, 1.0, 0.5, 1.0)
TOLERANCE = 1e-12


class MujocoPeer:
    """MuJoCo by ``mj_step``, many steps in a call.

    The solver is Newton's, which is exact for equalities in one or two iterations; islands are
    off, because finding them costs more here than it saves. MuJoCo's Euler, left out, is
    ``implicitfast`` but for how it takes dampers.
    """

    name = NAME
    methods = (
        Method("implicitfast", 1, IMPLICIT),
        Method("discrete", 1, DISCRETE),
        Method("rk4", 4, RUNGE_KUTTA),
    )

    def missing(self) -> str:
        """Return why it cannot run here, empty if it can."""
        return "" if find_spec("mujoco") else f"MuJoCo is not installed: {EXTRA}"

    def contender(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> Contender:
        """Return the scene ready to run."""
        return _Mujoco(scene, start, method, step, setting)


class _Mujoco:
    def __init__(
        self, scene: Scene, start: State, method: Method, step: float, setting: Setting
    ) -> None:
        import mujoco

        self._mujoco: Any = mujoco
        converted = MujocoScene(scene)
        spec, off = converted.spec, mujoco.mjtDisableBit
        integrators = {
            "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
            "discrete": mujoco.mjtIntegrator.mjINT_DISCRETE,
            "rk4": mujoco.mjtIntegrator.mjINT_RK4,
        }
        spec.option.integrator = integrators[method.name]
        spec.option.timestep, spec.option.tolerance = step, TOLERANCE
        unwanted = (off.mjDSBL_REFSAFE, off.mjDSBL_ISLAND, off.mjDSBL_AUTORESET)
        for bit in unwanted:
            spec.option.disableflags |= int(bit)
        if setting.get(EXACT):
            spec.option.enableflags |= int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
        for equality in spec.equalities:
            equality.solref = (setting[CONSTANT] * step, 1.0)
            equality.solimp = SOLIMP
        # Without this a motion that is lost is told in a log file in the current folder.
        mujoco.set_mju_user_warning(_say_nothing)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._qpos, self._qvel = converted.state(start)
        self._efforts = converted.efforts()
        self.restart()

    def restart(self) -> None:
        """Go back to the initial state."""
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:], self._data.qvel[:] = self._qpos, self._qvel
        self._data.qfrc_applied[:] = self._efforts

    def advance(self, steps: int) -> None:
        """Take so many steps."""
        self._mujoco.mj_step(self._model, self._data, steps)
        if not np.isfinite(self._data.qpos).all() or any(w.number for w in self._data.warning):
            raise FloatingPointError("MuJoCo's motion is lost")

    def read(self, outputs: Sequence[Output]) -> Reading:
        """Return what outputs are now, m or rad."""
        self._mujoco.mj_kinematics(self._model, self._data)
        return [self._output(output) for output in outputs]

    def _output(self, output: Output) -> tuple[float, ...]:
        if output.kind == "joint":
            values = self._data.joint(output.name).qpos
        else:
            values = self._data.site(POINT + output.name).xpos
        return tuple(float(values[k]) for k in output.components)


def _say_nothing(_text: str) -> None:
    return
