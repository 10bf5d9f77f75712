# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Base types of a scene's parts: strict numbers, names, and models that refuse unknown keys."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Discriminator, Field, StringConstraints, Tag

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
# One number or a list; the written value decides, and so an error is about one of the two.
Coordinates = Annotated[
    Annotated[Real, Tag("number")] | Annotated[tuple[Real, ...], Tag("list")],
    Discriminator(lambda given: "list" if isinstance(given, list | tuple) else "number"),
]


class Part(BaseModel):
    """Base of every part of a scene: frozen, and it refuses unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")
