# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One exception family. Every error carries the offending value and the rule it broke.

Users catch :class:`HapticMechError` to catch all of ours; the attributes are there for programs,
the message is there for people.
"""

from __future__ import annotations

import difflib
import math
import reprlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

_BRIEF = reprlib.Repr()
_BRIEF.maxstring = _BRIEF.maxother = 80
_BRIEF.maxlist = _BRIEF.maxtuple = _BRIEF.maxdict = 12
_BRIEF.maxlevel = 3

# Names in a message.
MOST_LISTED = 30


def shown(value: object) -> str:
    """Return ``value`` for a message, cut short before it is written out in full."""
    return _BRIEF.repr(value)


def listed(names: Iterable[object]) -> str:
    """Return names for a message, with commas between; of many the first ones."""
    every = list(map(str, names))
    more = len(every) - MOST_LISTED
    return ", ".join(every[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")


def nearest(name: object, known: Iterable[str]) -> str:
    """Return the suggestion after an error about an unknown name: the most similar known one.

    Args:
        name: that was given.
        known: those there are.

    Returns:
        ``; did you mean 'joint1'?``, or nothing if none is like it.
    """
    found = difflib.get_close_matches(str(name)[:200], list(known)[:1000], n=1, cutoff=0.6)
    return f"; did you mean {found[0]!r}?" if found else ""


class HapticMechError(Exception):
    """Base class of every error that this package raises on purpose."""


class InstallationError(HapticMechError):
    """Python packages that are missing or too old.

    Attributes:
        found: installed version of each, in words.
        needed: requirements in pip's form.
    """

    def __init__(self, found: Sequence[str], needed: Sequence[str], python: str) -> None:
        self.found = tuple(found)
        self.needed = tuple(needed)
        wanted = " ".join(f"'{one}'" for one in self.needed)
        super().__init__(
            f"{'; '.join(self.found)}: hapticmech_ros needs {', '.join(self.needed)}."
            f" Install with {python} -m pip install {wanted}, or see docs/install.md"
        )


# Remedies for other libraries' errors that name none.
_REMEDIES = {
    "Failed to get logging directory": "; set ROS_LOG_DIR to a folder that this user can write",
}


def as_ours(error: Exception) -> HapticMechError:
    """Return an error as one of ours, in a sentence: another library's with its type's name."""
    if isinstance(error, HapticMechError):
        return error
    sentence = " ".join(str(error).split())
    remedy = next((remedy for words, remedy in _REMEDIES.items() if words in sentence), "")
    return HapticMechError(f"{type(error).__name__}: {sentence}{remedy}")


@dataclass(frozen=True, slots=True)
class SceneProblem:
    """One broken rule in a scene.

    Attributes:
        key_path: where, e.g. ``links[2].inertial.mass``.
        value: the offending value as it was read.
        rule: the rule that the value breaks, in words.
    """

    key_path: str
    value: object
    rule: str

    def __str__(self) -> str:
        return f"{self.key_path}: {self.rule} (got {shown(self.value)})"


class SceneError(HapticMechError):
    """A scene file or document that breaks rules; lists all problems found, not only the first."""

    def __init__(self, source: str, problems: Sequence[SceneProblem]) -> None:
        self.source = source
        self.problems = tuple(problems)
        lines = "\n".join(f"  {problem}" for problem in self.problems)
        super().__init__(f"{source}: scene refused\n{lines}")

    @classmethod
    def of_file(cls, error: FileError) -> SceneError:
        """Return the error of a scene whose file breaks a rule."""
        return cls(error.file, [SceneProblem(error.where, error.value, error.rule)])


def scene_error(source: str, key_path: str, value: object, rule: str) -> SceneError:
    """Return the error of one broken rule; see :class:`SceneProblem`."""
    return SceneError(source, [SceneProblem(key_path, value, rule)])


class ClosureError(HapticMechError):
    """Loop closures that cannot be met: the scene cannot close, or a running loop came apart."""

    def __init__(self, message: str, residual: float, closures: Sequence[str]) -> None:
        self.residual = residual
        self.closures = tuple(closures)
        super().__init__(f"{message} (closures {listed(self.closures)}, residual {residual:.3e})")


class InaccurateStepError(HapticMechError):
    """A step of the mechanism whose energy account is off, in as many substeps as it may take.

    Attributes:
        joint: whose rate changes most.
        off: energy that the step made from nothing, or lost if negative, J.
        exchanged: energy that the step exchanged, J.
        time: s, at which it began.
    """

    def __init__(self, joint: str, off: float, exchanged: float) -> None:
        super().__init__(joint, off, exchanged)
        self.joint = joint
        self.off = off
        self.exchanged = exchanged
        self.time = 0.0

    def __str__(self) -> str:
        return (
            f"the step at {self.time:.6g} s has an energy that is off by {self.off:.3g} J of "
            f"{self.exchanged:.3g} J exchanged; the rate of joint {self.joint!r} changes most: a "
            "shorter period, or more simulation.accuracy.max_substeps"
        )


class InvalidInputError(HapticMechError):
    """A value handed to the library, or received as a message, that breaks a rule."""

    def __init__(self, what: str, value: object, rule: str) -> None:
        self.what = what
        self.value = value
        self.rule = rule
        super().__init__(f"{what}: {rule} (got {shown(value)})")


def check_one_of(what: str, value: object, known: Iterable[object]) -> None:
    """Refuse a value that is none of those known; the message names the most similar one.

    Raises:
        InvalidInputError: it is none of them.
    """
    every = list(known)
    if value not in every:
        rule = f"must be one of {listed(every)}{nearest(value, map(str, every))}"
        raise InvalidInputError(what, value, rule)


def check_positive(**values: float) -> None:
    """Refuse numbers, each by its name, that are not positive and finite.

    Raises:
        InvalidInputError: one is not.
    """
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InvalidInputError(name, value, "must be a positive number")


def check_not_negative(**values: float) -> None:
    """Refuse numbers, each by its name, that are negative or not finite.

    Raises:
        InvalidInputError: one is.
    """
    for name, value in values.items():
        if not (math.isfinite(value) and value >= 0.0):
            raise InvalidInputError(name, value, "must be a number of 0 or more")


class OutputError(HapticMechError):
    """A value that a node was about to send, and that breaks a rule: it is not sent."""

    def __init__(self, what: str, value: object, rule: str) -> None:
        self.what = what
        self.value = value
        self.rule = rule
        super().__init__(f"{what} is not sent: {rule} (got {shown(value)})")


class BagError(HapticMechError):
    """A bag that cannot be read, or lacks the requested data."""


class FileError(HapticMechError):
    """A file that cannot be read or written, or whose contents break a rule.

    Attributes:
        file: its path, or another name.
        value: found there.
        rule: that it breaks, in words.
        where: in the file, such as ``line 3``.
    """

    def __init__(self, file: str, value: object, rule: str, where: str = "file") -> None:
        self.file = file
        self.value = value
        self.rule = rule
        self.where = where
        super().__init__(f"{file}: {where}: {rule} (got {shown(value)})")
