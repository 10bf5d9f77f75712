# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Sizes of the arrays of a tick."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL
from hapticmech_ros.mechanism.kernels.data import PARTS, views_of
from hapticmech_ros.mechanism.kernels.step_kernels import work_size
from hapticmech_ros.plan.running import Running


@dataclass(frozen=True, slots=True)
class ArraySize:
    """An array of a tick.

    Attributes:
        name: description of the content.
        shape: of the array.
        size_bytes: size of its data.
    """

    name: str
    shape: tuple[int, ...]
    size_bytes: int


def arrays_of_tick(run: Running) -> tuple[ArraySize, ...]:
    """Return the arrays of a tick, with the closures that are active at the start."""
    return tuple(ArraySize(name, a.shape, a.nbytes) for name, a in _arrays(run))


def _arrays(run: Running) -> Iterator[tuple[str, Array]]:
    mechanism = run.mechanism
    points, t = len(mechanism.point_names), run.analyser.rows.size
    yield "q", run.state.q
    yield "v", run.state.v
    active_set = mechanism.active_set(run.state.active)
    for name, array in zip(("model, integers", "model, reals"), active_set.constants, strict=True):
        yield name, array
    yield "data of a configuration", np.empty(active_set.size)
    packed = views_of(np.empty(active_set.size), active_set.model)
    for name in PARTS:
        if getattr(packed, name).size:
            yield f"of which {name}", getattr(packed, name)
    yield "workspace of a step", np.empty(work_size(mechanism.nq, mechanism.nv, points))
    terms = run.simulator.evaluate(run.state)
    yield "h", terms.bias_force
    yield "Ẇv", terms.closure_bias
    yield "J_h of each point", np.empty((points, 6, mechanism.nv))
    yield "wrenches of the task space", np.empty((t, t))
    yield "operational model for the controllers", np.empty(OPERATIONAL_MODEL.size)
    yield "device sample for the controllers", np.empty(DEVICE_SAMPLE.size)
    held = run.device.at_rest(terms.points[run.analyser.index].pose)
    yield "state of the device", held.flat
