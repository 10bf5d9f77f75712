# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism in time, in fixed steps, with closures switched and latched between them.

The mechanism at a time, and over a time; nothing here changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hapticmech_ros.errors import InaccurateStepError, InvalidInputError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing, Evaluation
from hapticmech_ros.mechanism.inertia import NO_MASS, SingularInertiaError, is_massless
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import (
    NOTHING,
    EarlierAccount,
    ExternalWrenches,
    Start,
    Stepped,
)
from hapticmech_ros.mechanism.projection import consistent_initial_state, project
from hapticmech_ros.mechanism.stepping import Stepper
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene import Scene
from hapticmech_ros.scene.mechanism import OperationalPoint

if TYPE_CHECKING:
    from hapticmech_ros.contact.memory import ContactMemory, Touching
    from hapticmech_ros.contact.stepping import ContactStepper, Touched


@dataclass(frozen=True, slots=True)
class EnergyAccount:
    """Energies since the start, J.

    Attributes:
        work_in: work by wrenches, and by efforts and further forces in joints.
        damping_loss: in damping, friction, dampers, and the part of stops that is no spring.
        latch_loss: when loops latched.
        contact_loss: in contacts, by friction, damping and impact.
        contact_energy: stored in contacts now, as in springs.
        surplus: energy that steps made from nothing, or lost if negative: errors of the
            integration.
        refined: number of steps that were done again in smaller ones, with care, or in parts for
            an impact.
        inaccurate: number of these whose account was still off by more than the scene's tolerance,
            or with which all steps had made more than 1e-3 of the energy exchanged from nothing,
            which was then taken out of the motion; or whose impact was too short to resolve: its
            rebound is off by more than 2 %. Also of steps, done again or not, whose contact forces
            were not found: rates violate the law by more than 1e-6 of the largest.
        moved: largest kinetic energy at a step's end.
        contact_most: largest ``contact_loss`` so far; contacts never give back what they have lost
            but for errors of the integration.
    """

    work_in: float = 0.0
    damping_loss: float = 0.0
    latch_loss: float = 0.0
    contact_loss: float = 0.0
    contact_energy: float = 0.0
    surplus: float = 0.0
    refined: int = 0
    inaccurate: int = 0
    moved: float = 0.0
    contact_most: float = 0.0

    @property
    def contact_made(self) -> float:
        """Energy that contacts lost and gave back: made from nothing, J."""
        return self.contact_most - self.contact_loss

    @property
    def lost(self) -> float:
        """Energy lost in total, J."""
        return self.damping_loss + self.latch_loss + abs(self.contact_loss)

    def drift(self, kinetic: float) -> float:
        """Return the account's errors over the sum of energy exchanged and largest kinetic energy.

        The errors are the surplus, and energy that contacts made from nothing. Every step may be
        within its tolerance, and the sum of many still be large.

        Args:
            kinetic: energy of the motion now, J.
        """
        exchanged = abs(self.work_in) + self.lost + max(kinetic, self.moved)
        off = abs(self.surplus) + self.contact_made
        return off / exchanged if exchanged > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class MechanismState:
    """Everything that evolves. Arrays are read-only; a step returns a new state.

    Attributes:
        time: s since the start.
        q, v: configuration (nq,) and rates (nv,), rad/s or m/s.
        active: per closure of the scene, whether it is closed.
        closure_error: largest residual of the active closures, m or rad.
        account: energy account.
        touching: points of contact in the step that led here; None before the first one, and in a
            scene without contacts.
        released: indices of closures that were opened and have not left their reach since.
    """

    time: float
    q: Array
    v: Array
    active: Active
    closure_error: float = 0.0
    account: EnergyAccount = EnergyAccount()
    touching: Touching | None = None
    released: frozenset[int] = frozenset()

    def __repr__(self) -> str:
        closed = f"{sum(self.active)} of {len(self.active)} closures closed"
        return f"MechanismState at {self.time:g} s: nq {self.q.size}, nv {self.v.size}, {closed}"


