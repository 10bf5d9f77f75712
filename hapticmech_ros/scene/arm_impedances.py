# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Measured impedance of human arms at the point held, as keys of a scene's ``arm`` hand."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

ArmImpedance = Literal["relaxed", "firm"]
# A relaxed arm: mass, damping and stiffness that van Beek, Bergmann Tiest, Mugge and Kappers fitted
# (Scientific Reports 5:18004, 2015, figure 3: 0.554 kg, 6.45 N s/m, 135 N/m). A firm one: stiffness
# of the endpoint grows in proportion to grasp force (Takagi, Xiong, Kambara and Koike, Scientific
# Reports, 2020, doi 10.1038/s41598-019-57267-0); here it is four times that of the relaxed one,
# with the same mass and damping ratio. Of rotation no such fit was found: a fist of that mass with
# a radius of gyration of 30 mm, at the same natural frequency and damping ratio.
_RADIUS_SQUARED = 0.03**2
ARM_IMPEDANCES: dict[str, dict[str, float]] = {
    name: {
        "mass": mass,
        "damping": damping,
        "stiffness": stiffness,
        "angular_inertia": mass * _RADIUS_SQUARED,
        "angular_damping": damping * _RADIUS_SQUARED,
        "angular_stiffness": stiffness * _RADIUS_SQUARED,
    }
    for name, mass, damping, stiffness in (
        ("relaxed", 0.554, 6.45, 135.0),
        ("firm", 0.554, 12.9, 540.0),
    )
}


def with_impedance(given: object) -> object:
    """Return what a scene says of its arm, with a measured arm's figures where it says nothing."""
    if not isinstance(given, Mapping):
        return given
    named = given.get("impedance", "relaxed")
    found = ARM_IMPEDANCES.get(named) if isinstance(named, str) else None
    return given if found is None else {**found, **given}
