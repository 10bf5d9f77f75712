# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which scenes a study is of: a grid over the values of keys, or a Latin hypercube in ranges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import yaml

from hapticmech_ros.errors import FileError, InvalidInputError, check_not_negative
from hapticmech_ros.files.yaml_text import read_yaml
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.part import angle_of

# Scenes of one study.
MOST_SCENES = 10_000_000
LOGARITHMIC = "log"
RULE = "must be KEY=FROM:TO:NUMBER, KEY=FROM:TO, either with :log, or KEY=VALUE,VALUE,..."


@dataclass(frozen=True, slots=True)
class Variation:
    """Values of one or more keys of a scene.

    Attributes:
        keys: paths as of ``--set``, ``links[1].inertial.mass``; all of them get the same value.
        choices: values in a grid, as YAML has them; or all there are, without a range.
        range: least and largest value, of a Latin hypercube; None if choices are all.
        logarithmic: whether the range is spread by its logarithm.
    """

    keys: tuple[str, ...]
    choices: tuple[str, ...] = ()
    range: tuple[float, float] | None = None
    logarithmic: bool = False

    @classmethod
    def read(cls, text: str) -> Variation:
        """Return the variation of an option: ``KEY=FROM:TO:NUMBER:log``, or ``KEY=VALUE,VALUE``.

        Several keys with commas between them get the same value. Ends of a range may be angles,
        ``90 deg`` or ``pi/2``.

        Raises:
            InvalidInputError: neither.
        """
        written, sign, values = text.partition("=")
        keys = tuple(key.strip() for key in written.split(","))
        if not sign or not all(keys) or not values.strip(" ,") or values.rstrip().endswith(","):
            raise InvalidInputError("variation", text, RULE)
        if ":" not in values or set(values) & set(",[{'\""):
            return cls(keys, tuple(_choices(text, values)))
        parts = [part.strip() for part in values.split(":")]
        logarithmic = parts[-1] == LOGARITHMIC
        ends = [_end(text, part) for part in parts[: 2 if len(parts) > 2 else None]]
        rest = parts[2:-1] if logarithmic else parts[2:]
        if len(ends) != 2 or len(rest) > 1:
            raise InvalidInputError("variation", text, RULE)
        return cls.over(keys, (ends[0], ends[1]), _number(text, rest), logarithmic)

    @classmethod
    def over(
        cls,
        keys: Sequence[str],
        range: tuple[float, float],
        number: int = 0,
        logarithmic: bool = False,
    ) -> Variation:
        """Return a range, with so many values of a grid in it.

        Args:
            keys: that vary.
            range: its ends.
            number: of values in a grid; 0 if there is none.
            logarithmic: whether values are spread by their logarithm.

        Raises:
            InvalidInputError: ends that are not finite, or not positive where they must be.
        """
        first, last = range
        what = f"range of {', '.join(keys)}"
        if not (math.isfinite(first) and math.isfinite(last)):
            raise InvalidInputError(what, range, "must be finite")
        if logarithmic and min(first, last) <= 0.0:
            raise InvalidInputError(what, range, "must be above 0 to be logarithmic")
        shares = np.linspace(0.0, 1.0, number)
        made = cls(tuple(keys), (), (first, last), logarithmic)
        values = tuple(repr(made.at(share)) for share in shares.tolist())
        return cls(tuple(keys), values, (first, last), logarithmic)

    @property
    def name(self) -> str:
        """Name of its column."""
        return ", ".join(self.keys)

    def at(self, share: float) -> float:
        """Return the value of a range at a share of it, from 0 to 1; the ends to the bit."""
        first, last = self.range or (0.0, 0.0)
        if share in (0.0, 1.0):
            return (first, last)[int(share)]
        if self.logarithmic:
            return float(first * (last / first) ** share)
        return first + share * (last - first)


@dataclass(frozen=True)
class Design:
    """The scenes of a study, by their number from 0 on.

    Attributes:
        variations: of keys, each in one variation.
        samples: scenes of a Latin hypercube; 0 for a grid over all choices, the last one fastest.
        seed: of the Latin hypercube.
    """

    variations: tuple[Variation, ...]
    samples: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        keys = [key for one in self.variations for key in one.keys]
        twice = sorted({key for key in keys if keys.count(key) > 1})
        if not keys:
            raise InvalidInputError("variations", "none", "there must be at least one")
        if twice:
            raise InvalidInputError("variations", twice, "a key varies once")
        check_not_negative(samples=self.samples, seed=self.seed)
        if not self.samples:
            for one in self.variations:
                if not one.choices:
                    rule = "in a grid needs values: FROM:TO:NUMBER, or set the number of samples"
                    raise InvalidInputError("variation", one.name, rule)
        if len(self) > MOST_SCENES:
            raise InvalidInputError("scenes", len(self), f"must be {MOST_SCENES} or fewer")

    def __len__(self) -> int:
        return self.samples or math.prod(len(one.choices) for one in self.variations)

    def values(self, index: int) -> tuple[str, ...]:
        """Return the value of each variation in a scene, as YAML has it."""
        if not self.samples:
            sizes = [len(one.choices) for one in self.variations]
            places = np.unravel_index(index, sizes)
            pairs = zip(self.variations, places, strict=True)
            return tuple(one.choices[int(place)] for one, place in pairs)
        found = []
        for one, share in zip(self.variations, self._shares[index].tolist(), strict=True):
            if one.range is not None:
                found.append(repr(one.at(share)))
            else:
                found.append(one.choices[int(share * len(one.choices))])
        return tuple(found)

    def changes(self, index: int) -> tuple[str, ...]:
        """Return the changes of a scene, ``key=value`` each."""
        pairs = zip(self.variations, self.values(index), strict=True)
        return tuple(f"{key}={value}" for one, value in pairs for key in one.keys)

    @cached_property
    def _shares(self) -> Array:
        """(samples, k) shares of the ranges, from 0 to 1, by a Latin hypercube."""
        from scipy.stats import qmc  # a second, which workers need not wait

        random = np.random.default_rng(self.seed)
        sampler = qmc.LatinHypercube(len(self.variations), seed=random)
        return np.asarray(sampler.random(self.samples))


def _choices(text: str, values: str) -> list[str]:
    """Return the values between commas, as YAML has them."""
    try:
        read_yaml(f"[{values}]", "the values")
    except FileError as error:
        raise InvalidInputError("variation", text, str(error)) from None
    parts = yaml.compose(f"[{values}]", yaml.SafeLoader).value
    return [f"[{values}]"[part.start_mark.index : part.end_mark.index] for part in parts]


def number_of(text: str) -> float | None:
    """Return the number or angle (rad) that a text is; None if it is none."""
    with suppress(ValueError):
        angle = angle_of(text)
        return float(text) if angle is None else angle
    return None


def _end(text: str, part: str) -> float:
    found = number_of(part)
    if found is None:
        raise InvalidInputError("variation", text, RULE)
    return found


def _number(text: str, rest: Sequence[str]) -> int:
    """Return how many values a grid has in a range."""
    if not rest:
        return 0
    if not rest[0].isdecimal() or int(rest[0]) < 1:
        raise InvalidInputError("variation", text, RULE)
    if int(rest[0]) > MOST_SCENES:
        raise InvalidInputError("variation", text, f"must be {MOST_SCENES} values or fewer")
    return int(rest[0])
