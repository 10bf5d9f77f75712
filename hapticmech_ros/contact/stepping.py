"""A step of a mechanism that touches things: forces at the points first, then the integrator's.

Forces are solved for at the step's start, implicit in the rates at its end, and held over the step
as wrenches on the links; see :mod:`~hapticmech_ros.contact.solver_kernels`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.contact.effect_kernels import contact_effects
from hapticmech_ros.contact.search import Search
from hapticmech_ros.contact.solver_kernels import (
    COUNTED,
    HELD,
    OFF,
    REPORT_VALUES,
    SWEEPS,
    WORK,
    contact_forces,
)
from hapticmech_ros.contact.touch_kernels import POINT_VALUES
from hapticmech_ros.contact.touching import Touching, nothing_touching
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import HeldMotion, Pushes, Start, Stepped, plan_of
from hapticmech_ros.mechanism.stepping import Stepper, end_of
from hapticmech_ros.scene.contacts import ContactPair

# Shapes further apart than this share of their size, and than they come in a step, are stepped as
# if there were no contacts.
FAR = 0.05
_NOBODY, _NOWHERE = np.zeros(0, dtype=np.int64), np.zeros((0, POINT_VALUES))


class Touched(NamedTuple):
    """A step's outcome with contacts.

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
        self._step = plan.period / plan.substeps
        self._pull = plan.baumgarte_rate
        # Positions move by the mean of both rates, or by the new one.
        self._ahead = 0.0 if plan.integrator == "semi_implicit_euler" else 0.5
        self._whole = Stepper(mechanism, plan)
        self._stepper = Stepper(mechanism, plan._replace(period=self._step, substeps=1))
        self._search = Search(mechanism)
        self._laws = np.array([_law(contact) for contact in scene.contacts])
        self._nothing = nothing_touching(mechanism.nv)
        links = {shape.name: shape.link for shape in scene.shapes}
        self._links = sorted({*links.values()} - {"world"})
        places = [mechanism.link_place(link) for link in self._links]
        self._carriers = np.array([joint for joint, _ in places])
        self._origins = np.array([placement.translation for _, placement in places])
        # 1 where a pair's force acts on a link, -1 where its reaction does.
        self._acts = np.zeros((len(self._links), len(scene.contacts)))
        for pair, contact in enumerate(scene.contacts):
            for shape, sign in ((contact.a, 1.0), (contact.b, -1.0)):
                if links[shape] != "world":
                    self._acts[self._links.index(links[shape]), pair] += sign

    def advance(self, start: Start, pushes: Pushes, touching: Touching | None) -> Touched:
        """Advance by one period with pushes held.

        Args:
            start: where.
            pushes: from outside.
            touching: of the step before, whose forces the solver begins with.
        """
        alone = self._untouched(start, pushes)
        if alone is not None:
            return alone
        known = self._nothing if touching is None else touching
        work_in = lost = work = 0.0
        for _ in range(self._substeps):
            stepped, known, energy, done = self._substep(start, pushes, known)
            work_in, lost, work = work_in + stepped.work_in, lost + stepped.energy_lost, work + done
            start = end_of(stepped, start)
        return Touched(stepped._replace(work_in=work_in, energy_lost=lost), known, energy, work)

    def _untouched(self, start: Start, pushes: Pushes) -> Touched | None:
        """Do a period as if there were no contacts; None if anything may come near in it."""
        search, period = self._search, self._step * self._substeps
        search.place(start.q)
        if search.near(start.v, period, FAR):
            return None
        stepped = self._whole.advance(start, pushes)
        # What pushes may have made it fast enough to come near after all.
        if search.near(stepped.v, period, FAR):
            return None
        return Touched(stepped, self._nothing, 0.0, 0.0)

    def _substep(self, start: Start, pushes: Pushes, before: Touching) -> Touched:
        """Do a step of the integrator, with what touches in it."""
        search, step = self._search, self._step
        search.place(start.q)
        motion = HeldMotion(self._mechanism, start, pushes, self._pull)
        free = start.v + step * motion(start.q, start.v).acceleration
        owners, points = search.points() if search.near(free, step) else (_NOBODY, _NOWHERE)
        if not owners.size:
            stepped = self._stepper.advance(start, pushes)
            return Touched(stepped, self._nothing, 0.0, 0.0)
        touching, report = self._forces(start, motion, free, owners, points, before)
        on_links = self._on_links(points, touching, pushes.on_links)
        stepped = self._stepper.advance(
            start._replace(terms=motion.first), pushes._replace(on_links=on_links)
        )
        stepped = stepped._replace(work_in=stepped.work_in - report[COUNTED])
        return Touched(stepped, touching, report[HELD], report[WORK])

    def _forces(
        self,
        start: Start,
        motion: HeldMotion,
        free: Array,
        owners: Array,
        points: Array,
        before: Touching,
    ) -> tuple[Touching, list[float]]:
        """Return what touches, with its forces, and the solver's report."""
        search, space = self._search, motion.first.space
        forces, report = _guesses(owners, points, before), np.zeros(REPORT_VALUES)
        contact_forces(
            points,
            owners,
            search.pairs,
            self._laws,
            search.poses,
            search.axes,
            search.moves,
            np.array(start.v),
            free,
            np.ascontiguousarray(space.factor),
            np.ascontiguousarray(space.basis.T),
            search.later_axes(start.q, 0.5 * self._step * (start.v + free)),
            self._step,
            self._ahead,
            forces,
            report,
            np.empty(3 * len(points) * (start.v.size + 6 * len(points))),
        )
        found = report.tolist()
        touching = Touching(
            owners,
            points[:, :3],
            points[:, 3:6],
            points[:, 6],
            forces,
            search.poses[search.pairs[owners, 0], 9:],
            np.empty(free.size),
            int(found[SWEEPS]),
            found[OFF],
        )
        return touching, found

    def _on_links(
        self, points: Array, touching: Touching, pushed: Mapping[str, Array]
    ) -> dict[str, Array]:
        """Return what pushes on links and what contacts do to them, at their frames' origins.

        Fills ``touching.joint_force``.
        """
        search = self._search
        wrenches = np.empty((len(self._links), 6))
        contact_effects(
            points,
            touching.forces,
            touching.pairs,
            search.pairs,
            search.axes,
            search.moves,
            self._acts,
            self._carriers,
            self._origins,
            search.joint_poses,
            touching.joint_force,
            wrenches,
        )
        on_links = dict(pushed)
        for link, wrench in zip(self._links, wrenches, strict=True):
            if wrench.any():
                on_links[link] = on_links[link] + wrench if link in on_links else wrench
        return on_links


def _law(contact: ContactPair) -> tuple[float, float, float, float]:
    """Return k, d, μ and χ of a pair, in the order that the solver has them."""
    return contact.stiffness, contact.damping, contact.friction, contact.dissipation


def _guesses(owners: Array, points: Array, before: Touching) -> Array:
    """Return (n, 3) the forces of the step before at the nearest points of the same pairs."""
    if owners.size == before.pairs.size and (owners == before.pairs).all():
        return before.forces.copy()
    forces = np.zeros((len(owners), 3))
    for index, pair in enumerate(owners):
        known = np.flatnonzero(before.pairs == pair)
        if known.size:
            away = before.points[known] - points[index, :3]
            forces[index] = before.forces[known[np.argmin((away * away).sum(axis=1))]]
    return forces
