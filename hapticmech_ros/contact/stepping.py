# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Periods of a mechanism with contacts, by a kernel that returns for parts that Python does.

These are the search for nearest points of two bounded shapes, singular steps, and those that have
to be divided to resolve an impact.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hapticmech_ros.contact.impact_kernels import MOST_PARTS, TOO_MANY_PARTS
from hapticmech_ros.contact.layout import (
    ITS_BRANCH,
    ITS_END,
    NEEDS_SEARCH,
    NOTHING,
    SHAPE_A,
    SHAPE_B,
)
from hapticmech_ros.contact.memory import ContactMemory, Touching
from hapticmech_ros.contact.step_kernels import (
    EACH,
    IMPACT,
    MORE_WORKSPACE,
    SEARCH,
    SEARCHED,
    WHOLE,
    advance_period,
)
from hapticmech_ros.mechanism.branches import BranchMotion
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED
from hapticmech_ros.mechanism.kernels.layout import ActiveSet
from hapticmech_ros.mechanism.kernels.model import RunPlan
from hapticmech_ros.mechanism.kernels.run_kernels import SINGULAR_STEP
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import (
    ExternalWrenches,
    Start,
    Stepped,
    Took,
    check_external,
    end_of,
)
from hapticmech_ros.mechanism.stepping import Stepper

if TYPE_CHECKING:
    from hapticmech_ros.contact.hull import Polytope
    from hapticmech_ros.contact.nearest import Nearest


class Touched(NamedTuple):
    """A period's outcome with contacts.

    Attributes:
        stepped: the state, work and losses without those of contacts.
        touching: the points of the last substep.
        energy: J, held by contacts at the end.
    """

    stepped: Stepped
    touching: Touching
    energy: float


