# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Base types of a scene's parts: strict numbers, angles, names, models without unknown keys."""

from __future__ import annotations

import math
import re
from typing import Annotated

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    StringConstraints,
    Tag,
)

# In SI units; above any mechanism's, but products of several stay finite.
LARGEST = 1e30
Real = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-LARGEST, le=LARGEST)]
Positive = Annotated[Real, Field(gt=0.0)]
NonNegative = Annotated[Real, Field(ge=0.0)]
# Names become parts of topics and frames; a topic's name has 255 characters at most.
LONGEST_NAME = 100
Name = Annotated[
    str,
    StringConstraints(strict=True, pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=LONGEST_NAME),
]
Flag = Annotated[bool, Field(strict=True)]
Vector3 = tuple[Real, Real, Real]
_NUMBER = r"[0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?"
_DEGREES = rf"([-+]?{_NUMBER}) *deg"
_PI = rf"([-+]?)(?:({_NUMBER})\*)?pi(?:/({_NUMBER}))?"
# Text that is accepted for an angle, besides a number.
PATTERN = rf"^ *(?:{_DEGREES}|{_PI}) *$"
_TEXT = re.compile(PATTERN)


def angle_of(text: str) -> float | None:
    """Return the angle (rad) that a text is; None if it is none."""
    found = _TEXT.match(text)
    if found is None:
        return None
    degrees, sign, times, parts = found.groups()
    if degrees is not None:
        return math.radians(float(degrees))
    divisor = float(parts or 1.0)
    if divisor == 0.0:
        return None
    return math.copysign(float(times or 1.0) * math.pi / divisor, -1.0 if sign == "-" else 1.0)


def read_angle(value: object) -> object:
    """Return the angle (rad) that a value is as text; another value as it is."""
    angle = angle_of(value) if isinstance(value, str) else None
    return value if angle is None else angle


AsAngle = BeforeValidator(read_angle)
Angles3 = tuple[Annotated[Real, AsAngle], Annotated[Real, AsAngle], Annotated[Real, AsAngle]]
# One number or a list; the written value decides, and so an error is about one of the two.
Coordinates = Annotated[
    Annotated[Real, Tag("number")] | Annotated[tuple[Real, ...], Tag("list")],
    Discriminator(lambda given: "list" if isinstance(given, list | tuple) else "number"),
]


class Part(BaseModel):
    """Base of every part of a scene: frozen, and it refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")
