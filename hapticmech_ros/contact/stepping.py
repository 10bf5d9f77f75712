"""Periods of a mechanism that touches things, by a kernel that calls for what it cannot do itself.

That is the search for nearest points of two bounded shapes, and steps that need care.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hapticmech_ros.contact.layout import (
    COUNTED,
    HELD,
    NEEDS_SEARCH,
    NOW,
    SHAPE_A,
    SHAPE_B,
    TOTAL_WORK,
    WORK,
)
from hapticmech_ros.contact.memory import ContactMemory
from hapticmech_ros.contact.step_kernels import (
    EACH,
    MORE_WORKSPACE,
    SEARCH,
    SEARCHED,
    WHOLE,
    advance_period,
)
from hapticmech_ros.contact.touching import Touching
from hapticmech_ros.mechanism.kernels.active_set import ActiveSet
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import (
    ExternalWrenches,
    Start,
    Stepped,
    check_external,
    plan_of,
)
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.mechanism.stepping import Stepper, Took, end_of, first_terms

if TYPE_CHECKING:
    from hapticmech_ros.contact.hull import Polytope
    from hapticmech_ros.contact.nearest import Nearest


class Touched(NamedTuple):
    """A period's outcome with contacts.

    Attributes:
        stepped: the state, work and losses without those of contacts.
        touching: the points of the last substep.
        energy: J, held by contacts at the end.
        work: J, of contacts on the mechanism.
    """

    stepped: Stepped
    touching: Touching
    energy: float
    work: float


class ContactStepper:
    """Steps a mechanism by one period, with contacts."""

    def __init__(self, mechanism: Mechanism) -> None:
        scene = mechanism.scene
        plan = plan_of(scene.simulation)
        self._mechanism = mechanism
        self._substeps = plan.substeps
        self._stepper = Stepper(mechanism, plan)
        self.memory = ContactMemory(mechanism)
        self._plan = np.array((0, len(SCHEMES[plan.integrator].weights), 0, 0, 0))
        self._nearest = self._searches(self.memory.polytopes)

    def advance(
        self, start: Start, external: ExternalWrenches, touching: Touching | None
    ) -> Touched:
        """Return the outcome of a period with external wrenches held.

        Args:
            start: where.
            external: from outside.
            touching: of the period before, whose forces the solver begins with.

        Raises:
            HapticMechError: as ``Simulator.step``.
        """
        check_external(external, len(self._mechanism.point_names), self._mechanism.nv)
        self.memory.begin_with(touching)
        self._push(external)
        active_set = self._mechanism.active_set(start.active)
        took = self._call(active_set, start, external, self._substeps, WHOLE)
        if took.code == 0 and took.stepped is not None:
            return self._touched(took.stepped, self._reported(TOTAL_WORK))
        now, left, work_in, lost, work = start, self._substeps, 0.0, 0.0, 0.0
        while True:
            if took.code == NOT_DECIDED and not took.steps:
                took = self._call(active_set.dense, now, external, 1, EACH)
            stepped, steps = took.stepped, took.steps
            if stepped is None:
                # Of the dense factorisation nothing is undecided: the step needs care.
                stepped, steps = self._careful(now, external), 1
                work += self._reported(WORK)
            work_in, lost = work_in + stepped.work_in, lost + stepped.energy_lost
            now, left = end_of(stepped, start), left - steps
            if not left:
                stepped = stepped._replace(work_in=work_in, energy_lost=lost)
                return self._touched(stepped, work + self._reported(TOTAL_WORK))
            took = self._call(active_set, now, external, left, EACH)

    def _push(self, external: ExternalWrenches) -> None:
        """Put wrenches on links behind those of contacts."""
        self._plan[4] = len(external.on_links)
        if external.on_links:
            rows, first = self._stepper.on_links(external), len(self.memory.links)
            self.memory.contacts.external[first : first + len(rows)] = rows

    def _call(
        self,
        active_set: ActiveSet,
        start: Start,
        external: ExternalWrenches,
        count: int,
        phase: int,
    ) -> Took:
        """Do substeps by the kernel until one needs care, or cannot be done sparse."""
        stepper, plan = self._stepper, self._plan
        known = stepper.load(start, active_set, external)
        plan[0], plan[2], plan[3] = count, known is not None, phase
        first, end = first_terms(known, active_set, count), np.empty(active_set.size)
        constants, scratch, work = active_set.constants, active_set.scratch, stepper.work
        while True:
            code = advance_period(*constants, first, end, scratch, work, *self.memory.arrays, plan)
            if code == SEARCH:
                self._search()
            elif code == MORE_WORKSPACE:
                self.memory.enlarge()
            else:
                return stepper.took(code, active_set, start.active, end)
            plan[0], plan[2], plan[3] = count - int(stepper.parts.account[5]), 1, SEARCHED

    def _search(self) -> None:
        """Find the nearest points of pairs that are near."""
        contacts = self.memory.contacts
        poses, found, margins = contacts.poses, contacts.found, contacts.margins.tolist()
        for pair, a, b, nearest in self._nearest:
            if margins[pair] >= 0.0:
                found[pair] = nearest.search(poses[a], poses[b])

    def _careful(self, start: Start, external: ExternalWrenches) -> Stepped:
        """Do the substep that the kernel stopped before, contacts held."""
        contacts = self.memory.contacts
        if not contacts.counts[NOW]:
            return self._stepper.careful_substep(start, external)
        on_links = dict(external.on_links)
        for link, row in zip(self.memory.links, contacts.external, strict=False):
            on_links[link] = on_links[link] + row[4:] if link in on_links else row[4:].copy()
        stepped = self._stepper.careful_substep(start, external._replace(on_links=on_links))
        return stepped._replace(work_in=stepped.work_in - self._reported(COUNTED))

    def _touched(self, stepped: Stepped, work: float) -> Touched:
        """Return a period's outcome with what is known of its last substep."""
        touching = self.memory.touching()
        return Touched(
            stepped, touching, self._reported(HELD) if touching.pairs.size else 0.0, work
        )

    def _reported(self, number: int) -> float:
        """Return a number of the report: of the arrays there are now, which a call may replace."""
        return float(self.memory.contacts.report[number])

    def _searches(
        self, polytopes: tuple[Polytope | None, ...]
    ) -> list[tuple[int, int, int, Nearest]]:
        """Return per pair whose nearest points are searched for its index, shapes, and search."""
        pairs, shapes = self.memory.contacts.pairs, self._mechanism.scene.shapes
        if not pairs[:, NEEDS_SEARCH].any():
            return []
        # Here, so that a scene with nothing but half-spaces needs no search.
        from hapticmech_ros.contact.nearest import Nearest

        found = []
        for pair in np.flatnonzero(pairs[:, NEEDS_SEARCH]).tolist():
            a, b = pairs[pair, SHAPE_A].item(), pairs[pair, SHAPE_B].item()
            search = Nearest(shapes[a], shapes[b], (polytopes[a], polytopes[b]))
            found.append((pair, a, b, search))
        return found
