# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Λ_h⁻¹, spectrum and count over a recording or over a grid of joint positions, without ROS."""

from hapticmech_ros.bag.recorded_states import RecordedStates, states_from_bag
from hapticmech_ros.offline.analysis import (
    AnalysedStates,
    FeltStates,
    analyse_states,
    felt_states,
)
from hapticmech_ros.offline.sweep import PrescribedJoint, SweptStates, sweep

__all__ = [
    "AnalysedStates",
    "FeltStates",
    "PrescribedJoint",
    "RecordedStates",
    "SweptStates",
    "analyse_states",
    "felt_states",
    "states_from_bag",
    "sweep",
]
