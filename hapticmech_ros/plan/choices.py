"""Which of several ways to compute a thing is taken for a scene, and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from hapticmech_ros.mechanism.kernels.many_rows import FEW_ROWS
from hapticmech_ros.plan.running import Running


@dataclass(frozen=True, slots=True)
class Choice:
    """One way out of several.

    Attributes:
        about: what is computed.
        taken: the way that is taken.
        why: the fact that decides.
    """

    about: str
    taken: str
    why: str


def choices(run: Running) -> Iterator[Choice]:
    """Yield every choice. One that is added to the solver gets its line here."""
    yield _configuration(run)
    yield _path(run)
    yield _closure_rows(run)
    yield _stabilisation(run)


def _configuration(run: Running) -> Choice:
    nq, nv = run.mechanism.nq, run.mechanism.nv
    if run.flat:
        return Choice("configuration", "a vector", f"nq = nv = {nv}: a step adds to it")
    why = f"nq = {nq}, nv = {nv}: a step is integrated on the manifold at every stage"
    return Choice("configuration", "on a manifold", why)


def _path(run: Running) -> Choice:
    mechanism = run.mechanism
    active_set, nv = mechanism.active_set(run.state.active), mechanism.nv
    if active_set.is_sparse:
        why = (
            f"{nv} rates, and a band of {active_set.model.width} places: dense where it is in doubt"
        )
        return Choice("path", "sparse, linear in size", why)
    if mechanism.needs_matrix:
        return Choice("path", "dense", "the integrator needs D as a matrix")
    return Choice("path", "dense", f"{nv} rates and {active_set.m} rows are few, or some redundant")


def _closure_rows(run: Running) -> Choice:
    m = run.rows.rows
    if run.mechanism.active_set(run.state.active).is_sparse and m:
        return Choice("rows factored by", "QR inside a band", "see path")
    if m == 0:
        return Choice("rows factored by", "nothing", "no closure is active")
    if m <= FEW_ROWS:
        return Choice("rows factored by", "SVD", f"{m} rows, up to {FEW_ROWS} are few")
    why = f"{m} rows, more than {FEW_ROWS}; SVD where the rank is in doubt"
    return Choice("rows factored by", "pivoted QR", why)


def _stabilisation(run: Running) -> Choice:
    if run.rows.rows == 0 and not run.can_latch:
        return Choice("stabilisation", "none", "no closure is active, and none latches")
    rate = run.stepping.baumgarte_rate
    if rate > 0.0:
        return Choice("stabilisation", "baumgarte", f"the scene says so, at {rate:g} /s")
    return Choice("stabilisation", "projection", "after every substep, in the mass metric")
