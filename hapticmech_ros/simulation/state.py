# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mechanism at a time, and over a time; nothing here changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.closures import Active

if TYPE_CHECKING:
    from hapticmech_ros.contact.memory import Touching


@dataclass(frozen=True, slots=True)
class EnergyAccount:
    """Energies since the start, J.

    Attributes:
        work_in: work by wrenches, and by efforts and further forces in joints.
        damping_loss: in damping, friction, dampers, and the part of stops that is no spring.
        latch_loss: when loops latched.
        contact_loss: in contacts, by friction, damping and impact.
        contact_energy: held by contacts now, as by springs.
        surplus: what steps made from nothing, or lost if negative: errors of the integration.
        refined: number of steps that were done again in smaller ones, with care, or in parts for
            an impact.
        inaccurate: number of these whose account was still off by more than the scene's tolerance,
            or with which what all steps made from nothing was more than 1e-3 of what was exchanged:
            it was taken out of the motion then; or whose impact was over too soon, so that its
            rebound is off by more than 2 %. And of steps, done again or not, in which forces of
            contacts were not found: rates are off what the law says by more than 1e-6 of the
            largest.
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
        """Energy that contacts have given back of what they had lost: made from nothing, J."""
        return self.contact_most - self.contact_loss

    @property
    def lost(self) -> float:
        """Energy lost, whatever to, J."""
        return self.damping_loss + self.latch_loss + abs(self.contact_loss)

    def drift(self, kinetic: float) -> float:
        """Return the account's errors, as a share of what was exchanged and moved at most.

        That is the surplus, and what contacts made from nothing. Every step may be within its
        tolerance, and the sum of many still be a large part.

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
    """What a run went through; k samples, the first one its start.

    Attributes:
        time: (k,) s since the simulation's start.
        q, v: configurations (k, nq) and rates (k, nv), rad/s or m/s.
        end: the state after the last step, whether it is a sample or not.
    """

    time: Array
    q: Array
    v: Array
    end: MechanismState
