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
        damping: as of a scene's joint; left out: as in the file.
        armature: likewise.
        stiffness: likewise.
        rest: likewise.
        friction: likewise.
        friction_speed: likewise.
        effort: likewise.
        limits: likewise.
        locked: likewise.
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
