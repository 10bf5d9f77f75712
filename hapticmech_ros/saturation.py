"""Limits of a wrench: what actuators can give, and what a controller may ask for."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array


def scaled_within(wrench: Array, force_limit: float, torque_limit: float) -> Array:
    """Return ``wrench`` shortened as a whole until force and torque are within their limits.

    Force and torque keep their ratio, so a wrench that a joint can carry stays one: it does no work
    on what the mechanism leaves free.
    """
    force = float(np.sqrt(wrench[:3] @ wrench[:3]))
    torque = float(np.sqrt(wrench[3:] @ wrench[3:]))
    excess = max(force / force_limit, torque / torque_limit)
    return wrench / excess if excess > 1.0 else wrench


def limited(wrench: Array, force_limit: float, torque_limit: float) -> Array:
    """Return ``wrench`` with force and torque each shortened to its limit, directions kept."""
    force = float(np.sqrt(wrench[:3] @ wrench[:3]))
    torque = float(np.sqrt(wrench[3:] @ wrench[3:]))
    if force <= force_limit and torque <= torque_limit:
        return wrench
    shortened = wrench.copy()
    if force > force_limit:
        shortened[:3] *= force_limit / force
    if torque > torque_limit:
        shortened[3:] *= torque_limit / torque
    return shortened
