"""What the accuracy benchmark runs: cases, each by every integrator at several steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast, get_args

from benchmarks.accuracy.cases import Case, cases
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import IntegratorName

INTEGRATOR_NAMES: tuple[IntegratorName, ...] = get_args(IntegratorName)
# Multiples of the step that a case's scene has, which a squeezer in hundredths of a second and a
# pendulum in seconds can share.
MULTIPLES = (4.0, 2.0, 1.0, 0.5, 0.25)
# A step of a large case takes as long as many of a small one.
LARGE_MULTIPLES = (8.0, 4.0, 2.0)
QUICK_MULTIPLES = (2.0, 1.0)
LARGE = "large"
# Scenes step by 1 ms or less, and the schema takes no more than 100 ms.
LARGEST_MULTIPLE = 100.0


@dataclass(frozen=True, slots=True)
class Setting:
    """One run: a case by an integrator at a step (s)."""

    case: Case
    integrator: IntegratorName
    step: float

    @property
    def own(self) -> bool:
        """Whether integrator and step are those of the case's scene."""
        simulation = self.case.scene.simulation
        return (self.integrator, self.step) == (simulation.integrator, simulation.period)

    @property
    def scene(self) -> Scene:
        """The case's scene with this integrator and step; nothing else is changed."""
        change = {"integrator": self.integrator, "period": self.step}
        simulation = self.case.scene.simulation.model_copy(update=change)
        return self.case.scene.model_copy(update={"simulation": simulation})

    def __str__(self) -> str:
        return f"{self.case.name}, {self.integrator}, {1e3 * self.step:g} ms"


def settings(
    names: Sequence[str] = (),
    integrators: Sequence[str] = (),
    multiples: Sequence[float] = (),
    quick: bool = False,
    known: Sequence[Case] | None = None,
) -> tuple[Setting, ...]:
    """Return the runs, case by case.

    Args:
        names: of cases; all if empty.
        integrators: all if empty.
        multiples: steps, in steps of the case's own scene; 4 to 1/4 if empty, fewer for large ones.
        quick: few steps, and no large case unless it is named.
        known: cases to choose from; all of the library if None.

    Raises:
        InvalidInputError: unknown case or integrator, a step that is not above zero.
        SceneError: a scene is damaged.
    """
    chosen = _chosen(names, cases() if known is None else known, quick)
    for integrator in integrators:
        if integrator not in INTEGRATOR_NAMES:
            rule = f"must be one of {list(INTEGRATOR_NAMES)}"
            raise InvalidInputError("integrator", integrator, rule)
    for multiple in multiples:
        if not 0.0 < multiple <= LARGEST_MULTIPLE:
            rule = f"must be above 0, and at most {LARGEST_MULTIPLE:g} steps of the scene's own"
            raise InvalidInputError("step", multiple, rule)
    rules = cast("Sequence[IntegratorName]", integrators) or INTEGRATOR_NAMES
    return tuple(
        Setting(case, integrator, multiple * case.scene.simulation.period)
        for case in chosen
        for integrator in rules
        for multiple in multiples or _usual(case, quick)
    )


def _chosen(names: Sequence[str], known: Sequence[Case], quick: bool) -> list[Case]:
    if not names:
        return [case for case in known if not (quick and LARGE in case.tags)]
    by_name = {case.name: case for case in known}
    for name in names:
        if name not in by_name:
            raise InvalidInputError("case", name, f"must be one of {list(by_name)}")
    return [by_name[name] for name in names]


def _usual(case: Case, quick: bool) -> tuple[float, ...]:
    if quick:
        return QUICK_MULTIPLES
    return LARGE_MULTIPLES if LARGE in case.tags else MULTIPLES
