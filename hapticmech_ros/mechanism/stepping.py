"""Steps of a mechanism, one or many, in a call of one kernel: integrated, then projected.

Where branches of the motion cross, or nearly do, the kernel stops, and the step is done with care.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple, cast

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.careful import careful_step
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing, factored, failure
from hapticmech_ros.mechanism.inertia import diverged
from hapticmech_ros.mechanism.kernels.active_set import ActiveSet
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED
from hapticmech_ros.mechanism.kernels.data import ERROR
from hapticmech_ros.mechanism.kernels.factor_kernels import NOT_FINITE
from hapticmech_ros.mechanism.kernels.implicit_kernels import springs_size
from hapticmech_ros.mechanism.kernels.run_kernels import (
    EVERYTHING,
    NEEDS_CARE,
    RATES_NOT_FINITE,
    UNCHECKED,
    advance,
)
from hapticmech_ros.mechanism.kernels.settle_kernels import FLIPPED, JUMPED, OPEN, SETTLED
from hapticmech_ros.mechanism.kernels.step_kernels import PARTS, Work, work_size
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import (
    ExternalWrenches,
    Plan,
    Start,
    Stepped,
    check_external,
    not_finite,
)
from hapticmech_ros.mechanism.projection import came_apart, flipped, jumped
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.mechanism.tolerances import (
    BAUMGARTE_FAILURE,
    PROJECTION_FAILURE,
    PROJECTION_TOLERANCE,
    ROUNDING_TOLERANCE,
)

_NO_SAMPLES = np.zeros((0, 0))
_NO_PUSHES = np.zeros((0, 10))


class Took(NamedTuple):
    """What a call of the kernel did: why it ended, how many steps, and their end if there are."""

    code: int
    steps: int
    stepped: Stepped | None


class Stepper:
    """Steps a mechanism by periods.

    Args:
        mechanism: to step.
        plan: how.

    Attributes:
        work: see ``step_kernels.Work``.
        parts: views of the work's parts.
        springs: of implicit rules; see ``implicit_kernels.Springs``.
        stages: of the rule.
        implicit: 1 for an implicit rule.
        heeded: what of singular positions ends a run; see ``run_kernels``.
    """

    def __init__(self, mechanism: Mechanism, plan: Plan) -> None:
        self._mechanism = mechanism
        self._plan = plan
        self._step = plan.period / plan.substeps
        nq, nv, points = mechanism.nq, mechanism.nv, len(mechanism.point_names)
        scheme = SCHEMES[plan.integrator]
        self.springs = np.zeros(springs_size(nv) if scheme.implicit else 0)
        self.work = np.zeros(work_size(nq, nv, points))
        numbers = mechanism.active_set(mechanism.initially_active).constants[0]
        work = Work(numbers, self.work)
        # Found once: each look at the work makes a view.
        self.parts = parts = SimpleNamespace(**{name: getattr(work, name) for name in PARTS})
        self._counts = np.array((1, 0, len(scheme.weights), scheme.implicit, 0))
        self._pulled = pulled = plan.baumgarte_rate > 0.0
        most_open = BAUMGARTE_FAILURE if pulled else PROJECTION_FAILURE
        fractions = (PROJECTION_TOLERANCE, ROUNDING_TOLERANCE, PROJECTION_FAILURE)
        parts.settings[:2] = self._step, scheme.late
        parts.settings[2:5] = np.array(fractions) * mechanism.length
        parts.settings[5:7] = plan.baumgarte_rate, most_open * mechanism.length
        parts.settings[7] = scheme.corrected and nq != nv
        parts.scheme[: len(scheme.weights), 0] = scheme.weights
        parts.scheme[: len(scheme.fractions), 1] = scheme.fractions
        self.stages, self.implicit = len(scheme.weights), int(scheme.implicit)
        self.heeded = UNCHECKED if pulled else EVERYTHING

    def advance(self, start: Start, external: ExternalWrenches) -> Stepped:
        """Return the state after a period with wrenches held; see ``Simulator.step``."""
        return self.run(start, external, 1, _NO_SAMPLES, 0)

    def run(
        self, start: Start, external: ExternalWrenches, periods: int, samples: Array, every: int
    ) -> Stepped:
        """Advance by many periods with wrenches held, and fill samples; see ``Simulator.run``.

        Args:
            start: where.
            external: from outside.
            periods: how many, at least one.
            samples: (periods // every, nq + nv) to fill with q and v; (0, 0) if ``every`` is 0.
            every: periods from one sample to the next; 0 for none.

        Returns:
            The end, with work and loss of all steps.

        Raises:
            InvalidInputError: wrenches of another shape, or a state that is not finite.
            ClosureError: a closed loop came apart, jumped, or turned to its other branch.
        """
        check_external(external, len(self._mechanism.point_names), self._mechanism.nv)
        total, apart = periods * self._plan.substeps, every * self._plan.substeps
        now, done, work_in, lost = start, 0, 0.0, 0.0
        while True:
            # After a step that was done alone there may be some before the next sample.
            since = done % apart if apart else 0
            count = min(total - done, apart - since) if since else total - done
            rows = samples[done // apart :] if apart and not since else _NO_SAMPLES
            active_set = self._mechanism.active_set(now.active)
            code, steps, stepped = self._call(active_set, now, external, count, rows, apart)
            if stepped is not None:
                if steps == total:
                    return stepped
                work_in, lost = work_in + stepped.work_in, lost + stepped.energy_lost
                now = end_of(stepped, start)
            if steps < count:
                stepped = self._alone(code, now, external)
                work_in, lost = work_in + stepped.work_in, lost + stepped.energy_lost
                now = end_of(stepped, start)
                steps, since = steps + 1, 1
            done += steps
            if apart and since and done % apart == 0:
                samples[done // apart - 1] = np.concatenate((now.q, now.v))
            if done == total and stepped is not None:
                return stepped._replace(work_in=work_in, energy_lost=lost)

    def _alone(self, code: int, start: Start, external: ExternalWrenches) -> Stepped:
        """Do the step that the kernel stopped before."""
        if code == NOT_DECIDED:
            dense = self._mechanism.active_set(start.active).dense
            took = self._call(dense, start, external, 1, _NO_SAMPLES, 0)
            if took.stepped is not None:
                return took.stepped
        return self.careful_substep(start, external)

    def careful_substep(self, start: Start, external: ExternalWrenches) -> Stepped:
        """Return the state after a step: with care, as where branches of the motion cross."""
        if not self._pulled:
            known = start.closing if start.terms is None else start.terms.closing
            led = careful_step(self._mechanism, start._replace(closing=known), external, self._step)
            if led is not None:
                return led
        return self._substep(start, external)

    def _substep(self, start: Start, external: ExternalWrenches) -> Stepped:
        """Do a step whatever it starts at, leaves, or passes."""
        active_set = self._mechanism.active_set(start.active)
        took = self._call(active_set, start, external, 1, _NO_SAMPLES, 0, UNCHECKED)
        if took.code == NOT_DECIDED:
            took = self._call(active_set.dense, start, external, 1, _NO_SAMPLES, 0, UNCHECKED)
        return cast(Stepped, took.stepped)

    def _call(
        self,
        active_set: ActiveSet,
        start: Start,
        external: ExternalWrenches,
        count: int,
        samples: Array,
        apart: int,
        heeded: int = EVERYTHING,
    ) -> Took:
        """Do steps by the kernel until one needs care, or cannot be done sparse.

        Raises:
            HapticMechError: a step failed.
        """
        counts = self._counts
        known = self.load(start, active_set, external, heeded)
        counts[0], counts[1], counts[4] = count, apart, known is not None
        end = np.empty(active_set.size)
        first = first_terms(known, active_set, count)
        code = advance(
            *active_set.constants,
            first,
            end,
            active_set.scratch,
            self.work,
            self.springs,
            self.on_links(external),
            samples,
            counts,
        )
        return self.took(code, active_set, start.active, end)

    def load(
        self,
        start: Start,
        active_set: ActiveSet,
        external: ExternalWrenches,
        heeded: int = EVERYTHING,
    ) -> Array | None:
        """Put start and external wrenches into the work; return known terms (size,), if any.

        Args:
            start: where.
            active_set: the closures, and the kind of factorisation.
            external: from outside; those on links are left to :meth:`on_links`.
            heeded: see ``run_kernels``.
        """
        parts = self.parts
        parts.q0[:] = start.q
        parts.v0[:] = start.v
        parts.wrenches[:] = external.wrenches
        parts.held[:] = 0.0 if external.in_joints is None else external.in_joints
        # States that are pulled are off the closures anyway: no step needs care.
        parts.settings[8] = UNCHECKED if self._pulled else heeded
        account = parts.account
        account[0] = account[1] = account[5] = 0.0
        return _known(start, active_set)

    def took(self, code: int, active_set: ActiveSet, active: Active, end: Array) -> Took:
        """Return what a kernel did.

        Args:
            code: that it returned; a positive one that is no failure of ``settle`` ended it early.
            active_set: the closures.
            active: which they are.
            end: (size,) packed terms at the end.

        Raises:
            HapticMechError: a step failed.
        """
        parts = self.parts
        work_in, lost, _, stepped, moved, steps = parts.account.tolist()
        done = int(steps)
        if code not in (SETTLED, NOT_DECIDED) and code < NEEDS_CARE:
            raise self._failure(code, end, active, stepped, moved)
        if done == 0:
            return Took(code, 0, None)
        if code == SETTLED:
            q, v = parts.q.copy(), parts.v.copy()
            closing = Closing(self._mechanism.tree, active_set, end, q)
        else:
            q, v = parts.q0.copy(), parts.v0.copy()
            closing = factored(self._mechanism.tree, active_set, q)
        return Took(code, done, Stepped(q, v, closing.error, closing, work_in, lost))

    def _failure(
        self, code: int, packed: Array, active: Active, stepped: float, moved: float
    ) -> HapticMechError:
        """Return the error of a step that the kernel could not end."""
        mechanism, parts, worst = self._mechanism, self.parts, float(packed.item(ERROR))
        names = mechanism.names_of(active)
        if code == OPEN:
            return came_apart(worst, names)
        if code == JUMPED:
            return jumped(moved / stepped, names)
        if code == FLIPPED:
            turned = [i for i, on in enumerate(active) if on and self._turned(i)]
            return flipped(worst, [mechanism.closures[i].name for i in turned[:1]] or names)
        if code == RATES_NOT_FINITE:
            return not_finite("rates", parts.v)
        if code == NOT_FINITE:
            return not_finite("state", parts.q)
        return self._diverged() or failure(code, mechanism.tree)

    def _diverged(self) -> HapticMechError | None:
        """Return the error of a step that went astray, if its start has what its stages lack."""
        mechanism, parts = self._mechanism, self.parts
        none = tuple(False for _ in mechanism.closures)
        try:
            mechanism.closing_terms(parts.q0, none)
        except HapticMechError:
            return None
        return diverged(mechanism.tree, mechanism.difference(parts.q0, parts.q), self._step)

    def _turned(self, index: int) -> bool:
        return self._mechanism.on_wrong_branch(index, self.parts.q)

    def on_links(self, external: ExternalWrenches) -> Array:
        """Return (n, 10) wrenches on links; see ``motion_kernels.add_link_forces``."""
        if not external.on_links:
            return _NO_PUSHES
        mechanism, rows = self._mechanism, []
        for link, wrench in external.on_links.items():
            joint, placement = mechanism.link_place(link)
            rows.append(np.concatenate(([joint], placement.translation, wrench)))
        return np.array(rows, dtype=float)


def _known(start: Start, active_set: ActiveSet) -> Array | None:
    """Return the terms at a step's start if they are known, and of the same kind."""
    closing = start.closing if start.terms is None else start.terms.closing
    if closing is None:
        return None
    return closing.packed if closing.active_set is active_set else None


def first_terms(known: Array | None, active_set: ActiveSet, steps: int) -> Array:
    """Return the packed terms (size,) that a kernel begins with: known, or to be filled.

    Args:
        known: (size,) or None; it is copied for many steps, which change it.
        active_set: the closures.
        steps: that the kernel does.
    """
    if known is None:
        return np.empty(active_set.size)
    return known if steps == 1 else known.copy()


def end_of(stepped: Stepped, start: Start) -> Start:
    """Return where a step ended as where the next one begins."""
    return Start(stepped.q, stepped.v, start.active, closing=stepped.closing)