@dataclass(frozen=True, slots=True)
class Trajectory:
    """States of a run; k samples, the first one its start.

    Attributes:
        time: (k,) s since the simulation's start.
        q, v: configurations (k, nq) and rates (k, nv), rad/s or m/s.
        end: the state after the last step, whether it is a sample or not.
    """

    time: Array
    q: Array
    v: Array
    end: MechanismState


# Of the distance within which a closure latches: nearer than this it does not wait any longer.
AT_ONCE = 0.1


# A closure without latch_distance can be closed from this fraction of the mechanism's length.
CLOSE_BY_HAND = 0.02


class Simulator:
    """Steps a mechanism under wrenches at its operational points.

    Args:
        scene: to simulate.

    Raises:
        SceneError: a mesh that cannot be read.
        SingularInertiaError: a joint moves no mass.
    """

    def __init__(self, scene: Scene) -> None:
        try:
            self.mechanism = Mechanism(scene)
        except SingularInertiaError as error:
            if not is_massless(scene):
                raise
            raise SingularInertiaError(NO_MASS, error.rate) from None
        self.scene = scene = self.mechanism.scene
        self.period = scene.simulation.period
        self.stepper = Stepper(self.mechanism)
        self._contacts: ContactStepper | None = None
        if scene.contacts:
            # Imported here: a scene without contacts does not need it.
            from hapticmech_ros.contact.stepping import ContactStepper

            self._contacts = ContactStepper(self.mechanism)
        # Of each closure that latches by itself: within which distance.
        self._reaches = {
            index: loop.latch_distance
            for index, loop in enumerate(self.mechanism.closures)
            if loop.latch_distance
        }
        self._evaluated: tuple[MechanismState, Evaluation] | None = None
        self._projected: tuple[MechanismState, Closing] | None = None

    def __repr__(self) -> str:
        return f"Simulator of {self.scene.name}: steps of {self.period:g} s"

    def may_latch(self, state: MechanismState) -> bool:
        """Return whether a closure is open that may latch by itself."""
        return not all(state.active[index] for index in self._reaches)

    def latches(self, state: MechanismState) -> tuple[Array, Array, Array, Array]:
        """Return what a kernel needs to find whether a loop that is open is within reach.

        Args:
            state: of the mechanism.

        Returns:
            Constants of the mechanism with the loops that are open and may latch, (integers,) and
            (numbers,), room for its terms (size,), and the loops' reaches (loops,), m and rad; all
            empty without such loops.
        """
        loops = [index for index in self._reaches if not state.active[index]]
        if not loops:
            return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), np.zeros(0)
        found = self.mechanism.active_set(tuple(i in loops for i in range(len(state.active))))
        reaches = np.array([self._reaches[index] for index in loops])
        return (*found.constants, np.zeros(found.size), reaches)

    def contact_memory(self) -> ContactMemory | None:
        """Return the scene's contacts as arrays for kernels, made anew; None without contacts."""
        if self._contacts is None:
            return None
        # Imported here: a scene without contacts does not need it.
        from hapticmech_ros.contact.memory import ContactMemory

        return ContactMemory(self.mechanism)

    def initial_state(self) -> MechanismState:
        """Return the scene's initial state with its closures met.

        Raises:
            ClosureError: the scene cannot close.
        """
        q, v = consistent_initial_state(self.mechanism)
        active = self.mechanism.initially_active
        closing = self.mechanism.closing_terms(q, active)
        account = EnergyAccount()
        if self._contacts is not None:
            held = self._contacts.energy_at(Start(q, v, active, closing=closing))
            account = EnergyAccount(contact_energy=held)
        return MechanismState(0.0, _frozen(q), _frozen(v), active, closing.error, account)

    def set_operational_point(self, point: OperationalPoint) -> None:
        """Put an operational point elsewhere from now on; see that method of :class:`Mechanism`."""
        self.mechanism.set_operational_point(point)
        self.scene = self.mechanism.scene
        # Both are of the point's former place.
        self._evaluated = self._projected = None

    def evaluate(self, state: MechanismState) -> Evaluation:
        """Return every term of Eq. 1 at ``state``; asked twice for the same, it remembers."""
        if self._evaluated is None or self._evaluated[0] is not state:
            closing = self._closing(state)
            terms = self.mechanism.evaluate(state.q, state.v, state.active, closing)
            self._evaluated = state, terms
        return self._evaluated[1]

    def step(
        self,
        state: MechanismState,
        wrenches: Array,
        on_links: Mapping[str, Array] = NOTHING,
        joint_forces: Array | None = None,
    ) -> MechanismState:
        """Return the state one period later, with wrenches held.

        Args:
            state: where to start.
            wrenches: (points, 6) on the mechanism at each operational point, world axes, N and N m.
            on_links: further wrenches (6,) by name of the link, at its frame's origin, likewise.
            joint_forces: (nv,) further torques or forces in the joints, N m or N; none if None.

        Raises:
            ClosureError: a closed loop came apart, jumped, or turned to its other branch.
            InaccurateStepError: the step's energy account is off by a tenth of the energy
                exchanged, in as many substeps as ``simulation.accuracy`` allows.
            InvalidInputError: the state is no longer finite, an unknown link, or joint forces of
                another size or not finite.
        """
        external, touched = ExternalWrenches(wrenches, on_links, joint_forces), None
        try:
            if self._contacts is None:
                stepped = self.stepper.advance(self._start(state), external)
            else:
                touched = self._contacts.advance(self._start(state), external, state.touching)
                stepped = touched.stepped
        except InaccurateStepError as error:
            error.time += state.time
            raise
        return self.latch(self._ended(state, stepped, 1, touched))

    def run(
        self, state: MechanismState, steps: int, wrenches: Array | None = None, every: int = 1
    ) -> Trajectory:
        """Return the trajectory of many periods with wrenches held.

        The same states as from :meth:`step`, to rounding, without a call of Python for each.

        Args:
            state: where to start.
            steps: how many periods.
            wrenches: (points, 6) as in :meth:`step`; none if None.
            every: steps from one sample to the next.

        Raises:
            InvalidInputError: negative steps, ``every`` below 1; and as :meth:`step`.
            ClosureError: as :meth:`step`.
        """
        if steps < 0:
            raise InvalidInputError("steps", steps, "must be 0 or more")
        if every < 1:
            raise InvalidInputError("every", every, "must be 1 or more")
        held = np.zeros((len(self.mechanism.point_names), 6)) if wrenches is None else wrenches
        if self.may_latch(state) or self._contacts is not None:
            return self._run_watched(state, steps, held, every)
        return self._run_free(state, steps, held, every)

    def _run_free(
        self, state: MechanismState, steps: int, wrenches: Array, every: int
    ) -> Trajectory:
        """Run without closures that could latch between steps."""
        nq, count = self.mechanism.nq, steps // every
        samples = np.empty((count + 1, nq + self.mechanism.nv))
        samples[0] = np.concatenate((state.q, state.v))
        end = state
        if steps:
            try:
                stepped = self.stepper.run(
                    self._start(state), ExternalWrenches(wrenches), steps, samples[1:], every
                )
            except InaccurateStepError as error:
                error.time += state.time
                raise
            end = self._ended(state, stepped, steps)
        time = state.time + self.period * every * np.arange(count + 1)
        return Trajectory(time, samples[:, :nq], samples[:, nq:], end)

    def _run_watched(
        self, state: MechanismState, steps: int, wrenches: Array, every: int
    ) -> Trajectory:
        """Run step by step, to see loops that come near."""
        samples = [state]
        for taken in range(1, steps + 1):
            state = self.step(state, wrenches)
            if taken % every == 0:
                samples.append(state)
        return Trajectory(
            np.array([sample.time for sample in samples]),
            np.array([sample.q for sample in samples]),
            np.array([sample.v for sample in samples]),
            state,
        )

    def switch(self, state: MechanismState, closures: Mapping[str, bool]) -> MechanismState:
        """Return the state with loops opened or closed by name, at once; closing takes an impulse.

        Raises:
            InvalidInputError: unknown closure, or one whose frames are too far apart to close.
            ClosureError: the loops cannot be closed there.
        """
        active, released = list(state.active), set(state.released)
        for name, on in closures.items():
            index = self.mechanism.closure_index(name)
            if on and not active[index]:
                self._refuse_far(index, state.q)
            if active[index] and not on:
                released.add(index)
            active[index] = bool(on)
        return self._activated(replace(state, released=frozenset(released)), tuple(active))

    def _start(self, state: MechanismState) -> Start:
        """Return a state as the start of a step, with the terms known there."""
        known = self._evaluated
        terms = known[1] if known is not None and known[0] is state else None
        closing = self._closing(state) if terms is None else terms.closing
        a = state.account
        earlier = EarlierAccount(a.surplus, a.work_in, a.lost, a.moved)
        return Start(state.q, state.v, state.active, terms, closing, earlier)

    def _ended(
        self, state: MechanismState, stepped: Stepped, steps: int, touched: Touched | None = None
    ) -> MechanismState:
        """Return the state after some steps, and keep its terms.

        Args:
            state: before.
            stepped: result of the steps, without contacts' part in energies.
            steps: how many.
            touched: of a step with contacts.
        """
        q, v, error, closing, work_in, lost, surplus, refined, inaccurate, by_contacts, moved = (
            stepped
        )
        before, touching, in_contact, held = state.account, None, state.account.contact_loss, 0.0
        if touched is not None:
            touching, held = touched.touching, touched.energy
            in_contact += before.contact_energy - held - by_contacts
        account = EnergyAccount(
            before.work_in + work_in,
            before.damping_loss + lost,
            before.latch_loss,
            in_contact,
            held,
            before.surplus + surplus,
            before.refined + refined,
            before.inaccurate + inaccurate,
            max(before.moved, moved),
            max(before.contact_most, in_contact),
        )
        time = state.time + steps * self.period
        q, v, released = _frozen(q), _frozen(v), state.released
        ended = MechanismState(time, q, v, state.active, error, account, touching, released)
        self._projected = ended, closing
        return ended

    def closing(self, state: MechanismState) -> Closing:
        """Return the closures' terms at ``state``; asked twice for the same, it remembers."""
        known = self._closing(state)
        if known is None:
            known = self.mechanism.closing_terms(state.q, state.active)
            self._projected = state, known
        return known

    def _closing(self, state: MechanismState) -> Closing | None:
        """Return the closures' terms at ``state``, if they are known."""
        known = self._projected
        return known[1] if known is not None and known[0] is state else None

    def latch(self, state: MechanismState) -> MechanismState:
        """Return a state with those open loops closed that latch: frames in reach and nearest.

        One that was opened there is released: it does not latch again before it has left its reach.

        Raises:
            ClosureError: the loops cannot be closed there.
        """
        closed, still = list(state.active), set(state.released)
        for index, reach in self._reaches.items():
            if not closed[index]:
                distance, speed = self.mechanism.distance_of(index, state.q, state.v)
                if distance >= reach:
                    still.discard(index)
                elif index not in still and (speed >= 0.0 or distance < AT_ONCE * reach):
                    closed[index] = not self.mechanism.on_wrong_branch(index, state.q)
        if still != state.released:
            state = replace(state, released=frozenset(still))
        active = tuple(closed)
        return state if active == state.active else self._activated(state, active)

    def _activated(self, state: MechanismState, active: Active) -> MechanismState:
        before = sum(self.mechanism.energy(state.q, state.v))
        q, v, error, _ = project(self.mechanism, state.q, state.v, active)
        after = sum(self.mechanism.energy(q, v))
        account = replace(state.account, latch_loss=state.account.latch_loss + before - after)
        return replace(
            state, q=_frozen(q), v=_frozen(v), active=active, closure_error=error, account=account
        )

    def _refuse_far(self, index: int, q: Array) -> None:
        loop = self.mechanism.closures[index]
        limit = loop.latch_distance or CLOSE_BY_HAND * self.mechanism.length
        distance = self.mechanism.distance_of(index, q, np.zeros(self.mechanism.nv))[0]
        if distance > limit or self.mechanism.on_wrong_branch(index, q):
            rule = f"can be closed only within {limit:.4g} (m, rad) of its frames, axes alike"
            raise InvalidInputError(f"distance of closure {loop.name}", distance, rule)


def _frozen(array: Array) -> Array:
    array.flags.writeable = False
    return array
