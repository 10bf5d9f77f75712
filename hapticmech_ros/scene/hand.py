# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The hand of a scene: how firmly and when it holds the device, and its motion or push.

Measured impedance of human arms at the point held, as keys of a scene's ``arm`` hand.

Wrenches over time from a CSV file, for a hand that follows a script.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from io import StringIO
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from hapticmech_ros.errors import FileError, InvalidInputError
from hapticmech_ros.files import read_text
from hapticmech_ros.scene.part import LARGEST, Angles3, NonNegative, Part, Positive, Vector3

COLUMNS = ("time", "fx", "fy", "fz", "tx", "ty", "tz")
FILE_SIZE_LIMIT = 16_000_000


def read_script(file: str) -> npt.NDArray[np.float64]:
    """Return a script's rows, (n, 7): time (s, increasing), force (N) and torque (N m).

    Raises:
        InvalidInputError: missing, too large, or not such a table; the message names the line, its
            text, and the rule.
    """
    try:
        stream = StringIO(read_text(file, FILE_SIZE_LIMIT), newline="")
        lines = [(i, line) for i, line in enumerate(csv.reader(stream), start=1) if any(line)]
    except FileError as error:
        raise InvalidInputError("script", file, f"{error.rule} ({error.value})") from None
    except csv.Error as error:
        raise InvalidInputError("script", file, f"cannot be read: {error}") from None
    if not lines or tuple(word.strip() for word in lines[0][1]) != COLUMNS:
        where = f"line {lines[0][0]}" if lines else "line 1"
        given = lines[0][1] if lines else ""
        raise InvalidInputError(where, given, f"the heading must be {','.join(COLUMNS)}")
    if len(lines) == 1:
        raise InvalidInputError("script", file, "must have at least one row of numbers")
    rows: list[list[float]] = []
    for number, words in lines[1:]:
        row = _numbers(number, words)
        if row[0] < 0.0 or (rows and row[0] <= rows[-1][0]):
            rule = "times must be 0 or more, and increase from row to row"
            raise InvalidInputError(f"line {number}", words[0], rule)
        rows.append(row)
    return np.array(rows)


def _numbers(number: int, words: list[str]) -> list[float]:
    """Return a row's seven numbers."""
    if len(words) != len(COLUMNS):
        rule = f"must have {len(COLUMNS)} columns, {','.join(COLUMNS)}"
        raise InvalidInputError(f"line {number}", words, rule)
    row = []
    for column, word in zip(COLUMNS, words, strict=True):
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not abs(value) <= LARGEST:
            rule = f"must be a finite number, not above {LARGEST:g} in size"
            raise InvalidInputError(f"line {number}, {column}", word, rule)
        row.append(value)
    return row


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


class Tremor(Part):
    """Sinusoidal motion or push of a hand, from zero at its start.

    Attributes:
        frequency: Hz; physiological tremor of the hand is at 6 to 12 Hz.
        force: N, amplitude with its direction, world axes, added to the hand's wrench.
        torque: N m, likewise.
        xyz: m, amplitude of the target's displacement, of hands that have a target.
        rotation: rad, amplitude added to the target's rotation vector, likewise.
    """

    frequency: Positive
    force: Vector3 = (0.0, 0.0, 0.0)
    torque: Vector3 = (0.0, 0.0, 0.0)
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rotation: Angles3 = (0.0, 0.0, 0.0)


class AnyHand(Part):
    """Keys of every hand.

    Attributes:
        start_delay: s, from the time when it could take hold until it starts.
        release_at: s after the start, times at which it lets go.
        grab_at: s after the start, times at which it takes hold again. Releases and grabs take
            turns; a hand whose first is a grab does not hold before. After a grab, displacements
            count from the device's pose at the grab.
        tremor: added to its push or target, while it holds.
    """

    start_delay: NonNegative = 0.25
    release_at: tuple[NonNegative, ...] = ()
    grab_at: tuple[NonNegative, ...] = ()
    tremor: Tremor | None = None


