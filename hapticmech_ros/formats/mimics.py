# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Joints that mimic others: couplings, but where one of the two does not move."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from hapticmech_ros.formats.model import Coupling, Joint

IN_FIXED = "mimic in a fixed joint"
OF_FIXED = "mimic of a joint that does not move"
WHY = {
    IN_FIXED: "there is nothing to move",
    OF_FIXED: "the joint is fixed where its leader holds it",
}


def settled(
    hinges: Sequence[Joint], couplings: Sequence[Coupling], notes: Counter[str]
) -> tuple[list[Joint], list[Coupling]]:
    """Return hinges and couplings, where what mimics a joint that does not move is fixed itself.

    Such a joint is at multiplier · 0 + offset; what mimics it in turn is fixed as well. A mimic in
    a fixed joint says nothing.
    """
    found = {hinge.name: hinge for hinge in hinges}
    moving = [one for one in couplings if found[one.joint].type != "fixed"]
    notes[IN_FIXED] += len(couplings) - len(moving)
    followers: dict[str, list[Coupling]] = {}
    for one in moving:
        followers.setdefault(one.leader, []).append(one)
    still = [(hinge.name, 0.0) for hinge in hinges if hinge.type == "fixed"]
    held = {}
    while still:
        leader, position = still.pop()
        for one in followers.get(leader, []):
            held[one.joint] = one.ratio * position + one.offset
            still.append((one.joint, held[one.joint]))
    notes[OF_FIXED] += len(held)
    for name, position in held.items():
        found[name] = _fixed(found[name], position)
    return list(found.values()), [one for one in moving if one.joint not in held]


def _fixed(hinge: Joint, position: float) -> Joint:
    """Return a joint of one coordinate held where it is at a position."""
    moved = pin.SE3.Identity()
    if hinge.type == "revolute":
        moved.rotation = pin.AngleAxis(position, hinge.axis).matrix()
    else:
        moved.translation = np.asarray(position * hinge.axis)
    place = hinge.in_parent * moved
    still = replace(hinge, damping=0.0, friction=0.0, stiffness=0.0, rest=0.0, armature=0.0)
    return replace(still, type="fixed", in_parent=place, limits=None)
