# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Felt impedance over a graph of nodes, with a scripted hand and a recorded device.

The twist of the device is fitted at the excitation's frequencies, also if a busy machine missed
samples, and so is that of the mechanism alone under the same F_h, the means of its samples, which
gives the desired impedance: the push moves the mechanism by centimetres, so that a model linearised
at its start would be off by some percent.

The excitation has equal amplitudes at all frequencies: when a sample is missed, the device keeps an
old command meanwhile, and changes of F_h act as noise on a light device.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np

from hapticmech_ros.analysis.felt_model import felt_model
from hapticmech_ros.analysis.impedance import (
    Felt,
    amplitudes,
    free_directions,
    mechanism_twists,
    multisine,
)
from hapticmech_ros.analysis.scripted_push import fine_times, write_script
from hapticmech_ros.analysis.touch import Setup
from hapticmech_ros.arrays import Array
from hapticmech_ros.bag import BagReader
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.experiment.demo import record_graph
from hapticmech_ros.scene import Scene, document_of
from hapticmech_ros.session import Session
from hapticmech_ros.wire.cdr import decode
from hapticmech_ros.wire.layouts import unpack_device
from hapticmech_ros.wire.topics import DEVICE_STATE

FREQUENCIES_HZ = (1, 2, 3, 5, 7, 10, 14, 20, 30, 42)
# Amplitude at each frequency, N; settling time and measurement window, s.
PUSH_N = 0.05
SETTLING_S, WINDOW_S = 1.0, 4.0
# Duration in addition to that of the excitation, s.
SPARE_S = 0.3
# Share of samples that the device must have kept for a valid measurement.
ENOUGH = 0.6


class FeelGraphError(HapticMechError):
    """A graph whose felt impedance could not be measured."""


def felt_over_graph(scene: Scene, composed: bool) -> list[Felt]:
    """Return the felt impedance along every free direction over a graph of a scene.

    Args:
        scene: to measure.
        composed: whether all nodes are in one process; else in four.

    Raises:
        DemoError: a node ended, or the hand never started.
        FeelGraphError: nothing was recorded, samples twice or out of order, or too few.
    """
    sample = Session(scene).tick()
    model = felt_model(scene)
    frequencies = np.array(FREQUENCIES_HZ, dtype=float)
    found = []
    for direction in free_directions(sample.analysis):
        with tempfile.TemporaryDirectory() as folder:
            times, forces, twists = _recorded(scene, direction, composed, Path(folder))
        felt = _amplitudes(times, twists @ direction, frequencies)
        every, pushes = _without_gaps(times, forces, scene.simulation.period)
        later = np.concatenate((pushes[1:], pushes[-1:]))
        alone = mechanism_twists(Setup(scene, "", 1), 0.5 * (pushes + later))
        wanted = _amplitudes(every, alone @ direction, frequencies)
        steady = model.ratio(direction, frequencies)
        mass = 1.0 / float(direction @ sample.analysis.inverse_inertia @ direction)
        found.append(Felt(direction, mass, frequencies, wanted / felt, steady, steady))
    return found


def _amplitudes(times: Array, values: Array, frequencies: Array) -> Array:
    """Return the complex amplitudes (k,) of values (n,) after settling; times from the push on."""
    window = (times >= SETTLING_S) & (times < SETTLING_S + WINDOW_S)
    return amplitudes(times[window], values[window], frequencies)


def _without_gaps(times: Array, forces: Array, period: float) -> tuple[Array, Array]:
    """Return times (m,) of every period from the push on, and F_h (m, 6), held over gaps.

    Args:
        times: (n,) s, of the samples that there are.
        forces: (n, 6) F_h, N and N m.
        period: s.
    """
    places = np.round(times / period).astype(int)
    every = np.arange(places[-1] + 1)
    return period * every, forces[np.searchsorted(places, every, side="right") - 1]


def _recorded(
    scene: Scene, direction: Array, composed: bool, folder: Path
) -> tuple[Array, Array, Array]:
    """Return times (n,), s, from the push on, F_h and twists (n, 6) of a graph."""
    period, seconds = scene.simulation.period, SETTLING_S + WINDOW_S + SPARE_S
    time = fine_times(period, round(seconds / period))
    push = multisine(time, FREQUENCIES_HZ, np.full(len(FREQUENCIES_HZ), PUSH_N))
    script = folder / "push.csv"
    write_script(script, time, push[:, None] * direction)
    document = document_of(scene)
    document["hand"] = {"kind": "scripted", "file": script.name}
    path = folder / "felt.yaml"
    # JSON is YAML.
    path.write_text(json.dumps(document), encoding="utf-8")
    bag = folder / "bag"
    run = record_graph(str(path), bag, composed, seconds)
    if run.interruptions:
        told = [run.told(), *([] if run.load is None else run.load.sentences())]
        raise FeelGraphError("; ".join(told))
    return _samples(bag, period)


def _samples(bag: Path, period: float) -> tuple[Array, Array, Array]:
    with BagReader(bag) as reader:
        (name,) = [one for one in reader.topics if one.endswith(f"/{DEVICE_STATE.name}")]
        samples = [unpack_device(decode(data)) for _, _, data in reader.serialized(name)]
    stamps = np.array([one.stamp_ns for one in samples], dtype=float) * 1e-9
    forces = np.array([one.measured.hand_wrench for one in samples])
    twists = np.array([one.measured.twist for one in samples])
    pushed = np.flatnonzero(np.abs(forces).max(axis=1) > 0.0)
    if pushed.size < 100:
        raise FeelGraphError("no hand wrench was recorded, or rendering was interrupted")
    begun = slice(pushed[0], None)
    # Before, as the recorder finds the graph, ways of different length bring them.
    if not (np.diff(stamps[begun]) > 0.0).all():
        raise FeelGraphError("samples of the device are recorded twice, or out of order")
    times = stamps[begun] - stamps[pushed[0]]
    kept = np.count_nonzero((times >= SETTLING_S) & (times < SETTLING_S + WINDOW_S))
    if kept < ENOUGH * WINDOW_S / period:
        raise FeelGraphError(
            f"machine too busy: the device kept {kept / WINDOW_S:.0f} samples per second"
        )
    return times, forces[begun], twists[begun]