class ConstantWrenchHand(AnyHand):
    """Hand that pushes with a constant wrench, world axes, at the point held.

    Attributes:
        kind: of hand.
        force: N.
        torque: N m.
    """

    kind: Literal["constant_wrench"]
    force: Vector3 = (0.0, 0.0, 0.0)
    torque: Vector3 = (0.0, 0.0, 0.0)


class ScriptedHand(AnyHand):
    """Hand that pushes with a wrench over time from a file, world axes, at the point held.

    Attributes:
        kind: of hand.
        file: CSV, relative to the scene file: a heading ``time,fx,fy,fz,tx,ty,tz``, then a row per
            time (s after the start), N and N m. Nothing before the first row's time; the last
            row's wrench from its time on.
        interpolation: ``linear`` from row to row, or each row's wrench ``held`` until the next.
    """

    kind: Literal["scripted"]
    file: Annotated[str, Field(min_length=1)]
    interpolation: Literal["linear", "held"] = "linear"


class Waypoint(Part):
    """Target of the hand, from where it took hold.

    Attributes:
        time: s after the start, at which it is reached; times increase.
        xyz: m, displacement, world axes.
        rotation: rad, rotation vector, world axes.
    """

    time: NonNegative
    xyz: Vector3 = (0.0, 0.0, 0.0)
    rotation: Angles3 = (0.0, 0.0, 0.0)


class TargetHand(AnyHand):
    """Hand as a spring and damper between the point held and a target that visits waypoints.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        angular_stiffness: N m/rad.
        angular_damping: N m s/rad.
        waypoints: of the target, which moves between them with minimum jerk.
    """

    stiffness: Positive = 300.0
    damping: NonNegative = 5.0
    angular_stiffness: Positive = 1.0
    angular_damping: NonNegative = 0.01
    waypoints: Annotated[tuple[Waypoint, ...], Field(min_length=1)]


class SpringDamperHand(TargetHand):
    """Hand without mass: a spring and damper to the moving target.

    Attributes:
        kind: of hand.
    """

    kind: Literal["spring_damper"]


class Grip(Part):
    """Tissue between a device and the mass of hand and arm: a spring and damper.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        angular_stiffness: N m/rad.
        angular_damping: N m s/rad.
    """

    stiffness: Positive
    damping: NonNegative = 0.0
    angular_stiffness: Positive
    angular_damping: NonNegative = 0.0


class ArmHand(TargetHand):
    """Hand and arm: a mass on the device, with spring and damper to the moving target.

    The mass is rigidly on the device, and F_h, between device and hand, is the spring's and
    damper's wrench less mass times acceleration; or it is behind a grip, whose wrench is F_h.

    Attributes:
        kind: of hand.
        impedance: measured arms whose mass, stiffness and damping the other keys then start from;
            see docs/devices.md.
        mass: kg, of hand and arm as felt at the point held.
        angular_inertia: kg m^2, about that point, isotropic.
        grip: between device and mass; none: the mass is rigidly on the device.
    """

    kind: Literal["arm"]
    impedance: ArmImpedance = "relaxed"
    mass: NonNegative = 0.5
    angular_inertia: NonNegative = 5.0e-4
    grip: Grip | None = None

    @model_validator(mode="before")
    @classmethod
    def _from_impedance(cls, given: object) -> object:
        """Add a measured arm's figures for keys that are left out."""
        if not isinstance(given, Mapping):
            return given
        named = given.get("impedance", "relaxed")
        found = ARM_IMPEDANCES.get(named) if isinstance(named, str) else None
        return given if found is None else {**found, **given}

    @model_validator(mode="after")
    def _moves_by_itself(self) -> ArmHand:
        if self.grip and not (self.mass > 0.0 and self.angular_inertia > 0.0):
            raise ValueError("mass and angular_inertia must be above 0 behind a grip")
        return self


# A relaxed arm that stays where it takes hold, and takes hold at once.
STILL_HAND = ArmHand(kind="arm", start_delay=0.0, waypoints=(Waypoint(time=0.0),))

Hand = Annotated[
    ConstantWrenchHand | SpringDamperHand | ArmHand | ScriptedHand, Field(discriminator="kind")
]
