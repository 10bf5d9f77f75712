# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Virtual objects in a scene: shapes on links or in the world, and the pairs that may touch."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, StringConstraints

from hapticmech_ros.scene.mechanism import Origin
from hapticmech_ros.scene.part import Name, NonNegative, Part, Positive, Real


def not_zero(value: float) -> float:
    """Return a number that is not zero.

    Raises:
        ValueError: it is.
    """
    if value == 0.0:
        raise ValueError("must not be zero")
    return value


# m; a size outside these is a mistake of units.
Length = Annotated[Positive, Field(ge=1e-6, le=1e6)]
Size3 = tuple[Length, Length, Length]
NotZero = Annotated[Real, AfterValidator(not_zero)]
Scale3 = tuple[NotZero, NotZero, NotZero]
FilePath = Annotated[str, StringConstraints(strict=True, min_length=1)]


class Sphere(Part):
    """Ball about the origin of its frame.

    Attributes:
        kind: of geometry.
        radius: m.
    """

    kind: Literal["sphere"]
    radius: Length


class Box(Part):
    """Box about the origin of its frame.

    Attributes:
        kind: of geometry.
        size: m, its lengths along x, y and z.
    """

    kind: Literal["box"]
    size: Size3


class Cylinder(Part):
    """Cylinder along z, its middle at the origin of its frame.

    Attributes:
        kind: of geometry.
        radius: m.
        length: m.
    """

    kind: Literal["cylinder"]
    radius: Length
    length: Length


class Capsule(Part):
    """Cylinder along z with a half-ball on each end.

    Attributes:
        kind: of geometry.
        radius: m.
        length: m, of the cylinder alone.
    """

    kind: Literal["capsule"]
    radius: Length
    length: Length


class HalfSpace(Part):
    """All that is below the plane z = 0 of its frame: a floor or a wall.

    Attributes:
        kind: of geometry.
    """

    kind: Literal["half_space"]


class Mesh(Part):
    """Convex hull of the vertices in a file.

    Attributes:
        kind: of geometry.
        file: path, absolute or from the scene's file.
        scale: of the file's coordinates along x, y and z; below zero it mirrors.
    """

    kind: Literal["mesh"]
    file: FilePath
    scale: Scale3 = (1.0, 1.0, 1.0)


Geometry = Annotated[
    Sphere | Box | Cylinder | Capsule | HalfSpace | Mesh, Field(discriminator="kind")
]


class Shape(Part):
    """A rigid shape; it has no mass of its own.

    Attributes:
        name: of the shape, unique in the scene.
        link: that carries it, or ``world``.
        origin: of its frame in the link's.
        geometry: its kind and size.
    """

    name: Name
    link: Name
    origin: Origin = Origin()
    geometry: Geometry


class ContactPair(Part):
    """Two shapes that may touch, and the force law at each point of contact.

    Attributes:
        name: of the pair, unique in the scene.
        a: one shape.
        b: the other.
        law: of the push along the normal.
        stiffness: N/m, of each point.
        damping: N s/m, of each point, while it pushes; never less than stiffness times the step.
            Of Kelvin and Voigt's law.
        dissipation: s/m: damping is this times the push of the spring. Of Hunt and Crossley's law.
        friction: Coulomb's coefficient.
    """

    name: Name
    a: Name
    b: Name
    law: Literal["kelvin_voigt", "hunt_crossley"] = "kelvin_voigt"
    stiffness: Positive
    damping: NonNegative = 0.0
    dissipation: NonNegative = 0.0
    friction: NonNegative = 0.0
