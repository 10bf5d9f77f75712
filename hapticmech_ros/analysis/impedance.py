# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Felt over desired impedance of a session, along the free directions of a mechanism.

A small multisine wrench acts on the device of a session and, in a second run, on the operational
point of the mechanism alone, which gives the desired impedance: same scene, start and sampling. The
wrench varies within a period, as a hand's does; on the mechanism alone acts its mean of each. The
same runs without the wrench are subtracted, which removes motion that is not caused by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hapticmech_ros.analysis.felt_model import felt_model
from hapticmech_ros.analysis.scene_variants import held_by_nobody
from hapticmech_ros.analysis.touch import (
    ROWS,
    Setup,
    fine_times,
    means_of,
    samples_of,
    scripted,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.numerics import Array
from hapticmech_ros.operational import OperationalAnalysis
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Session
from hapticmech_ros.simulation import Simulator

FREQUENCIES_HZ = (1, 2, 3, 5, 7, 10, 14, 20, 30, 42, 60, 85)
# Amplitude of the wrench in N per Hz, proportional to frequency for equal velocities, and small
# enough for the mechanism's configuration to stay the same; torque per force, m.
PUSH_N_PER_HZ = 0.0005
TORQUE_UNIT = 0.02
SETTLING_S, WINDOW_S = 0.5, 1.0


@dataclass(frozen=True, slots=True)
class Felt:
    """Felt impedance along one direction.

    Attributes:
        direction: (6,) of the wrench, force before torque; its largest part is 1 N or 0.02 N m.
        mass: desired inertia along the direction, 1 / (dᵀ X d), kg for a force.
        frequencies: (k,) Hz.
        ratio: (k,) complex, felt over desired impedance: 1 is ideal, larger is heavier.
        predicted: (k,) the ratio by the model of analysis/felt_model.py for the same wrench.
        steady: (k,) the ratio by the model in steady state, without the initial transient.
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
        """Highest frequency, Hz, up to which |ratio| is within 3 dB; 0 if there is none."""
        within = np.abs(20.0 * np.log10(np.abs(self.ratio))) <= 3.0
        wrong = np.flatnonzero(~within)
        if wrong.size == 0:
            return float(self.frequencies[-1])
        return float(self.frequencies[wrong[0] - 1]) if wrong[0] else 0.0


def felt(scene: Scene, point: str = "", delay: int = 1) -> list[Felt]:
    """Return the felt impedance along every free direction of a scene at its start, without a hand.

    Args:
        scene: to measure.
        point: operational point; the first one if empty.
        delay: periods from measuring to acting.

    Raises:
        InvalidInputError: a period that does not divide 1 s or is too long for 85 Hz.
    """
    free = alone(scene)
    analysis = Session(free, point).tick().analysis
    frequencies = np.array(FREQUENCIES_HZ, dtype=float)
    # After the first command has arrived.
    ratios = measured_ratios(Setup(free, point, delay), frequencies, wait=delay)
    model, times = felt_model(free, point, delay), _times(free.simulation.period)
    shape = _push(free.simulation.period, frequencies)
    found = []
    for direction, ratio in ratios:
        push = shape * direction
        means = means_of(push)
        alike = model.mechanism.run(means), model.run_with(samples_of(push), means)
        predicted = np.divide(*(_answer(times, one @ direction, frequencies) for one in alike))
        steady = model.ratio(direction, frequencies)
        mass = 1.0 / float(direction @ analysis.inverse_inertia @ direction)
        found.append(Felt(direction, mass, frequencies, ratio, predicted, steady))
    return found


def measured_ratios(setup: Setup, frequencies: Array, wait: int = 0) -> list[tuple[Array, Array]]:
    """Return each free direction (6,) and felt over desired impedance (k,) along it, complex.

    Args:
        setup: of the sessions; instead of its hand one pushes.
        frequencies: (k,) of the wrench, Hz.
        wait: ticks before the wrench begins.

    Raises:
        InvalidInputError: a period that does not divide 1 s, or is too long for the frequencies.
        ClosureError: a session that ended by itself.
    """
    period, highest = setup.scene.simulation.period, float(frequencies[-1])
    samples = round(WINDOW_S / period)
    if abs(samples * period - WINDOW_S) > 1e-9 or samples < 4 * highest:
        rule = f"must divide {WINDOW_S:g} s and be below {0.25 / highest:.4f} s"
        raise InvalidInputError("simulation.period", period, rule)
    times = _times(period)
    push = _push(period, frequencies)
    still = np.zeros((len(push), 6))
    calm = _device(setup, still, wait), mechanism_twists(setup, means_of(still), wait)
    found = []
    for direction in free_directions(Session(setup.scene, setup.point).tick().analysis):
        along = push * direction
        device = (_device(setup, along, wait) - calm[0]) @ direction
        desired = (mechanism_twists(setup, means_of(along), wait) - calm[1]) @ direction
        ratio = _answer(times, desired, frequencies) / _answer(times, device, frequencies)
        found.append((direction, ratio))
    return found


def mechanism_twists(setup: Setup, pushes: Array, wait: int = 0) -> Array:
    """Return twists (n, 6) of the operational point of the mechanism alone, world axes, m/s, rad/s.

    Args:
        setup: whose mechanism starts in its initial state.
        pushes: (n, 6) on the operational point, each held for a period, N and N m, world axes.
        wait: periods before the first one.
    """
    simulator = Simulator(setup.scene)
    index = simulator.mechanism.point_index(setup.point)
    state, twists = simulator.initial_state(), np.empty((len(pushes), 6))
    wrenches = np.zeros((len(simulator.mechanism.point_names), 6))
    for _ in range(wait):
        state = simulator.step(state, wrenches)
    for tick, push in enumerate(pushes):
        twists[tick] = simulator.evaluate(state).points[index].twist
        wrenches[index] = push
        state = simulator.step(state, wrenches)
    return twists


def multisine(times: Array, frequencies: Sequence[float] | Array, sizes: Array) -> Array:
    """Return a multisine (n,) with Schroeder's phases, for a low crest factor.

    Args:
        times: (n,) s.
        frequencies: (k,) Hz.
        sizes: (k,) amplitudes, in the unit of the result.
    """
    phases = np.pi * np.arange(len(sizes)) ** 2 / len(sizes)
    turns = 2.0 * np.pi * np.outer(times, frequencies)
    return np.asarray(np.cos(turns - phases) @ sizes)


def faded_in(times: Array, duration: float) -> Array:
    """Return a factor (n,) that goes from 0 to 1 within a duration, by a raised cosine.

    No hand can exert a push that begins with a step, nor can the device extrapolate it.

    Args:
        times: (n,) s from the start.
        duration: s.
    """
    share = np.minimum(times / duration, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * share))


def amplitudes(times: Array, values: Array, frequencies: Sequence[float] | Array) -> Array:
    """Return the complex amplitudes (k,) of values (n,) at frequencies (k,), linear drift removed.

    Args:
        times: (n,) s, not necessarily equidistant.
        values: (n,) in any unit.
        frequencies: (k,) of the excitation, Hz.
    """
    turns = 2.0 * np.pi * np.outer(times, frequencies)
    drift = np.ones(times.size), times - times.mean()
    columns = np.column_stack((*drift, np.cos(turns), np.sin(turns)))
    cosines, sines = np.split(np.linalg.lstsq(columns, values, rcond=None)[0][2:], 2)
    return np.asarray(cosines - 1j * sines)


def free_directions(analysis: OperationalAnalysis) -> list[Array]:
    """Return wrenches n (6,) with X n = μ I_ℓ⁻¹ n along the free directions, world axes.

    They are scaled to a force of 1 N or a torque of ``TORQUE_UNIT`` N m, neither above that.
    """
    found = []
    for column, weight in zip(analysis.spectrum.wrenches.T, analysis.weights, strict=True):
        if weight == 0.0:
            wrench = np.zeros(6)
            wrench[analysis.rows] = column
            scale = max(np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:]) / TORQUE_UNIT)
            found.append(wrench / scale)
    return found


def alone(scene: Scene) -> Scene:
    """Return the scene without a hand and without an engagement ramp."""
    at_once = scene.controller.model_copy(update={"engagement_ramp": 0.0})
    return held_by_nobody(scene).model_copy(update={"controller": at_once})


def _push(period: float, frequencies: Array) -> Array:
    """Return the size (k, 1) of the push in a script's rows; it fades in until it settles."""
    times = fine_times(period, _times(period).size)
    push = multisine(times, frequencies, PUSH_N_PER_HZ * frequencies)
    return np.asarray((faded_in(times, SETTLING_S) * push)[:, None])


def _times(period: float) -> Array:
    return period * np.arange(round((SETTLING_S + WINDOW_S) / period))


def _answer(times: Array, velocity: Array, frequencies: Array) -> Array:
    """Return the amplitudes in the window after settling, with time from its start."""
    samples = round(WINDOW_S / times[1])
    return amplitudes(times[:samples], velocity[-samples:], frequencies)


def _device(setup: Setup, pushes: Array, wait: int) -> Array:
    """Return twists (n, 6) of the device in a session, under pushes in a script's rows."""
    period, periods = setup.scene.simulation.period, len(pushes) // ROWS
    times = wait * period + fine_times(period, periods)
    with scripted(times, pushes) as hand:
        pushed = replace(setup, scene=setup.scene.model_copy(update={"hand": hand}))
        return pushed.session().run(wait + periods)["device_true_twist"][wait:]
