# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How what is of a user is named and coloured: by what it means, and of several users by whose.

Of one user namespaces and colours are those of :data:`~hapticmech_ros.view.palette.MEANING`. Of
several each has a hue, of which what it means is a shade, and its point's name behind namespaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hapticmech_ros.view.palette import MEANING, SHADES, USERS, Colour


@dataclass(frozen=True, slots=True)
class Look:
    """Names and colours of what is of one user, or of nobody.

    Attributes:
        user: point that is held, where there are several; empty otherwise.
        hue: of the user, likewise; None otherwise.
    """

    user: str = ""
    hue: Colour | None = None

    def namespace(self, meaning: str) -> str:
        """Return the namespace of what means something."""
        return f"{meaning}/{self.user}" if self.user else meaning

    def colour(self, meaning: str) -> Colour:
        """Return the colour of what means something; its opacity is the same for all users."""
        plain = MEANING[meaning]
        if self.hue is None:
            return plain
        shade = SHADES.get(meaning, 0.0)
        towards = 1.0 if shade > 0.0 else 0.0
        red, green, blue = (c + abs(shade) * (towards - c) for c in self.hue[:3])
        return red, green, blue, plain[3]

    def words(self, text: str) -> str:
        """Return words about a user, with the name in front where there are several."""
        return f"{self.user}: {text}" if self.user else text


PLAIN = Look()


def looks(points: Sequence[str]) -> dict[str, Look]:
    """Return how what is of each user is drawn, by the operational point held."""
    if len(points) < 2:
        return dict.fromkeys(points, PLAIN)
    return {point: Look(point, USERS[i % len(USERS)]) for i, point in enumerate(points)}


def hues(points: Sequence[str]) -> dict[str, Colour]:
    """Return the hue of each of several users, by the operational point held; of one, nothing."""
    return {name: look.hue for name, look in looks(points).items() if look.hue is not None}
