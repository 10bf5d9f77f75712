"""Felt over desired impedance of any way to render, at a few frequencies.

As :mod:`hapticmech_ros.bench.feel.impedance` has it: a small push of several frequencies on the
hand of a session, and on the mechanism alone; runs without a push are subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.bench.feel.impedance import free_directions
from hapticmech_ros.bench.feel.stability.directions import directions
from hapticmech_ros.bench.feel.stability.touch import Setup
from hapticmech_ros.bench.feel.stability.variations import at_once, held_by_nobody
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.simulation import Simulator

FREQUENCIES_HZ = (2, 5, 10, 20)
# N per Hz, N m per 50 of it: as large at each frequency as its velocity asks, and too small for the
# mechanism to move far.
PUSH_N_PER_HZ = 0.0005
SETTLING_S, WINDOW_S = 0.5, 1.0


@dataclass(frozen=True, slots=True)
class Ratio:
    """Felt over desired impedance along one free direction.

    Attributes:
        direction: (6,) of the push; its largest part is 1 N or 0.02 N m.
        ratio: (k,) complex, at ``FREQUENCIES_HZ``; its size is felt over desired inertia.
    """

    direction: Array
    ratio: Array

    @property
    def errors(self) -> Array:
        """(k,) |ratio - 1|."""
        return np.asarray(np.abs(self.ratio - 1.0))


def ratios(setup: Setup) -> list[Ratio]:
    """Return felt over desired impedance along every free direction, held by nobody.

    Args:
        setup: of the sessions.

    Raises:
        InvalidInputError: a period that does not divide 1 s.
        ClosureError: a session that ended by itself.
    """
    alone = replace(setup, scene=at_once(held_by_nobody(setup.scene)))
    period = alone.scene.simulation.period
    if abs(round(WINDOW_S / period) * period - WINDOW_S) > 1e-9:
        raise InvalidInputError("simulation.period", period, f"must divide {WINDOW_S:g} s")
    time = period * np.arange(round((SETTLING_S + WINDOW_S) / period))
    push = np.zeros(time.size)
    for index, frequency in enumerate(FREQUENCIES_HZ):
        # Phases after Schroeder keep the peak low.
        phase = np.pi * index**2 / len(FREQUENCIES_HZ)
        push += PUSH_N_PER_HZ * frequency * np.cos(2.0 * np.pi * frequency * time - phase)
    still = np.zeros((time.size, 6))
    calm = _device(alone, still), _mechanism(alone, still)
    found = []
    for direction in free_directions(directions(alone.scene, alone.point).analysis):
        pushes = push[:, None] * direction
        felt = _lines((_device(alone, pushes) - calm[0]) @ direction, period)
        desired = _lines((_mechanism(alone, pushes) - calm[1]) @ direction, period)
        found.append(Ratio(direction, desired / felt))
    return found


def _device(setup: Setup, pushes: Array) -> Array:
    session = setup.session()
    return np.array([session.tick(hand_wrench=push).device.twist for push in pushes])


def _mechanism(setup: Setup, pushes: Array) -> Array:
    simulator = Simulator(setup.scene)
    index = simulator.mechanism.point_index(setup.point)
    state, twists = simulator.initial_state(), np.empty((len(pushes), 6))
    wrenches = np.zeros((len(simulator.mechanism.point_names), 6))
    for tick, push in enumerate(pushes):
        twists[tick] = simulator.evaluate(state).points[index].twist
        wrenches[index] = push
        state = simulator.step(state, wrenches)
    return twists


def _lines(velocity: Array, period: float) -> Array:
    """Return the complex amplitudes (k,) of a velocity, m/s, without its drift."""
    samples = round(WINDOW_S / period)
    turns = 2.0 * np.pi * np.arange(samples) / samples
    columns = [np.ones(samples), np.linspace(-1.0, 1.0, samples)]
    for frequency in FREQUENCIES_HZ:
        columns += [np.cos(frequency * turns), np.sin(frequency * turns)]
    fit = np.linalg.lstsq(np.array(columns).T, velocity[-samples:], rcond=None)[0][2:]
    return np.asarray(fit[0::2] - 1j * fit[1::2])
