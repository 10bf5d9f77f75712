# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What holds a device beside the mouse, in words: a mouse that moves little is to say why."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.scene.hand import ConstantWrenchHand, Hand, ScriptedHand


def holding(hand: Hand | None, limit: float) -> str:
    """Return what a hand does to a device while a mouse drags it.

    Args:
        hand: that holds it; None for nobody.
        limit: N, of the mouse's force.
    """
    if isinstance(hand, ScriptedHand):
        return f"a hand that pushes by {hand.file}"
    if hand is None or isinstance(hand, ConstantWrenchHand):
        force = 0.0 if hand is None else float(np.linalg.norm(hand.force))
        torque = 0.0 if hand is None else float(np.linalg.norm(hand.torque))
        if force == torque == 0.0:
            return "nobody but the mouse"
        return f"a hand that pushes with {force:.3g} N and {torque:.3g} N m"
    name = "an arm" if hand.kind == "arm" else "a spring"
    moves = any(any(way.xyz) or any(way.rotation) for way in hand.waypoints)
    itself = ", which moves by itself" if moves else ""
    most = 1e3 * limit / hand.stiffness
    return (
        f"{name} of {hand.stiffness:.3g} N/m{itself}: the mouse's {limit:.3g} N displace it by "
        f"{most:.3g} mm at most"
    )
