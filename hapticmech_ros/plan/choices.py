# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Methods chosen for a scene where there are alternatives, and the reasons."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from hapticmech_ros.mechanism.elements import stiff_elements
from hapticmech_ros.mechanism.kernels.dense_kernels import APART
from hapticmech_ros.mechanism.kernels.many_rows import FEW_ROWS, SOME_ROWS
from hapticmech_ros.plan.running import Running


@dataclass(frozen=True, slots=True)
class Choice:
    """Choice of a method.

    Attributes:
        about: what is computed.
        taken: the chosen method.
        why: reason of the choice.
    """

    about: str
    taken: str
    why: str


def choices(run: Running) -> Iterator[Choice]:
    """Yield all choices; one that is added to the solver must be added here."""
    yield _integrator(run)
    yield _configuration(run)
    yield _path(run)
    yield _closure_rows(run)
    yield _stabilisation(run)


def _integrator(run: Running) -> Choice:
    taken = run.stepping.integrator
    if run.scene.simulation.integrator != "auto":
        return Choice("rule of a step", taken, "chosen by the scene")
    mechanism = run.mechanism
    stiff = next(stiff_elements(mechanism.scene, mechanism.tree, mechanism.elements.springs), None)
    return Choice(
        "rule of a step", taken, "nothing is too stiff for it" if stiff is None else str(stiff)
    )


def _configuration(run: Running) -> Choice:
    nq, nv = run.mechanism.nq, run.mechanism.nv
    if run.flat:
        return Choice("configuration", "a vector", f"nq = nv = {nv}: steps are added")
    why = f"nq = {nq}, nv = {nv}: a step is integrated on the manifold at every stage"
    return Choice("configuration", "on a manifold", why)


def _path(run: Running) -> Choice:
    mechanism = run.mechanism
    active_set, nv = mechanism.active_set(run.state.active), mechanism.nv
    if active_set.is_sparse:
        model = active_set.model
        shared = f", {model.border} shared by many closures" if model.border else ""
        why = f"{nv} rates{shared}, bandwidth {model.width}; dense where the rank is uncertain"
        return Choice("factorisation", "sparse, linear in size", why)
    if mechanism.needs_matrix:
        return Choice("factorisation", "dense", "the integrator needs D as a matrix")
    why = f"few rates ({nv}) and rows ({active_set.m}), or redundant rows"
    return Choice("factorisation", "dense", why)


def _closure_rows(run: Running) -> Choice:
    m = run.rows.rows
    active_set = run.mechanism.active_set(run.state.active)
    if active_set.is_sparse and m:
        kind = "bordered banded QR" if active_set.model.border else "banded QR"
        return Choice("closure factorisation", kind, "see factorisation")
    if m == 0:
        return Choice("closure factorisation", "none", "no closure is active")
    if m < SOME_ROWS:
        return Choice("closure factorisation", "SVD", f"{m} rows, fewer than {SOME_ROWS}")
    where = f"the smallest σ is below {APART:g}" if m <= FEW_ROWS else "the rank is uncertain"
    return Choice("closure factorisation", "pivoted QR", f"{m} rows; SVD where {where}")


def _stabilisation(run: Running) -> Choice:
    if run.rows.rows == 0 and not run.can_latch:
        return Choice("stabilisation", "none", "no closure is active or can latch")
    rate = run.stepping.baumgarte_rate
    if rate > 0.0:
        return Choice("stabilisation", "baumgarte", f"chosen by the scene, rate {rate:g} /s")
    return Choice("stabilisation", "projection", "after every substep, in the mass metric")
