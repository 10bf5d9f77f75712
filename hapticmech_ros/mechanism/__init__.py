# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Eq. 1: a scene's mechanism, its loop closures and dynamics, and steps of it.

A mechanism is compiled once from a scene: Pinocchio's model of the tree (:mod:`model`,
:mod:`mechanism`) and the constants that kernels take (:mod:`kernels.model`). All terms at a
configuration are one array (:class:`kernels.model.Data`), and kernels compute on both. The names
below are loaded when first used: reading a scene needs no kernels.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hapticmech_ros.mechanism.constraint_space import Evaluation, PointKinematics
    from hapticmech_ros.mechanism.mechanism import Mechanism

_HOMES = {
    "Evaluation": "constraint_space",
    "Mechanism": "mechanism",
    "PointKinematics": "constraint_space",
}

__all__ = ["Evaluation", "Mechanism", "PointKinematics"]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
