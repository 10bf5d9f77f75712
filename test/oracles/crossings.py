"""Mechanisms whose motion through a crossing of branches is one equation for one angle.

Each has its crossing at angle 0. All are planar, of uniform bars, and without gravity.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.accuracy import n_four_bar
from hapticmech_ros.simulation import Simulator
from oracles.planar_linkages import chain, pin_end
from oracles.running import simulator, total_energy, with_start

Array = np.ndarray
# rad/s, at the crossing.
SPEED = 5.0


class Mechanism(Protocol):
    """One of them."""

    def simulator(self, angle: float, speed: float, period: float, integrator: str) -> Simulator:
        """Return a simulator that starts at an angle (rad) and a speed (rad/s)."""
        ...

    def motion(self, angle: float, speed: float, times: Array) -> tuple[Array, Array]:
        """Return angle and speed at times (s) from such a start."""
        ...

    def configuration(self, angle: float) -> Array:
        """Return q (nq,) at an angle."""
        ...


class Parallelograms:
    """A row of parallelograms of uniform rods, 1 kg and 1 m: all uprights at one angle, 0 where
    branches cross. Its inertia is constant, and so is its speed."""

    def __init__(self, count: int) -> None:
        self._count = count

    def simulator(self, angle: float, speed: float, period: float, integrator: str) -> Simulator:
        """Return a simulator of it."""
        scene, count = n_four_bar(self._count), self._count
        q = {f"j_upright{k}": angle for k in range(count + 1)}
        v = {f"j_upright{k}": speed for k in range(count + 1)}
        q |= {f"j_top{k}": -angle for k in range(count)}
        v |= {f"j_top{k}": -speed for k in range(count)}
        changes = {
            "simulation": scene.simulation.model_copy(
                update={"period": period, "integrator": integrator}
            ),
            "gravity": (0.0, 0.0, 0.0),
            "initial_state": scene.initial_state.model_copy(update={"q": q, "v": v}),
        }
        return Simulator(scene.model_copy(update=changes))

    def motion(self, angle: float, speed: float, times: Array) -> tuple[Array, Array]:
        """Return angle and speed."""
        return angle + speed * times, np.full(times.size, speed)

    def configuration(self, angle: float) -> Array:
        """Return q."""
        return np.array([angle, -angle] * self._count + [angle])


class Rhombus:
    """Three bars of equal length, and the ground as the fourth: three branches cross in line."""

    def simulator(self, angle: float, speed: float, period: float, integrator: str) -> Simulator:
        """Return a simulator of it."""
        lengths, masses = np.ones(3), np.array([1.0, 2.0, 0.7])
        document = pin_end(chain(lengths, masses, masses / 12.0), np.array([1.0, 0.0]))
        start = with_start(document, self.configuration(angle), speed * np.array([1.0, -1.0, 1.0]))
        return simulator(start, period, integrator)

    def motion(self, angle: float, speed: float, times: Array) -> tuple[Array, Array]:
        """Return angle and speed."""
        return angle + speed * times, np.full(times.size, speed)

    def configuration(self, angle: float) -> Array:
        """Return q."""
        return np.array([angle, -angle, angle + np.pi])


class SliderCrank:
    """A crank and a rod of equal length: where the slider is at the crank's pivot, both may turn as
    one. With u = θ − π/2 the crank's angle, M(u) u̇² is constant."""

    crank, rod, slider = 1.0, 0.8, 0.5

    def simulator(self, angle: float, speed: float, period: float, integrator: str) -> Simulator:
        """Return a simulator of it."""
        document = chain(np.ones(2), np.array([self.crank, self.rod]), self._inertias())
        rail = {"name": "rail", "type": "prismatic", "axis": [1.0, 0.0, 0.0]}
        inertia = {"ixx": 0.1, "iyy": 0.1, "izz": 0.1}
        document["links"].append(
            {
                "name": "slider",
                "parent": "world",
                "joint": rail,
                "inertial": {"mass": self.slider, "com": [0.0, 0.0, 0.0], "inertia": inertia},
            }
        )
        ends = {"a": {"link": "link2", "origin": {"xyz": [1.0, 0.0, 0.0]}}, "b": {"link": "slider"}}
        document["closures"] = [{"name": "pin", "kind": "planar_pin"} | ends]
        theta = angle + np.pi / 2.0
        v = speed * np.array([1.0, -2.0, -2.0 * np.sin(theta)])
        return simulator(with_start(document, self.configuration(angle), v), period, integrator)

    def _inertias(self) -> Array:
        return np.array([self.crank, self.rod]) / 12.0

    def motion(self, angle: float, speed: float, times: Array) -> tuple[Array, Array]:
        """Return angle and speed."""

        def rates(_: float, state: Array) -> tuple[float, float]:
            u, speed = state
            # M = const + (9/4 m + 4 s) cos² u + 1/4 m sin² u, and ü = −½ M′ u̇² / M.
            turning = self.crank / 3.0 + self.rod / 12.0
            along = 2.25 * self.rod + 4.0 * self.slider
            inertia = turning + along * np.cos(u) ** 2 + 0.25 * self.rod * np.sin(u) ** 2
            slope = (0.25 * self.rod - along) * np.sin(2.0 * u)
            return speed, -0.5 * slope * speed**2 / inertia

        solution = solve_ivp(
            rates, (0.0, times[-1]), (angle, speed), "DOP853", times, rtol=1e-13, atol=1e-14
        )
        return solution.y

    def configuration(self, angle: float) -> Array:
        """Return q."""
        theta = angle + np.pi / 2.0
        return np.array([theta, -2.0 * theta, 2.0 * np.cos(theta)])


MECHANISMS = {
    "one parallelogram": Parallelograms(1),
    "two parallelograms": Parallelograms(2),
    "five parallelograms": Parallelograms(5),
    "rhombus": Rhombus(),
    "slider-crank": SliderCrank(),
}


class Passed(NamedTuple):
    """How a crossing was passed.

    Attributes:
        lost: largest change of the energy at a sample, over the energy.
        apart: largest difference of q from the motion, rad or m.
    """

    lost: float
    apart: float


def passed(
    mechanism: Mechanism,
    distance: float,
    period: float,
    integrator: str = "rk4",
    before: int = 3,
    after: int = 6,
) -> Passed:
    """Return the largest relative error of the energy, and of the configuration, at samples.

    The sample after ``before`` steps is ``distance`` (rad) beyond the crossing.
    """
    # The way there, backwards.
    back = mechanism.motion(distance, -SPEED, np.array([0.0, before * period]))
    angle, speed = float(back[0][-1]), -float(back[1][-1])
    sim = mechanism.simulator(angle, speed, period, integrator)
    state, nothing = sim.initial_state(), np.zeros((len(sim.mechanism.point_names), 6))
    energy, states = total_energy(sim, state), [state]
    for _ in range(before + after):
        states.append(sim.step(states[-1], nothing))
    lost = max(abs(total_energy(sim, state) - energy) for state in states) / energy
    times = period * np.arange(before + after + 1)
    found = np.array([state.q for state in states])
    angles, _ = mechanism.motion(angle, speed, times)
    expected = np.array([mechanism.configuration(u) for u in angles])
    return Passed(lost, float(np.abs(found - expected).max()))
