# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the safety envelope of a device knows, as one array that its kernel works on."""

from __future__ import annotations

from enum import Enum

from hapticmech_ros.layout import Field, Layout


class Reason(str, Enum):
    """Why a device does not give what it is told to give."""

    WORKSPACE = "workspace"
    FORCE_LIMIT = "force_limit"
    TORQUE_LIMIT = "torque_limit"
    FORCE_SLEW = "force_slew"
    TORQUE_SLEW = "torque_slew"
    NOT_FINITE = "not_finite"


_ONE = Field(1)
# Limits, as SafetyLimits has them; period of a sample, s; centre of the workspace, m; wrench that
# left last; samples since the start; and samples that each reason has changed.
SAFETY = Layout(
    {
        **dict.fromkeys(("force", "torque", "force_slew", "torque_slew", "ramp", "radius"), _ONE),
        "period": _ONE,
        "centre": Field(3),
        "last": Field(6),
        "started": _ONE,
        **{f"limited_by_{reason.value}": _ONE for reason in Reason},
    }
)
