# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Why a kernel could not end a step."""

from __future__ import annotations

from types import SimpleNamespace

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import failure
from hapticmech_ros.mechanism.inertia import diverged
from hapticmech_ros.mechanism.kernels.factor_kernels import NOT_FINITE
from hapticmech_ros.mechanism.kernels.run_kernels import RATES_NOT_FINITE
from hapticmech_ros.mechanism.kernels.settle_kernels import FLIPPED, JUMPED, OPEN
from hapticmech_ros.mechanism.kernels.step_layout import ERROR, PROJECTED, STEP, TERMS_TAIL, WENT
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import not_finite
from hapticmech_ros.mechanism.projection import came_apart, flipped, jumped


def step_error(
    mechanism: Mechanism,
    parts: SimpleNamespace,
    code: int,
    packed: Array,
    active: Active,
) -> HapticMechError:
    """Return the error of a step.

    Args:
        mechanism: that was stepped.
        parts: of the work; see ``step_kernels.Work``.
        code: how the step failed; see ``run_kernels.advance``.
        packed: (size,) terms at its end.
        active: per closure, whether it is closed.
    """
    worst, names = float(packed.item(ERROR - TERMS_TAIL.size)), mechanism.names_of(active)
    if code == OPEN:
        return came_apart(worst, names)
    if code == JUMPED:
        return jumped(float(parts.account[PROJECTED] / parts.account[WENT]), names)
    if code == FLIPPED:
        wrong = [i for i, on in enumerate(active) if on and mechanism.on_wrong_branch(i, parts.q)]
        return flipped(worst, [mechanism.closures[i].name for i in wrong[:1]] or names)
    if code == RATES_NOT_FINITE:
        return not_finite("rates", parts.v)
    if code == NOT_FINITE:
        return not_finite("state", parts.q)
    return _diverged(mechanism, parts) or failure(code, mechanism.tree)


def _diverged(mechanism: Mechanism, parts: SimpleNamespace) -> HapticMechError | None:
    """Return the error of a step that went astray, if its start has what its stages lack."""
    none = tuple(False for _ in mechanism.closures)
    try:
        mechanism.closing_terms(parts.q0, none)
    except HapticMechError:
        return None
    step = float(parts.settings[STEP])
    return diverged(mechanism.tree, mechanism.difference(parts.q0, parts.q), step)
