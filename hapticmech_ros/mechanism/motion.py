# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Inputs and results of a mechanism's step; rates of a state by Eq. 1."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing, Evaluation
from hapticmech_ros.mechanism.kernels.layout import ActiveSet
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.numerics import Array

NOTHING: Mapping[str, Array] = MappingProxyType({})


class EarlierAccount(NamedTuple):
    """The energy account at a step's start, J, as far as its drift goes.

    Attributes:
        surplus: made from nothing so far.
        work_in: work done.
        lost: energy lost, contacts and latches included.
        moved: largest kinetic energy at the end of a step.
    """

    surplus: float = 0.0
    work_in: float = 0.0
    lost: float = 0.0
    moved: float = 0.0


class Start(NamedTuple):
    """The start of a step: a state on the closures, and the terms known there already.

    Attributes:
        q: (nq,) configuration.
        v: (nv,) rates, rad/s or m/s.
        active: per closure, whether it is closed.
        terms: of Eq. 1 there, if known.
        closing: the closures' terms there, if known; those of ``terms`` where these are.
        earlier: by the account so far.
    """

    q: Array
    v: Array
    active: Active
    terms: Evaluation | None = None
    closing: Closing | None = None
    earlier: EarlierAccount = EarlierAccount()

    def packed(self, active_set: ActiveSet) -> Array | None:
        """Return the packed terms (size,) if they are known, and of this kind."""
        known = self.closing
        return known.packed if known is not None and known.active_set is active_set else None


class ExternalWrenches(NamedTuple):
    """Wrenches and forces from outside, held during a step.

    Attributes:
        wrenches: (points, 6) at the operational points, world axes, N and N m.
        on_links: further wrenches (6,) by name of the link, at its frame's origin, likewise.
        in_joints: (nv,) further joint forces, N m or N; None for none.
        touching: wrenches on links as ``on_links``, those of contacts.
    """

    wrenches: Array
    on_links: Mapping[str, Array] = NOTHING
    in_joints: Array | None = None
    touching: Mapping[str, Array] = NOTHING


class Stepped(NamedTuple):
    """A step's outcome.

    Attributes:
        q, v: the state (nq,), (nv,), arrays of its own.
        error: largest residual of the active closures, m or rad.
        closing: terms at q.
        work_in: work by wrenches and joint forces, without that of contacts, J.
        energy_lost: in damping, friction and stops, J.
        surplus: energy beyond that account, J: made from nothing by steps, or lost if negative.
        refined: steps that were done again in smaller ones, with care, or in parts for an impact.
        inaccurate: of these the ones whose account is still off by more than the tolerance, or
            whose impact would need more parts.
        contact_work: work by contacts, J.
        moved: largest kinetic energy at the end of a step that was watched, J.
    """

    q: Array
    v: Array
    error: float
    closing: Closing
    work_in: float
    energy_lost: float
    surplus: float = 0.0
    refined: int = 0
    inaccurate: int = 0
    contact_work: float = 0.0
    moved: float = 0.0

    def after(self, before: Stepped) -> Stepped:
        """Return this with the accounts of the steps before it added."""
        return self._replace(
            work_in=before.work_in + self.work_in,
            energy_lost=before.energy_lost + self.energy_lost,
            surplus=before.surplus + self.surplus,
            refined=before.refined + self.refined,
            inaccurate=before.inaccurate + self.inaccurate,
            contact_work=before.contact_work + self.contact_work,
            moved=max(before.moved, self.moved),
        )


class Took(NamedTuple):
    """A kernel call's result: why it ended, the number of steps, and their end, if any."""

    code: int
    steps: int
    stepped: Stepped | None


def end_of(stepped: Stepped, start: Start) -> Start:
    """Return where a step from ``start`` ended as where the next one begins."""
    before = start.earlier
    earlier = EarlierAccount(
        before.surplus + stepped.surplus,
        before.work_in + stepped.work_in,
        before.lost + stepped.energy_lost,
        max(before.moved, stepped.moved),
    )
    return Start(stepped.q, stepped.v, start.active, closing=stepped.closing, earlier=earlier)


class Rates(NamedTuple):
    """Solution of the equations of motion at a state: v̇ (nv,), rad/s² or m/s²; three powers, W."""

    acceleration: Array
    power_in: float
    power_lost: float
    contact_power: float = 0.0


def rates_at(mechanism: Mechanism, state: Start, external: ExternalWrenches) -> Rates:
    """Return the solution of the equations of motion at a state under external wrenches.

    Args:
        mechanism: that moves.
        state: where.
        external: that act.

    Raises:
        InvalidInputError: v is not finite.
    """
    q, v, active, terms, closing, _ = state
    if not math.isfinite(v @ v):
        raise not_finite("rates", v)
    terms = terms or mechanism.evaluate(q, v, active, closing)
    wrenches, on_links, in_joints, touching = external
    force = np.zeros(v.size) if in_joints is None else in_joints.copy()
    touch = np.zeros(v.size)
    for point, wrench in zip(terms.points, wrenches, strict=True):
        force += wrench @ point.jacobian
    for joint_force, on_these in ((force, on_links), (touch, touching)):
        for link, wrench in on_these.items():
            joint_force[:] += wrench @ mechanism.link_jacobian(q, link)
    power_in = float((force + terms.effort) @ v)
    power_lost = -float(terms.dissipative_force @ v)
    acceleration, _ = terms.acceleration(force + touch)
    return Rates(acceleration, power_in, power_lost, float(touch @ v))


def check_external(external: ExternalWrenches, points: int, nv: int) -> None:
    """Check the wrenches on a mechanism with so many operational points and degrees of freedom.

    Raises:
        InvalidInputError: a wrong shape, or joint forces that are NaN or infinite.
    """
    if external.wrenches.shape != (points, 6):
        raise InvalidInputError("wrenches", external.wrenches.shape, f"must have shape {points, 6}")
    forces = external.in_joints
    if forces is not None and (np.shape(forces) != (nv,) or not np.isfinite(forces).all()):
        raise InvalidInputError("joint_forces", forces, f"must be {nv} finite numbers")


def not_finite(what: str, values: Array) -> InvalidInputError:
    """Return the error of ``mechanism <what>`` that is NaN or infinite.

    Args:
        what: its name.
        values: (n,).
    """
    return InvalidInputError(f"mechanism {what}", values.tolist(), "must stay finite")
