"""What of a scene's limits is measured: cases, each of which a process can take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hapticmech_ros.bench.feel.limits.experience import Experience, experience
from hapticmech_ros.bench.feel.limits.m_width import MPoint, m_width
from hapticmech_ros.bench.feel.limits.penetration import Yield, penetration
from hapticmech_ros.bench.feel.limits.z_width import ZPoint, z_width
from hapticmech_ros.bench.feel.stability.directions import directions
from hapticmech_ros.bench.feel.stability.touch import Setup
from hapticmech_ros.bench.feel.stability.variations import at_rate, with_loop
from hapticmech_ros.errors import HapticMechError, InvalidInputError
from hapticmech_ros.scene import Scene

# Masses of hands that are fixed to the device, over the device's.
SHARES = (1.0 / 3.0, 1.0, 3.0)
WHAT = ("z", "m", "loads")


@dataclass(frozen=True, slots=True)
class Load:
    """What steady pushes and the scene's own experiment show.

    Attributes:
        scene: its name.
        delay: periods from measuring to acting.
        yields: of a push along every direction; empty of a session that came apart.
        experience: what the experiment showed.
    """

    scene: str
    delay: int
    yields: tuple[Yield, ...]
    experience: Experience


@dataclass(frozen=True, slots=True)
class Case:
    """One thing to measure.

    Attributes:
        what: ``z``, ``m`` or ``loads``.
        scene: where.
        delay: periods.
        hand: of ``z``: ``nobody`` or ``still``.
        share: of ``m``: of the hand's mass; None for the scene's hand.
    """

    what: str
    scene: Scene
    delay: int
    hand: str = "nobody"
    share: float | None = None

    def __str__(self) -> str:
        rate = f"{1.0 / self.scene.simulation.period:.0f} Hz"
        names = {"z": "Z-width", "m": "M-width", "loads": "loads"}
        return f"{names[self.what]} of {self.scene.name}, {rate}, {self.delay} periods of delay"


Found = ZPoint | MPoint | Load


def plan(
    scenes: Sequence[Scene],
    delays: Sequence[int],
    rates: Sequence[float],
    what: Sequence[str] = WHAT,
) -> list[Case]:
    """Return what to measure: each delay at a scene's own rate, and each rate with one period.

    Args:
        scenes: where.
        delays: periods from measuring to acting.
        rates: Hz, of Z-widths besides the scene's own.
        what: of ``z``, ``m`` and ``loads``.

    Raises:
        InvalidInputError: a delay below 0, a rate below 10 Hz, or something else to measure.
    """
    for delay in delays:
        if delay < 0:
            raise InvalidInputError("delay", delay, "must be 0 or more periods")
    for name in what:
        if name not in WHAT:
            raise InvalidInputError("what", name, f"must be one of {', '.join(WHAT)}")
    cases = []
    for scene in scenes:
        hands = ["nobody", "still"] if "waypoints" in type(scene.hand).model_fields else ["nobody"]
        if "z" in what and directions(scene).held.size:
            late = with_loop(scene, False)
            own = [(late, delay) for delay in delays]
            others = [(at_rate(late, rate), 1) for rate in rates]
            kept = {(one.simulation.period, delay): one for one, delay in [*others, *own]}
            for (_, delay), one in kept.items():
                cases += [Case("z", one, delay, hand) for hand in hands]
            near = with_loop(scene, True)
            cases += [Case("z", near, delay) for delay in sorted({min(delays), max(delays)})]
        if "m" in what:
            shares = [*SHARES, *([None] if len(hands) > 1 else [])]
            cases += [Case("m", with_loop(scene, True), 1, share=share) for share in shares]
            cases.append(Case("m", with_loop(scene, False), 1, share=1.0))
        if "loads" in what:
            cases.append(Case("loads", scene, 1))
    return cases


def measure(case: Case) -> list[Found]:
    """Measure one case.

    Raises:
        HapticMechError: a scene that cannot run at all.
    """
    if case.what == "z":
        return list(z_width(case.scene, delay=case.delay, hand=case.hand))
    if case.what == "m":
        return [m_width(case.scene, delay=case.delay, share=case.share)]
    setup = Setup(case.scene, delay=case.delay)
    try:
        yields = tuple(penetration(setup))
    except HapticMechError:
        yields = ()
    return [Load(case.scene.name, case.delay, yields, experience(setup))]
