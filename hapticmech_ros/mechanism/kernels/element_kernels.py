# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Forces of springs, dampers, friction and stops, and their slopes, as :mod:`elements` has them."""

from __future__ import annotations

import math

from hapticmech_ros.compilation import inner
from hapticmech_ros.mechanism.kernels.closure_kernels import add_pair, pair_power, pull_between
from hapticmech_ros.mechanism.kernels.model import Data, Model
from hapticmech_ros.numerics import Array

# Columns of ``Model.element_values``, and of ``Model.spring_values``.
STIFFNESS, REST, FRICTION, FRICTION_SPEED, LOWER, UPPER, STOP, STOP_DAMPING, DEPTH = range(9)
PULL, PULL_DAMPING, REST_LENGTH, SHORTEST_LENGTH = range(4)


@inner
def element_forces(
    model: Model, data: Data, q: Array, v: Array, passive: Array, dissipative: Array
) -> None:
    """Fill all forces but efforts (nv,), and their dissipative part (nv,), at q (nq,) and v (nv,).

    ``data`` has joint Jacobians and poses at q.
    """
    damping, elements = model.damping, model.elements
    for c in range(damping.size):
        dissipative[c] = -damping[c] * v[c]
        passive[c] = dissipative[c]
    for row in range(elements.shape[0]):
        rate, values = elements[row, 0], model.element_values[row]
        elastic, lossy = _joint_forces(values, q[elements[row, 1]], v[rate])
        dissipative[rate] += lossy
        passive[rate] += elastic + lossy
    if model.springs.shape[0] == 0:
        return
    pair = model.small[0]
    joints, axes = model.joints, data.joint_jacobian
    for row in range(model.springs.shape[0]):
        values = model.spring_values[row]
        length = _stretch(model, data, row, pair)
        a, b = model.carriers[model.springs[row, 0]], model.carriers[model.springs[row, 1]]
        loss = values[PULL_DAMPING] * pair_power(joints, axes, a, b, pair, v)
        tension = values[PULL] * (length - values[REST_LENGTH]) + loss
        add_pair(joints, axes, a, b, pair, -loss, dissipative)
        add_pair(joints, axes, a, b, pair, -tension, passive)


@inner
def element_slopes(
    model: Model,
    data: Data,
    q: Array,
    v: Array,
    horizon: float,
    stiffness: Array,
    damping: Array,
) -> None:
    """Fill K and C, (nv, nv) each, for an implicit rule.

    C has the secant of friction, and a stop counts if it is met within ``horizon`` (s).
    """
    stiffness[:] = 0.0
    damping[:] = 0.0
    for i in range(model.nv):
        damping[i, i] = model.damping[i]
    for row in range(model.elements.shape[0]):
        rate, values = model.elements[row, 0], model.element_values[row]
        position = q[model.elements[row, 1]]
        stiffness[rate, rate] += values[STIFFNESS]
        relative = abs(v[rate]) / values[FRICTION_SPEED]
        share = math.tanh(relative) / relative if relative > 1e-6 else 1.0
        damping[rate, rate] += share * values[FRICTION] / values[FRICTION_SPEED]
        for side in range(2):
            entered, speed = _contact(values, side, position, v[rate])
            deepest = entered + horizon * max(speed, 0.0)
            if deepest > 0.0:
                stiffness[rate, rate] += values[STOP]
                damping[rate, rate] += values[STOP_DAMPING] * min(deepest / values[DEPTH], 1.0)
    if model.springs.shape[0] == 0:
        return
    gradient, pair = model.turned, model.small[0]
    for row in range(model.springs.shape[0]):
        _stretch(model, data, row, pair)
        a, b = model.carriers[model.springs[row, 0]], model.carriers[model.springs[row, 1]]
        gradient[:] = 0.0
        add_pair(model.joints, data.joint_jacobian, a, b, pair, 1.0, gradient)
        pull, loss = model.spring_values[row, PULL], model.spring_values[row, PULL_DAMPING]
        for i in range(model.nv):
            for j in range(model.nv):
                square = gradient[i] * gradient[j]
                stiffness[i, j] += pull * square
                damping[i, j] += loss * square


@inner
def element_resistance(
    model: Model,
    data: Data,
    q: Array,
    v: Array,
    rates: Array,
    stiff: float,
    damped: float,
    force: Array,
) -> None:
    """Fill ``force`` (nv,) with (stiff K + damped C) rates.

    K is -∂/∂q of the elastic forces without geometric terms, C is -∂/∂v of all.
    Friction has its tangent, and a stop counts while it pushes, unlike in :func:`element_slopes`.
    In time proportional to nv: no matrix is filled.
    """
    for c in range(model.nv):
        force[c] = damped * model.damping[c] * rates[c]
    for row in range(model.elements.shape[0]):
        rate, values = model.elements[row, 0], model.element_values[row]
        position = q[model.elements[row, 1]]
        steep = 1.0 - math.tanh(v[rate] / values[FRICTION_SPEED]) ** 2
        stiffness = values[STIFFNESS]
        damping = steep * values[FRICTION] / values[FRICTION_SPEED]
        for side in range(2):
            entered, speed = _contact(values, side, position, v[rate])
            if entered > 0.0:
                soft = values[STOP_DAMPING] * min(entered / values[DEPTH], 1.0)
                if values[STOP] * entered + soft * speed > 0.0:
                    stiffness += values[STOP]
                    damping += soft
        force[rate] += (stiff * stiffness + damped * damping) * rates[rate]
    if model.springs.shape[0] == 0:
        return
    pair = model.small[0]
    joints, axes = model.joints, data.joint_jacobian
    for row in range(model.springs.shape[0]):
        values = model.spring_values[row]
        _stretch(model, data, row, pair)
        a, b = model.carriers[model.springs[row, 0]], model.carriers[model.springs[row, 1]]
        gain = stiff * values[PULL] + damped * values[PULL_DAMPING]
        gain *= pair_power(joints, axes, a, b, pair, rates)
        add_pair(joints, axes, a, b, pair, gain, force)


@inner
def _joint_forces(values: Array, position: float, rate: float) -> tuple[float, float]:
    """Return elastic and dissipative force of a joint's spring, friction and stops."""
    elastic = values[STIFFNESS] * (values[REST] - position)
    lossy = -values[FRICTION] * math.tanh(rate / values[FRICTION_SPEED])
    for side in range(2):
        entered, speed = _contact(values, side, position, rate)
        if entered > 0.0:
            outwards = 1.0 - 2.0 * side
            spring = values[STOP] * entered
            soft = min(entered / values[DEPTH], 1.0)
            push = max(spring + values[STOP_DAMPING] * soft * speed, 0.0)
            elastic += outwards * spring
            lossy += outwards * (push - spring)
    return elastic, lossy


@inner
def _contact(values: Array, side: int, position: float, rate: float) -> tuple[float, float]:
    """Return how far the lower (0) or upper (1) stop is entered, and its rate."""
    if side == 0:
        return values[LOWER] - position, -rate
    return position - values[UPPER], rate


@inner
def _stretch(model: Model, data: Data, row: int, pair: Array) -> float:
    """Return l and fill ``pair`` (12,), whose power is l̇; 0 where the line has no direction."""
    a, b = data.poses[model.springs[row, 0]], data.poses[model.springs[row, 1]]
    x, y, z = a[9] - b[9], a[10] - b[10], a[11] - b[11]
    length = math.sqrt(x * x + y * y + z * z)
    if length <= model.spring_values[row, SHORTEST_LENGTH]:
        pair[:] = 0.0
    else:
        pull_between(a, b, length, pair)
    return length
