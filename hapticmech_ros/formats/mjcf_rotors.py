# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Rotors of an MJCF file's actuators: what they add to the inertia of the joints they drive."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from hapticmech_ros.formats.mjcf_classes import ACTUATOR, Context
from hapticmech_ros.formats.model import WHY_ELSEWHERE, Joint

OF_TENDON, ELSEWHERE = "armature of a tendon", "armature of an actuator on no hinge or slide"
WHY = {OF_TENDON: WHY_ELSEWHERE, ELSEWHERE: WHY_ELSEWHERE}
_JOINT_KEYS = ("joint", "jointinparent")


def with_rotors(context: Context, hinges: Sequence[Joint], notes: Counter[str]) -> list[Joint]:
    """Return joints with the inertia of rotors that drive them: gear ratio squared times theirs.

    Args:
        context: the file.
        hinges: its joints.
        notes: counts rotors that are left out.
    """
    source = context.source
    alone = {hinge.name for hinge in hinges if hinge.type in ("revolute", "prismatic")}
    added: dict[str, float] = {}
    for section in source.root.all("tendon"):
        for tendon in section.children:
            full = context.full(tendon)
            notes[OF_TENDON] += source.value(full, "armature", 0.0) != 0.0
    for section in source.root.all(ACTUATOR):
        for actuator in section.children:
            full = context.full(actuator)
            armature = source.value(full, "armature", 0.0)
            if armature == 0.0:
                continue
            named = [full.attributes[key].strip() for key in _JOINT_KEYS if key in full.attributes]
            if len(named) != 1 or named[0] not in alone:
                notes[ELSEWHERE] += 1
                continue
            gear = context.padded(full, "gear", (1.0,) + (0.0,) * 5)[0]
            added[named[0]] = added.get(named[0], 0.0) + gear * gear * armature
    return [replace(one, armature=one.armature + added.get(one.name, 0.0)) for one in hinges]
