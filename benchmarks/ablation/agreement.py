# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Before anything is timed: kernels do what they do as the Python that they are written in."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.ablation.loop import PARTS
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.session import Sample, Session, session
from hapticmech_ros.session.tick_kernels import run_ticks

# Relative to a field's size. Rounding is 1e-16; the sine of NumPy and that of the C library differ
# by one, which motions carry on.
ROUNDING = 1e-9
# A field that is smaller than this has no size of its own: m, N, s and their products.
FLOOR = 1e-3


@dataclass(frozen=True, slots=True)
class Agreement:
    """How far kernels are from the Python that they are written in.

    Attributes:
        ticks: that were compared.
        apart: largest relative difference of each part of the tick.
    """

    ticks: int
    apart: dict[str, float]

    @property
    def held(self) -> bool:
        """Whether all parts agree to rounding."""
        return all(value <= ROUNDING for value in self.apart.values())


def agreement(scene: Scene, ticks: int) -> Agreement:
    """Compare every tick of a session, part by part, with one whose kernel is not compiled."""
    compiled, plain = Session(scene), Session(scene)
    apart = dict.fromkeys(PARTS, 0.0)
    for _ in range(ticks):
        found, expected = compiled.tick(), _uncompiled(plain.tick)
        for part, fields in _parts(found).items():
            pairs = zip(fields, _parts(expected)[part], strict=True)
            apart[part] = max(apart[part], *(_apart(one, two) for one, two in pairs))
    return Agreement(ticks, apart)


def _uncompiled(tick: Callable[[], Sample]) -> Sample:
    """Return a tick's sample, by the kernel's Python."""
    names, plain = vars(session), inspect.unwrap(run_ticks)
    kernel = names["run_ticks"]
    names["run_ticks"] = lambda arguments: plain(*arguments)
    try:
        return tick()
    finally:
        names["run_ticks"] = kernel


def _parts(sample: Sample) -> dict[str, tuple[Array, ...]]:
    model, mechanism = sample.model, sample.mechanism
    return {
        "observe": (model.inverse_inertia, model.constraint_projector, model.free_acceleration),
        "control": (sample.wrenches, np.array(sample.acting)),
        "device": (sample.device.published,),
        "step": (mechanism.q, mechanism.v),
    }


def _apart(found: Array, expected: Array) -> float:
    if expected.size == 0:
        return 0.0
    size = max(float(np.abs(expected).max()), FLOOR)
    return float(np.abs(found - expected).max()) / size
