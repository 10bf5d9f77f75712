"""A step of a mechanism that touches things: forces at the points first, then the integrator's.

Forces are solved for at the step's start, implicit in the rates at its end, and held over the step
as wrenches on the links; see :mod:`~hapticmech_ros.contact.solver_kernels`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hapticmech_ros.contact.search import Search
from hapticmech_ros.contact.solver_kernels import (
    CHANGE,
    COUNTED,
    HELD,
    REPORT_VALUES,
    SWEEPS,
    WORK,
    contact_forces,
)
from hapticmech_ros.contact.touching import Touching, nothing_touching
from hapticmech_ros.mechanism.build import build_stepper, plan_of
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.motion import HeldMotion, Pushes, Start
from hapticmech_ros.mechanism.stepping import Stepped, end_of


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
        self._stepper = build_stepper(mechanism, plan._replace(period=self._step, substeps=1))
        self._search = Search(mechanism)
        laws = [(c.stiffness, c.damping, c.friction) for c in scene.contacts]
        self._laws = np.array(laws, dtype=float)
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
        known = nothing_touching(self._mechanism.nv) if touching is None else touching
        work_in = lost = work = 0.0
        for _ in range(self._substeps):
            stepped, known, energy, done = self._substep(start, pushes, known)
            work_in, lost, work = work_in + stepped.work_in, lost + stepped.energy_lost, work + done
            start = end_of(stepped, start)
        return Touched(stepped._replace(work_in=work_in, energy_lost=lost), known, energy, work)

    def _substep(self, start: Start, pushes: Pushes, before: Touching) -> Touched:
        mechanism, search = self._mechanism, self._search
        motion = HeldMotion(mechanism, start, pushes, self._pull)
        free = start.v + self._step * motion(start.q, start.v).acceleration
        owners, points = search.points(start.q, free, self._step)
        if not owners.size:
            stepped = self._stepper.advance(start, pushes)
            return Touched(stepped, nothing_touching(mechanism.nv), 0.0, 0.0)
        forces, report = _guesses(owners, points, before), np.zeros(REPORT_VALUES)
        space = motion.first.space
        joints, centres = search.joints[owners], search.centres(owners)
        contact_forces(
            points,
            joints,
            self._laws[owners],
            search.axes,
            search.moves,
            start.v.copy(),
            free,
            np.ascontiguousarray(space.factor),
            np.ascontiguousarray(space.basis.T),
            search.later_axes(start.q, 0.5 * self._step * (start.v + free)),
            centres,
            self._step,
            self._ahead,
            forces,
            report,
        )
        about_world = np.concatenate((forces, _cross(points[:, :3], forces)), axis=1)
        on_links = self._on_links(owners, about_world, pushes.on_links)
        stepped = self._stepper.advance(
            start._replace(terms=motion.first), pushes._replace(on_links=on_links)
        )
        counted, work = float(report[COUNTED]), float(report[WORK])
        touching = Touching(
            owners,
            points[:, :3],
            points[:, 3:6],
            points[:, 6],
            forces,
            centres[:, 0],
            _joint_force(about_world, joints, search.axes, search.moves),
            int(report[SWEEPS]),
            float(report[CHANGE]),
        )
        stepped = stepped._replace(work_in=stepped.work_in - counted)
        return Touched(stepped, touching, float(report[HELD]), work)

    def _on_links(
        self, owners: Array, about_world: Array, pushed: Mapping[str, Array]
    ) -> dict[str, Array]:
        """Return what pushes on links and what contacts do to them, at their frames' origins."""
        acts = self._acts[:, owners]
        wrenches = acts @ about_world
        poses = self._search.joint_poses[self._carriers]
        axes = poses[:, :9].reshape(-1, 3, 3)
        origins = poses[:, 9:] + (self._origins[:, :, None] * axes).sum(axis=1)
        wrenches[:, 3:] -= _cross(origins, wrenches[:, :3])
        on_links = dict(pushed)
        for index in np.flatnonzero(acts.any(axis=1)).tolist():
            link, wrench = self._links[index], wrenches[index]
            on_links[link] = on_links[link] + wrench if link in on_links else wrench
        return on_links


def _guesses(owners: Array, points: Array, before: Touching) -> Array:
    """Return (n, 3) the forces of the step before at the nearest points of the same pairs."""
    forces = np.zeros((len(owners), 3))
    if np.array_equal(owners, before.pairs):
        forces[:] = before.forces
        return forces
    for index, pair in enumerate(owners):
        known = np.flatnonzero(before.pairs == pair)
        if known.size:
            away = before.points[known] - points[index, :3]
            forces[index] = before.forces[known[np.argmin((away * away).sum(axis=1))]]
    return forces


def _joint_force(about_world: Array, joints: Array, axes: Array, moves: Array) -> Array:
    """Return (nv,) Σ J_cᵀ λ of forces (n, 6) with their moments about the world's origin."""
    along = about_world @ axes.T
    return np.asarray((along * (moves[joints[:, 0]] - moves[joints[:, 1]])).sum(axis=0))


def _cross(a: Array, b: Array) -> Array:
    """Return a × b of rows (n, 3); NumPy's own takes its time over what they are."""
    out = np.empty(a.shape)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i] = a[:, j] * b[:, k] - a[:, k] * b[:, j]
    return out
