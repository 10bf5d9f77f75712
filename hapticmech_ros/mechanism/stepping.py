# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps of a mechanism, one or many, in a call of one kernel: integrated, then projected.

Where branches of the motion cross, or nearly do, the kernel stops, and the step is led along one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import cast

import numpy as np

from hapticmech_ros.errors import InaccurateStepError
from hapticmech_ros.mechanism.branches import branch_step
from hapticmech_ros.mechanism.closures import Active
from hapticmech_ros.mechanism.constraint_space import Closing, factored
from hapticmech_ros.mechanism.kernels.band_kernels import NOT_DECIDED
from hapticmech_ros.mechanism.kernels.energy_kernels import Balance, judge
from hapticmech_ros.mechanism.kernels.layout import ActiveSet
from hapticmech_ros.mechanism.kernels.model import Data, RunPlan, Work
from hapticmech_ros.mechanism.kernels.run_kernels import (
    EVERYTHING,
    SINGULAR_STEP,
    UNCHECKED,
    advance,
)
from hapticmech_ros.mechanism.kernels.settle_kernels import SETTLED
from hapticmech_ros.mechanism.kernels.step_kernels import work_size
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.mechanism.motion import (
    ExternalWrenches,
    Start,
    Stepped,
    Took,
    check_external,
    end_of,
)
from hapticmech_ros.mechanism.refinement import Ways, judged, refined, step_error
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.mechanism.tolerances import (
    BAUMGARTE_FAILURE,
    PROJECTION_FAILURE,
    PROJECTION_TOLERANCE,
    ROUNDING_TOLERANCE,
)
from hapticmech_ros.numerics import Array

_NO_SAMPLES = np.zeros((0, 0))
_NO_PUSHES = np.zeros((0, 10))
SingleStep = Callable[[Start, ExternalWrenches], Stepped]


