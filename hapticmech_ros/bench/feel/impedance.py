"""Felt over desired impedance of a session, along the directions that a mechanism leaves free.

A small push of many frequencies at once acts on the hand of a session, and on the operational point
of the mechanism alone, which is what the hand should feel: same scene, same start, same samples.
Runs without the push are subtracted, so that what moves by itself does not count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.felt_model import felt_model
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.scene.document import Scene
from hapticmech_ros.scene.hand import ConstantWrenchHand
from hapticmech_ros.session import Session
from hapticmech_ros.simulation import Simulator

FREQUENCIES_HZ = (1, 2, 3, 5, 7, 10, 14, 20, 30, 42, 60, 85)
# Of the push: as large at each frequency as its velocity asks, N per Hz, and so small that what the
# mechanism moves meanwhile is not seen; and N m of a torque per N of a force.
PUSH_N_PER_HZ = 0.0005
TORQUE_UNIT = 0.02
SETTLING_S, WINDOW_S = 0.5, 1.0


@dataclass(frozen=True, slots=True)
class Felt:
    """What is felt along one direction.

    Attributes:
        direction: (6,) of the push, force before torque; its largest part is 1 N or 0.02 N m.
        mass: that X promises there, kg for a push by a force: 1 / (dᵀ X d).
        frequencies: (k,) Hz.
        ratio: (k,) complex, felt over desired impedance: 1 is right, larger is heavier.
        predicted: (k,) the same by the model of control/felt_model.py, pushed as the session is.
        steady: (k,) what the model says is left once all that the push began with has died away.
    """

    direction: Array
    mass: float
    frequencies: Array
    ratio: Array
    predicted: Array
    steady: Array

    def error(self, frequency: float) -> float:
        """Return the largest |ratio - 1| up to a frequency, Hz."""
        return float(np.abs(self.ratio - 1.0)[self.frequencies <= frequency].max())

    def steady_error(self, frequency: float) -> float:
        """Return the largest |steady - 1| up to a frequency, Hz."""
        return float(np.abs(self.steady - 1.0)[self.frequencies <= frequency].max())

    def model_error(self, frequency: float) -> float:
        """Return the largest |predicted / ratio - 1| up to a frequency, Hz."""
        off = np.abs(self.predicted / self.ratio - 1.0)
        return float(off[self.frequencies <= frequency].max())

    @property
    def bandwidth(self) -> float:
        """Highest frequency, Hz, up to which the felt size is within 3 dB; 0 if at none."""
        within = np.abs(20.0 * np.log10(np.abs(self.ratio))) <= 3.0
        wrong = np.flatnonzero(~within)
        if wrong.size == 0:
            return float(self.frequencies[-1])
        return float(self.frequencies[wrong[0] - 1]) if wrong[0] else 0.0


def felt(scene: Scene, point: str = "", delay: int = 1) -> list[Felt]:
    """Return what is felt along every free direction of a scene at its start, held by nobody.

    Args:
        scene: to feel.
        point: operational point; the first one if empty.
        delay: periods from measuring to acting.

    Raises:
        InvalidInputError: a period that does not divide 1 s, or is too long for 85 Hz.
    """
    alone = _alone(scene)
    samples = round(WINDOW_S / alone.simulation.period)
    if abs(samples * alone.simulation.period - WINDOW_S) > 1e-9 or samples < 4 * FREQUENCIES_HZ[-1]:
        rule = f"must divide {WINDOW_S:g} s and be below {0.25 / FREQUENCIES_HZ[-1]:.4f} s"
        raise InvalidInputError("simulation.period", alone.simulation.period, rule)
    analysis = Session(alone, point).tick().analysis
    calm = _device(alone, point, delay, None), _mechanism(alone, point, delay, None)
    model, frequencies = felt_model(alone, point, delay), np.array(FREQUENCIES_HZ, dtype=float)
    found = []
    for direction in free_directions(analysis):
        push = _push(alone.simulation.period)[:, None] * direction
        device = (_device(alone, point, delay, push) - calm[0]) @ direction
        desired = (_mechanism(alone, point, delay, push) - calm[1]) @ direction
        ratio = _lines(desired, samples) / _lines(device, samples)
        alike = (one.run(push) @ direction for one in (model.mechanism, model))
        predicted = np.divide(*(_lines(one, samples) for one in alike))
        steady = model.ratio(direction, frequencies)
        mass = 1.0 / float(direction @ analysis.inverse_inertia @ direction)
        found.append(Felt(direction, mass, frequencies, ratio, predicted, steady))
    return found


def free_directions(analysis: OperationalAnalysis) -> list[Array]:
    """Return wrenches (6,) along the directions that are felt as inertia alone, X's own."""
    found = []
    for column, weight in zip(analysis.spectrum.wrenches.T, analysis.weights, strict=True):
        if weight == 0.0:
            wrench = np.zeros(6)
            wrench[analysis.rows] = column
            scale = max(np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:]) / TORQUE_UNIT)
            found.append(wrench / scale)
    return found


def _alone(scene: Scene) -> Scene:
    """Return the scene held by nobody, and engaged at once."""
    nobody = ConstantWrenchHand(kind="constant_wrench")
    at_once = scene.controller.model_copy(update={"engagement_ramp": 0.0})
    return scene.model_copy(update={"hand": nobody, "controller": at_once})


def _push(period: float) -> Array:
    """Return the push over time; phases after Schroeder keep its peak low."""
    time = period * np.arange(round((SETTLING_S + WINDOW_S) / period))
    push = np.zeros(time.size)
    for index, frequency in enumerate(FREQUENCIES_HZ):
        phase = np.pi * index**2 / len(FREQUENCIES_HZ)
        push += PUSH_N_PER_HZ * frequency * np.cos(2.0 * np.pi * frequency * time - phase)
    return push


def _device(scene: Scene, point: str, delay: int, push: Array | None) -> Array:
    """Return twists (n, 6) of the device in a session, once its first command has arrived."""
    session = Session(scene, point, delay)
    for _ in range(delay):
        session.tick()
    count = round((SETTLING_S + WINDOW_S) / session.period)
    twists = np.empty((count, 6))
    for index in range(count):
        sample = session.tick(hand_wrench=None if push is None else push[index])
        twists[index] = sample.device.twist
    return twists


def _mechanism(scene: Scene, point: str, delay: int, push: Array | None) -> Array:
    """Return twists (n, 6) of the operational point of the mechanism alone, from the same time."""
    simulator = Simulator(scene)
    index = simulator.mechanism.point_index(point)
    state = simulator.initial_state()
    count = round((SETTLING_S + WINDOW_S) / simulator.period)
    twists = np.empty((count, 6))
    wrenches = np.zeros((len(simulator.mechanism.point_names), 6))
    for _ in range(delay):
        state = simulator.step(state, wrenches)
    for tick in range(count):
        twists[tick] = simulator.evaluate(state).points[index].twist
        if push is not None:
            wrenches[index] = push[tick]
        state = simulator.step(state, wrenches)
    return twists


def _lines(velocity: Array, samples: int) -> Array:
    """Return the complex amplitudes of a velocity at the push's frequencies, without its drift."""
    last = velocity[-samples:]
    turns = 2.0 * np.pi * np.arange(samples) / samples
    columns = [np.ones(samples), np.linspace(-1.0, 1.0, samples)]
    for frequency in FREQUENCIES_HZ:
        columns += [np.cos(frequency * turns), np.sin(frequency * turns)]
    fit = np.linalg.lstsq(np.array(columns).T, last, rcond=None)[0][2:].reshape(-1, 2)
    return np.asarray(fit[:, 0] - 1j * fit[:, 1])
