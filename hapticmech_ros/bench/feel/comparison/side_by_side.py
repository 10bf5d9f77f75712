"""One scene rendered in several ways, figure by figure."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, dataclass

import numpy as np

from hapticmech_ros.bench.feel.comparison.ratio import FREQUENCIES_HZ, ratios
from hapticmech_ros.bench.feel.comparison.variants import (
    Variant,
    foreseen_delay,
    largest_delay,
    variants,
)
from hapticmech_ros.bench.feel.limits.experience import Experience, experience
from hapticmech_ros.bench.feel.limits.penetration import Yield, penetration
from hapticmech_ros.bench.feel.stability.directions import directions
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.scene.document import Scene

# N/m: half of what joint constraints have by default. What is felt stiffer counts as one.
RIGID = 1000.0


@dataclass(frozen=True, slots=True)
class Column:
    """What one way to render a scene gives.

    Attributes:
        scene, variant: names.
        delay: periods from measuring to acting.
        stiffness, damping: of the joint constraint or of the proxy, N/m and N s/m.
        errors: (k,) largest |felt / desired - 1| over the free directions, at each frequency.
        sizes: (k,) |felt / desired| farthest from 1, at each frequency: felt over desired inertia.
        stiffest_free: N/m, felt along free directions under a push of 0.3 s, at most.
        softest_held: N/m, felt along what the joints hold, at least; None where they hold nothing,
            or where sessions diverge.
        count: directions felt stiffer than 1000 N/m.
        constraints: that the joints hold.
        largest_delay: most periods at which sessions come to rest, of up to 50; -1 if none, None
            where device and mechanism are not tied together in all directions.
        foreseen_delay: the same of the linear copy of the loop.
        experience: what the scene's own experiment showed.
    """

    scene: str
    variant: str
    delay: int
    stiffness: float
    damping: float
    errors: tuple[float, ...]
    sizes: tuple[float, ...]
    stiffest_free: float
    softest_held: float | None
    count: int
    constraints: int
    largest_delay: int | None
    foreseen_delay: int
    experience: Experience

    def document(self) -> dict[str, object]:
        """Return the column as plain lists and numbers; what is not finite is left out as None."""
        plain = asdict(self)
        plain["frequencies_hz"] = list(FREQUENCIES_HZ)
        for name in ("errors", "sizes"):
            plain[name] = [one if np.isfinite(one) else None for one in plain[name]]
        seen = plain["experience"]
        for name, value in seen.items():
            if isinstance(value, float) and not np.isfinite(value):
                seen[name] = None
        return plain


def side_by_side(scene: Scene, point: str = "", delay: int = 1) -> list[Column]:
    """Return the figures of every way to render a scene.

    Args:
        scene: with any device and hand.
        point: operational point; the first one if empty.
        delay: periods from measuring to acting.

    Raises:
        InvalidInputError: a delay below 0, or a period that does not divide 1 s.
    """
    return [_column(scene.name, variant) for variant in variants(scene, point, delay)]


def _column(name: str, variant: Variant) -> Column:
    setup = variant.setup
    most = largest_delay(variant)
    ratio = np.full((1, len(FREQUENCIES_HZ)), np.inf, dtype=complex)
    yields: list[Yield] = []
    # Of a session that diverges nothing is felt that means anything.
    if most is None or most >= setup.delay:
        with suppress(HapticMechError):
            ratio = np.array([one.ratio for one in ratios(setup)])
            yields = penetration(setup)
    errors = np.abs(ratio - 1.0).max(axis=0)
    logs = np.abs(np.log(np.abs(ratio)))
    sizes = np.abs(ratio)[logs.argmax(axis=0), np.arange(ratio.shape[1])]
    free = [one.stiffness for one in yields if not one.held]
    held = [one.stiffness for one in yields if one.held]
    return Column(
        scene=name,
        variant=variant.name,
        delay=setup.delay,
        stiffness=variant.gains[0],
        damping=variant.gains[1],
        errors=tuple(errors.tolist()),
        sizes=tuple(sizes.tolist()),
        stiffest_free=max(free, default=0.0),
        softest_held=min(held, default=None),
        count=sum(one.stiffness > RIGID for one in yields),
        constraints=directions(setup.scene, setup.point).held.shape[1],
        largest_delay=most,
        foreseen_delay=foreseen_delay(variant),
        experience=experience(setup),
    )