class Stepper:
    """Steps a mechanism by periods.

    Args:
        mechanism: to step, by its scene's ``simulation``.

    Attributes:
        work: see ``model.Work``.
        parts: views of the work's parts.
        stages: of the rule.
        implicit: 1 for an implicit rule.
        step: s, length of the steps that are done now; see :meth:`divided`.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self._plan = plan = mechanism.scene.simulation
        scheme, tolerance = SCHEMES[plan.integrator], plan.accuracy.tolerance
        self._pulled = plan.stabilisation == "baumgarte"
        # Of the steps that are done now; see _unwatched.
        self.step = plan.period / plan.substeps
        self._tolerance = scheme.tolerance if tolerance is None else tolerance
        if self._pulled:
            self._tolerance = 0.0
        nq, nv, points = mechanism.nq, mechanism.nv, len(mechanism.point_names)
        self._drift = scheme.drift
        self.work = np.zeros(work_size(nq, nv, points))
        numbers = mechanism.active_set(mechanism.initially_active).constants[0]
        self._work = work = Work(numbers, self.work)
        # Found once: each look at the work makes a view.
        self.parts = parts = SimpleNamespace(**{name: getattr(work, name) for name in Work.parts})
        # The last settings of ``prepare``.
        self._prepared: tuple[int, float, float] | None = None
        self._run = RunPlan()
        self._run.stages, self._run.implicit = len(scheme.weights), scheme.implicit
        most_open = BAUMGARTE_FAILURE if self._pulled else PROJECTION_FAILURE
        parts.settings.fill(
            semi_implicit=scheme.late,
            drift_tolerance=scheme.drift,
            projection_tolerance=PROJECTION_TOLERANCE * mechanism.length,
            rounding_tolerance=ROUNDING_TOLERANCE * mechanism.length,
            jump_residual=PROJECTION_FAILURE * mechanism.length,
            baumgarte_rate=plan.baumgarte_rate if self._pulled else 0.0,
            residual_limit=most_open * mechanism.length,
            local_rates=scheme.corrected and nq != nv,
        )
        parts.scheme[: len(scheme.weights), 0] = scheme.weights
        parts.scheme[: len(scheme.fractions), 1] = scheme.fractions
        self.stages, self.implicit = len(scheme.weights), int(scheme.implicit)

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
        substeps = self._plan.substeps
        return self._steps(start, external, periods * substeps, samples, every * substeps)

    def _steps(
        self, start: Start, external: ExternalWrenches, total: int, samples: Array, apart: int
    ) -> Stepped:
        """Do steps of the length that is set; fill a sample after every ``apart`` of them."""
        now, done, ended = start, 0, None
        while True:
            # After a step that was done alone there may be some before the next sample.
            since = done % apart if apart else 0
            count = min(total - done, apart - since) if since else total - done
            rows = samples[done // apart :] if apart and not since else _NO_SAMPLES
            active_set = self._mechanism.active_set(now.active)
            code, steps, stepped = self._call(active_set, now, external, count, rows, apart)
            if stepped is not None:
                ended = stepped if ended is None else stepped.after(ended)
                now = end_of(stepped, now)
            if steps < count:
                try:
                    stepped = self.alone(code, now, external)
                except InaccurateStepError as error:
                    error.time += (done + steps) * self.step
                    raise
                ended = stepped if ended is None else stepped.after(ended)
                now = end_of(stepped, now)
                steps, since = steps + 1, 1
            done += steps
            if apart and since and done % apart == 0:
                samples[done // apart - 1] = np.concatenate((now.q, now.v))
            if done == total and ended is not None:
                return ended

    def alone(self, code: int, start: Start, external: ExternalWrenches) -> Stepped:
        """Do the step that the kernel stopped before.

        Args:
            code: why; see ``run_kernels.advance``.
            start: of the step.
            external: from outside.

        Returns:
            The state after it.

        Raises:
            HapticMechError: as ``Simulator.step``.
        """
        if code == NOT_DECIDED:
            dense = self._mechanism.active_set(start.active).dense
            code, _, stepped = self._call(dense, start, external, 1, _NO_SAMPLES, 0)
            if stepped is not None:
                return stepped
        single = self._branch_substep if code == SINGULAR_STEP else self._substep
        if self._tolerance == 0.0:
            return single(start, external)
        damps = bool(self.implicit)
        ways = Ways(
            lambda count: self._divided(start, external, single, count),
            lambda now, share: self._smaller(now, external, 1.0 / share, 1),
            lambda now, stepped: self._balance(now, stepped, external, damps),
        )
        stepped, balance = refined(start, self._tolerance, self._plan.accuracy.max_substeps, ways)
        return judged(self._mechanism.tree, start, stepped, balance, self._tolerance, self._drift)

    def _divided(
        self, start: Start, external: ExternalWrenches, single: SingleStep, count: int
    ) -> Stepped:
        """Do a step in so many smaller ones, or in one, without checking their accounts."""
        if count == 1:
            with self._unwatched():
                return single(start, external)
        return self._smaller(start, external, count, count)

    def _smaller(
        self, start: Start, external: ExternalWrenches, times: float, steps: int
    ) -> Stepped:
        """Do steps that are so many times shorter, without a check of their energy accounts."""
        with self._unwatched(), self.divided(times):
            return self._steps(start, external, steps, _NO_SAMPLES, 0)

    @contextmanager
    def _unwatched(self) -> Iterator[None]:
        """Return a context in which steps are not refined."""
        tolerance, self._tolerance = self._tolerance, 0.0
        try:
            yield
        finally:
            self._tolerance = tolerance

    @contextmanager
    def divided(self, times: float) -> Iterator[None]:
        """Return a context in which steps are so many times shorter."""
        step, self.step = self.step, self.step / times
        try:
            yield
        finally:
            self.step = step

    def _balance(
        self, start: Start, stepped: Stepped, external: ExternalWrenches, damps: bool
    ) -> Balance:
        """Return the energy account of a step; see ``energy_kernels.put_balance``."""
        # At a singular position a sparse factorisation is not decided.
        closing, parts, found = stepped.closing.dense, self.parts, Balance()
        known = self.load(start, closing.active_set, external)
        if known is None:
            known = factored(self._mechanism.tree, closing.active_set, start.q).packed
        parts.q[:], parts.v[:] = stepped.q, stepped.v
        judge(
            closing.active_set.model,
            Data(closing.active_set.model.numbers, known),
            closing.parts,
            self._work,
            self.on_links(external),
            damps,
            stepped.work_in + stepped.contact_work,
            stepped.energy_lost,
            found,
        )
        return found

    def _branch_substep(self, start: Start, external: ExternalWrenches) -> Stepped:
        """Return the state after a step, along its branch where branches of the motion cross."""
        if not self._pulled:
            led = branch_step(
                self._mechanism,
                start,
                external,
                self.step,
                lambda stepped: self._balance(start, stepped, external, False),
            )
            if led is not None:
                return led
        return self._substep(start, external)

    def _substep(self, start: Start, external: ExternalWrenches) -> Stepped:
        """Do a step even at, from, or past a singular position."""
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
        """Do steps by the kernel until one is singular, or cannot be done sparse.

        Raises:
            HapticMechError: a step failed.
        """
        run = self._run
        known = self.load(start, active_set, external, heeded)
        run.steps, run.sample_every, run.terms_known = count, apart, known is not None
        end = np.empty(active_set.size)
        first = active_set.first_terms(known, count)
        code = advance(
            *active_set.constants,
            first,
            end,
            active_set.scratch,
            self.work,
            self.on_links(external),
            samples,
            run.values,
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
        parts.settings.contact_wrenches = len(external.touching)
        self.prepare(heeded)
        account = parts.account
        account.values[:] = 0.0
        (
            account.earlier_defect,
            account.earlier_work,
            account.earlier_loss,
            account.largest_kinetic,
        ) = start.earlier
        return start.packed(active_set)

    def prepare(self, heeded: int = EVERYTHING) -> None:
        """Set the kernel's checks of steps.

        Args:
            heeded: see ``run_kernels``.
        """
        wanted = heeded, self.step, self._tolerance
        if wanted == self._prepared:
            return
        settings = self.parts.settings
        # States that are pulled are off the closures anyway: no step is singular.
        checked = heeded == EVERYTHING and not self._pulled
        settings.step = self.step
        settings.singularity_checks = EVERYTHING if checked else UNCHECKED
        settings.energy_tolerance = self._tolerance if checked else 0.0
        self._prepared = wanted

    def took(self, code: int, active_set: ActiveSet, active: Active, end: Array) -> Took:
        """Return a kernel's result.

        Args:
            code: that it returned; a positive one that is no failure of ``settle`` ended it early,
                and so does a failure, if steps are refined.
            active_set: the closures.
            active: which they are.
            end: (size,) packed terms at the end.

        Raises:
            HapticMechError: a step failed.
        """
        parts = self.parts
        account = parts.account
        done, by_contacts = int(account.steps_done), account.contact_work
        failed = code not in (SETTLED, NOT_DECIDED) and code < SINGULAR_STEP
        # Smaller steps may go where this one cannot.
        if failed and not parts.settings.energy_tolerance > 0.0:
            raise step_error(self._mechanism, parts, code, end, active)
        if not done:
            return Took(code, 0, None)
        if code == SETTLED:
            q, v = parts.q.copy(), parts.v.copy()
            closing = Closing(self._mechanism.tree, active_set, end, q)
        else:
            q, v = parts.q0.copy(), parts.v0.copy()
            closing = factored(self._mechanism.tree, active_set, q)
        stepped = Stepped(
            *(q, v, closing.error, closing, account.work_in - by_contacts),
            *(account.energy_lost, account.energy_defect),
            contact_work=by_contacts,
            moved=account.largest_kinetic,
            inaccurate=int(account.lossy_steps),
        )
        return Took(code, done, stepped)

    def on_links(self, external: ExternalWrenches) -> Array:
        """Return (n, 10) wrenches on links; see ``motion_kernels.add_link_forces``."""
        if not (external.on_links or external.touching):
            return _NO_PUSHES
        mechanism, rows = self._mechanism, []
        for link, wrench in (*external.touching.items(), *external.on_links.items()):
            joint, placement = mechanism.link_place(link)
            rows.append(np.concatenate(([joint], placement.translation, wrench)))
        return np.array(rows, dtype=float)
