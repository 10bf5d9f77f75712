# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The part of a scene file that names the file which its links come from."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from hapticmech_ros.scene.mechanism import JointLimits
from hapticmech_ros.scene.part import Flag, NonNegative, Part, Positive, Real

FileName = Annotated[str, StringConstraints(strict=True, min_length=1)]


class JointChange(Part):
    """What a scene says of a joint of its file; what it leaves out stays as it is.

    ``limits: null`` takes the stops away.

    Attributes:
        damping: viscous damping per degree of freedom, N m s/rad or N s/m.
        armature: inertia of a rotor as the joint feels it, kg m² or kg.
        stiffness: of a spring in the joint, N m/rad or N/m.
        rest: position at which that spring is slack, rad or m.
        friction: Coulomb friction, N m or N.
        friction_speed: rad/s or m/s, at which friction is nearly full.
        effort: constant torque or force on the link, N m or N.
        limits: where the joint stops; ``null`` for nowhere.
        locked: whether the joint is held where it starts.
    """

    damping: NonNegative = 0.0
    armature: NonNegative = 0.0
    stiffness: NonNegative = 0.0
    rest: Real = 0.0
    friction: NonNegative = 0.0
    friction_speed: Positive = 0.01
    effort: Real = 0.0
    limits: JointLimits | None = None
    locked: Flag = False


class ModelPart(Part):
    """Where a scene's links come from.

    Attributes:
        file: URDF, MJCF or SDF, relative to the scene's own file.
        name: of the model, in an SDF file with several.
        base: ``fixed``: a body that nothing carries is the world; ``free``: it floats.
        joints: changes, by the file's names of joints.
    """

    file: FileName
    name: Annotated[str, StringConstraints(strict=True, max_length=1000)] = ""
    base: Literal["fixed", "free"] = "fixed"
    joints: dict[str, JointChange] = Field(default_factory=dict)
