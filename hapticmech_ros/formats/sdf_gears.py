# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Gears of SDFormat: gearboxes between two hinges on one link, and axes that mimic others."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from hapticmech_ros.formats.model import Coupling, Joint
from hapticmech_ros.formats.xml_nodes import Node, Source

# Of the sine of the angle between axes that are one, as files of six digits have them.
PARALLEL = 1e-3
INEXACT = "gearbox"
WHY_INEXACT = "not between two hinges on its reference body: say a coupling in a scene file"


def gearbox(
    source: Source,
    joint: Node,
    ends: tuple[str, str, str],
    hinges: Iterable[Joint],
    axes: Mapping[str, np.ndarray],
    axis_of: Callable[[Joint], np.ndarray],
) -> Coupling | None:
    """Return a gearbox as a coupling of two hinges; None if these are not there.

    With θ₁ from the reference body to the parent about ``axis``, and θ₂ from it to the child about
    ``axis2``, SDFormat says θ₂ = -ratio θ₁.

    Args:
        source: the file.
        joint: the gearbox.
        ends: reference body, parent and child.
        hinges: the model's other joints.
        axes: ``axis`` and ``axis2`` of the gearbox -> (3,) unit vector, world axes.
        axis_of: returns a hinge's axis (3,), likewise.
    """
    name, (reference, parent, child) = source.text(joint, "name"), ends
    hinges = list(hinges)
    found = []
    for end, tag in ((parent, "axis"), (child, "axis2")):
        if tag not in axes:
            return None
        signs = [(hinge, _sign(hinge, reference, end, axes[tag], axis_of)) for hinge in hinges]
        exact = [(hinge, sign) for hinge, sign in signs if sign]
        if len(exact) != 1:
            return None
        found += exact
    (leader, first), (follower, second) = found
    written = joint.first("gearbox_ratio")
    ratio = source.numbers(written, written.text, 1, "a ratio")[0] if written is not None else 1.0
    return Coupling(name, follower.name, leader.name, -ratio * first * second, 0.0)


def _sign(
    hinge: Joint,
    reference: str,
    end: str,
    axis: np.ndarray,
    axis_of: Callable[[Joint], np.ndarray],
) -> int:
    """Return 1 or -1, as a hinge's angle counts from link to link about an axis, or else 0."""
    forward = (hinge.parent, hinge.child) == (reference, end)
    backward = (hinge.parent, hinge.child) == (end, reference)
    if hinge.type != "revolute" or not (forward or backward):
        return 0
    own = axis_of(hinge)
    if np.linalg.norm(np.cross(own, axis)) > PARALLEL:
        return 0
    same = bool(own @ axis > 0.0)
    return 1 if same == forward else -1


def mimic(source: Source, joint: Node, axis: Node) -> Coupling | None:
    """Return what an axis mimics; None if it is none, or another joint's second axis.

    Raises:
        SceneError: a mimic without a multiplier.
    """
    written = axis.first("mimic")
    if written is None or written.attributes.get("axis", "axis") != "axis":
        return None
    name, leader = source.text(joint, "name"), source.text(written, "joint")
    values = []
    for tag in ("multiplier", "offset", "reference"):
        part = written.first(tag)
        if part is None and tag == "multiplier":
            raise source.error(written, name, "a mimic needs a <multiplier>")
        values.append(source.numbers(part, part.text, 1, tag)[0] if part is not None else 0.0)
    ratio, offset, reference = values
    return Coupling(f"{name}_mimics_{leader}", name, leader, ratio, offset - ratio * reference)
