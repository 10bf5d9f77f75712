# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Colours and what they mean; a test compares them with docs/visualization.md.

Names and colours of a user's shapes depend on their meaning, and on the user if there are several.

For one user, namespaces and colours are those of :data:`~hapticmech_ros.view.palette.MEANING`. Each
of several has a hue, with a shade for each meaning, and its point's name after namespaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Look:
    """Names and colours of one user's shapes, or of common ones.

    Attributes:
        user: point that is held, where there are several; empty otherwise.
        hue: of the user, likewise; None otherwise.
    """

    user: str = ""
    hue: Colour | None = None

    def namespace(self, meaning: str) -> str:
        """Return the namespace of a meaning."""
        return f"{meaning}/{self.user}" if self.user else meaning

    def colour(self, meaning: str) -> Colour:
        """Return the colour of a meaning; its opacity is the same for all users."""
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
    """Return the look of each user's shapes, by the operational point held."""
    if len(points) < 2:
        return dict.fromkeys(points, PLAIN)
    return {point: Look(point, USERS[i % len(USERS)]) for i, point in enumerate(points)}


def hues(points: Sequence[str]) -> dict[str, Colour]:
    """Return the hue of each of several users, by the operational point held; of one, nothing."""
    return {name: look.hue for name, look in looks(points).items() if look.hue is not None}


Colour = tuple[float, float, float, float]

LINK: Colour = (0.62, 0.66, 0.72, 1.0)
JOINT: Colour = (0.25, 0.28, 0.33, 1.0)
CLOSED: Colour = (0.16, 0.65, 0.30, 1.0)
OPEN: Colour = (0.55, 0.55, 0.55, 0.8)
SOLID: Colour = (0.80, 0.68, 0.50, 0.6)
# Axes are red, green and blue for x, y and z, as everywhere; those of the world are paler.
AXES: tuple[Colour, Colour, Colour] = (
    (0.90, 0.10, 0.10, 1.0),
    (0.10, 0.70, 0.10, 1.0),
    (0.15, 0.25, 0.95, 1.0),
)
WORLD_AXES: tuple[Colour, Colour, Colour] = (
    (0.95, 0.55, 0.55, 0.7),
    (0.55, 0.85, 0.55, 0.7),
    (0.55, 0.60, 0.95, 0.7),
)
# Hues of several users, in their order; distinct with red-green colour blindness too.
USERS: tuple[Colour, ...] = (
    (0.00, 0.45, 0.75, 1.0),
    (0.85, 0.37, 0.00, 1.0),
    (0.00, 0.62, 0.45, 1.0),
    (0.75, 0.40, 0.65, 1.0),
    (0.85, 0.65, 0.05, 1.0),
    (0.35, 0.70, 0.90, 1.0),
)
# A user's shape -> how far its colour is from the user's hue to white, or if negative to black.
SHADES: dict[str, float] = {
    "hand_force": 0.4,
    "contact_force": -0.35,
    "point_command": -0.6,
    "count": 0.4,
}
# Namespace of a shape -> its name in the legend of a still picture.
LEGEND: dict[str, str] = {
    "links": "link",
    "joints": "joint",
    "closures": "closed loop",
    "open_closures": "open loop",
    "solids": "collision shape",
    "hulls": "mesh (convex hull)",
    "springs": "spring",
    "rigid_directions": "rigid direction",
    "free_directions": "free direction",
    "device": "hand",
    "mass": "mass felt",
}
# Those of one user: they have the user's hue where there are several.
FELT = frozenset({"rigid_directions", "free_directions", "device", "mass"})
# Namespace of a shape -> its colour; namespaces of axes have three.
MEANING: dict[str, Colour] = {
    "links": LINK,
    "joints": JOINT,
    "closures": CLOSED,
    "open_closures": OPEN,
    "solids": SOLID,
    "springs": (0.55, 0.40, 0.20, 1.0),
    "hand_force": (0.93, 0.53, 0.10, 1.0),
    "contact_force": (0.75, 0.20, 0.65, 1.0),
    "hulls": SOLID,
    "touch_force": (1.00, 0.40, 0.55, 1.0),
    "device_command": (0.85, 0.15, 0.15, 1.0),
    "point_command": (0.15, 0.45, 0.85, 1.0),
    "rigid_directions": (0.60, 0.35, 1.00, 0.9),
    "free_directions": (0.10, 0.65, 0.70, 0.45),
    "device": (0.95, 0.75, 0.20, 0.85),
    "mass": (0.35, 0.55, 0.90, 0.25),
    "count": (0.90, 0.90, 0.90, 1.0),
}
