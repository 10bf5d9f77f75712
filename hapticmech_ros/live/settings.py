# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings on the page: gains while a session runs, hand and delay when it begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from ipaddress import IPv4Address, IPv6Address, ip_address

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene

# The page's server; the same as the extra ``live`` in setup.py.
VISER = "viser>=1.1"

_STILL_ARM = "hand={{kind: arm, impedance: {}, start_delay: 0.0, waypoints: [{{time: 0.0}}]}}"
MOUSE_ALONE, OWN_HAND = "the mouse alone", "the scene's hand"
# Hands of a device, and their changes of a scene; the scene's own hand needs none.
HANDS: dict[str, str] = {
    MOUSE_ALONE: "hand={kind: constant_wrench}",
    OWN_HAND: "",
    "a relaxed arm": _STILL_ARM.format("relaxed"),
    "a firm arm": _STILL_ARM.format("firm"),
}
# Longest one-way delay of the slider, ms.
LONGEST_DELAY_MS = 100.0
# Gains range from 0 to so many times the scene's.
_TIMES = 2.0
_STEPS = 200
# Key, label, and whether it is a share, from 0 to 1.
_GAINS = (
    ("controller.joint_constraint.stiffness", "constraint stiffness, N/m", False),
    ("controller.joint_constraint.damping", "constraint damping, N s/m", False),
    ("controller.position_channel.stiffness", "coupling stiffness, N/m", False),
    ("controller.position_channel.damping", "coupling damping, N s/m", False),
    ("controller.force_channel.contact", "contact force to the hand", True),
    ("controller.force_channel.hand", "hand force to the mechanism", True),
)


@dataclass(frozen=True, slots=True)
class Slider:
    """A number of a scene that can be changed.

    Attributes:
        key: of the scene.
        label: for people, with the unit.
        value: that the scene has.
        highest: that it may be set to; the lowest is 0.
    """

    key: str
    label: str
    value: float
    highest: float

    @property
    def step(self) -> float:
        """Smallest change."""
        return self.highest / _STEPS


def gain_sliders(scene: Scene) -> list[Slider]:
    """Return the gains of a user's scene that can be changed while it runs."""
    found = []
    for key, label, is_share in _GAINS:
        value = float(reduce(getattr, key.split("."), scene))  # type: ignore[arg-type]
        highest = 1.0 if is_share or value == 0.0 else float(f"{_TIMES * value:.3g}")
        found.append(Slider(key, label, value, highest))
    return found


def checked_address(what: str, host: str) -> IPv4Address | IPv6Address:
    """Return an address to serve a page at.

    Args:
        what: the option's name.
        host: as given.

    Raises:
        InvalidInputError: it is none.
    """
    try:
        return ip_address(host)
    except ValueError:
        raise InvalidInputError(what, host, "must be an address such as 127.0.0.1") from None


def changes_of(
    scene: Scene, held_by: Sequence[str] = (MOUSE_ALONE,), delay_ms: float = 0.0
) -> tuple[str, ...]:
    """Return the changes of a scene for a choice of hands and of a delay.

    Args:
        scene: as it is written.
        held_by: for each of its hands a key of :data:`HANDS`; the last one for those beyond it.
        delay_ms: one-way, between every device and its controller, ms; 0: the scene's own.
    """
    choices = [HANDS[held_by[min(i, len(held_by) - 1)]] for i in range(max(len(scene.hands), 1))]
    places = [f"hands[{i}]." for i in range(len(scene.hands))] or [""]
    changes = [f"{place}{choice}" for place, choice in zip(places, choices, strict=True) if choice]
    if delay_ms > 0.0:
        own = [p for p, one in zip(places, scene.hands, strict=False) if one.connection is not None]
        changes += [f"{place}connection.delay={1e-3 * delay_ms:.6f}" for place in ("", *own)]
    return tuple(changes)