class ContactStepper:
    """Steps a mechanism by one period, with contacts."""

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self._substeps = mechanism.scene.simulation.substeps
        self._stepper = Stepper(mechanism)
        self.memory = ContactMemory(mechanism)
        self._plan = RunPlan()
        self._plan.stages, self._plan.implicit = self._stepper.stages, self._stepper.implicit
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
            return self._touched(took.stepped)
        return self._touched(self._ended(took, start, external, self._substeps))

    def _ended(self, took: Took, start: Start, external: ExternalWrenches, total: int) -> Stepped:
        """Do the rest of so many steps after a call of the kernel from their start."""
        active_set = self._mechanism.active_set(start.active)
        now, left, ended = start, total, None
        while True:
            if took.code == NOT_DECIDED and not took.steps:
                took = self._call(active_set.dense, now, external, 1, EACH)
            stepped, steps = took.stepped, took.steps
            if stepped is None:
                # The dense factorisation always decides: the step is singular.
                stepped, steps = self._alone(took.code, now, external), 1
            ended = stepped if ended is None else stepped.after(ended)
            now, left = end_of(stepped, now), left - steps
            if not left:
                return ended
            took = self._call(active_set, now, external, left, EACH)

    def energy_at(self, start: Start) -> float:
        """Return the energy stored in contacts at a state, J.

        Args:
            start: where.

        Raises:
            HapticMechError: as ``Simulator.step``.
        """
        self.memory.begin_with(None)
        nothing = ExternalWrenches(np.zeros((len(self._mechanism.point_names), 6)))
        self._push(nothing)
        # The step itself is not used.
        self._call(self._mechanism.active_set(start.active), start, nothing, 1, EACH)
        contacts = self.memory.contacts
        return float(contacts.report.energy_before) if contacts.counts.points else 0.0

    def _push(self, external: ExternalWrenches) -> None:
        """Put wrenches on links behind those of contacts."""
        self._plan.external_wrenches = len(external.on_links)
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
        """Do substeps by the kernel until one is singular, or cannot be done sparse."""
        stepper, plan = self._stepper, self._plan
        known = stepper.load(start, active_set, external)
        plan.steps, plan.terms_known, plan.begins_with = count, known is not None, phase
        first, end = active_set.first_terms(known, count), np.empty(active_set.size)
        given = *active_set.constants, first, end, active_set.scratch, stepper.work
        while True:
            code = advance_period(*given, *self.memory.arrays, plan.values)
            if code == SEARCH:
                self._search()
            elif code == MORE_WORKSPACE:
                self.memory.enlarge()
            else:
                return stepper.took(code, active_set, start.active, end)
            plan.steps = count - int(stepper.parts.account.steps_done)
            plan.terms_known, plan.begins_with = 1, SEARCHED

    def _search(self) -> None:
        """Find the nearest points of pairs that are near."""
        contacts = self.memory.contacts
        poses, found, margins = contacts.poses, contacts.found, contacts.margins.tolist()
        for pair, a, b, nearest in self._nearest:
            if margins[pair] >= 0.0:
                found[pair] = nearest.search(poses[a], poses[b])

    def _alone(self, code: int, start: Start, external: ExternalWrenches) -> Stepped:
        """Do the substep that the kernel stopped before."""
        if code == IMPACT:
            return self._divided(start, external)
        if code == SINGULAR_STEP:
            return self._on_branch(start, external)
        if not self.memory.contacts.counts.points:
            return self._stepper.alone(code, start, external)
        return self._pushed(code, start, external)

    def _on_branch(self, start: Start, external: ExternalWrenches) -> Stepped:
        """Do a substep next to a crossing of branches, where closures fix no free directions.

        The kernel finds contact forces from the substep without contacts and the branch's
        projector.
        """
        stepper, contacts = self._stepper, self.memory.contacts
        free = stepper.alone(SINGULAR_STEP, start, external)
        motion = BranchMotion(self._mechanism, start, external, stepper.step)
        branch = motion.projection(start.q)
        contacts.free[:], contacts.q[:], contacts.stiff[:] = free.v, free.q, 0.0
        # Positions move by the mean of both rates here, with any rule of the scene.
        ahead = float(contacts.settings.ahead)
        contacts.settings.ahead, contacts.settings.known = 0.5, ITS_END
        if branch is not None:
            contacts.branch[:] = branch
            contacts.settings.known = ITS_BRANCH
        try:
            dense = self._mechanism.active_set(start.active).dense
            took = self._call(dense, start, external, 1, EACH)
        finally:
            contacts = self.memory.contacts
            contacts.settings.ahead, contacts.settings.known = ahead, NOTHING
        if took.code == IMPACT:
            return self._divided(start, external)
        if not self.memory.contacts.counts.points:
            return free
        return self._pushed(SINGULAR_STEP, start, external)

    def _pushed(self, code: int, start: Start, external: ExternalWrenches) -> Stepped:
        """Do a substep with the forces of contacts held that the kernel found."""
        contacts = self.memory.contacts
        rows = zip(self.memory.links, contacts.external, strict=False)
        touching = {link: row[4:].copy() for link, row in rows}
        stepped = self._stepper.alone(code, start, external._replace(touching=touching))
        share = self._stepper.step / contacts.settings.period
        contacts.joint_force += share * contacts.step_force
        contacts.counts.unsolved += int(contacts.report.failed)
        return stepped

    def _divided(self, start: Start, external: ExternalWrenches) -> Stepped:
        """Do a substep in the parts that an impact needs; inaccurate where these are too many."""
        counts = self.memory.contacts.counts
        wanted, unsolved = int(counts.parts), int(counts.unsolved)
        counts.parts = min(wanted, MOST_PARTS)
        stepped = self._in_parts(start, external, min(wanted, MOST_PARTS))
        # It is one step, however many of its parts were not solved.
        counts = self.memory.contacts.counts
        counts.unsolved = min(counts.unsolved, unsolved + (wanted <= TOO_MANY_PARTS))
        return stepped._replace(
            refined=stepped.refined + 1,
            inaccurate=stepped.inaccurate + (wanted > TOO_MANY_PARTS),
        )

    def _in_parts(self, start: Start, external: ExternalWrenches, count: int) -> Stepped:
        """Do a substep in so many smaller ones, in which contacts are found anew."""
        settings, active_set = (
            self.memory.contacts.settings,
            self._mechanism.active_set(start.active),
        )
        settings.is_part = 1.0
        try:
            with self._stepper.divided(count):
                took = self._call(active_set, start, external, count, EACH)
                return self._ended(took, start, external, count)
        finally:
            self.memory.contacts.settings.is_part = 0.0

    def _touched(self, stepped: Stepped) -> Touched:
        """Return a period's outcome with the contacts of its last substep."""
        touching, unsolved = self.memory.touching(), int(self.memory.contacts.counts.unsolved)
        stepped = stepped._replace(inaccurate=stepped.inaccurate + unsolved)
        # Read from the present arrays, which a call may replace.
        held = float(self.memory.contacts.report.energy) if touching.pairs.size else 0.0
        return Touched(stepped, touching, held)

    def _searches(
        self, polytopes: tuple[Polytope | None, ...]
    ) -> list[tuple[int, int, int, Nearest]]:
        """Return per pair whose nearest points are searched for its index, shapes, and search."""
        pairs, shapes = self.memory.contacts.pairs, self._mechanism.scene.shapes
        if not pairs[:, NEEDS_SEARCH].any():
            return []
        # Imported here: a scene with only half-spaces needs no search.
        from hapticmech_ros.contact.nearest import Nearest

        found = []
        for pair in np.flatnonzero(pairs[:, NEEDS_SEARCH]).tolist():
            a, b = pairs[pair, SHAPE_A].item(), pairs[pair, SHAPE_B].item()
            search = Nearest(shapes[a], shapes[b], (polytopes[a], polytopes[b]))
            found.append((pair, a, b, search))
        return found
