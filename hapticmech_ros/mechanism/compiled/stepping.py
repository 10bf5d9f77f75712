"""Steps of a compiled mechanism, one or many, in a call of one kernel."""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple, cast

import numpy as np

from hapticmech_ros.errors import HapticMechError
from hapticmech_ros.mechanism.compiled.band_kernels import UNDECIDED
from hapticmech_ros.mechanism.compiled.chosen import Chosen
from hapticmech_ros.mechanism.compiled.implicit_kernels import springs_size
from hapticmech_ros.mechanism.compiled.kernels import NOT_FINITE
from hapticmech_ros.mechanism.compiled.mechanism import CompiledMechanism, failure
from hapticmech_ros.mechanism.compiled.packed import ERROR
from hapticmech_ros.mechanism.compiled.run_kernels import (
    EVERYTHING,
    HEEDLESS,
    NEEDS_CARE,
    RATES_NOT_FINITE,
    STAGES,
    advance,
)
from hapticmech_ros.mechanism.compiled.settle_kernels import FLIPPED, JUMPED, OPEN, SETTLED
from hapticmech_ros.mechanism.compiled.space import CompiledClosing
from hapticmech_ros.mechanism.compiled.step_kernels import PARTS, Work, work_size
from hapticmech_ros.mechanism.evaluation import Active, Closing
from hapticmech_ros.mechanism.model import Array
from hapticmech_ros.mechanism.motion import Pushes, Start, not_finite
from hapticmech_ros.mechanism.projection import (
    BAUMGARTE_FAILURE,
    PROJECTION_FAILURE,
    PROJECTION_TOLERANCE,
    ROUNDING_TOLERANCE,
    came_apart,
    flipped,
    jumped,
)
from hapticmech_ros.mechanism.schemes import SCHEMES
from hapticmech_ros.mechanism.stepping import Plan, Stepped, Stepper, end_of

_NO_SAMPLES = np.zeros((0, 0))
_NO_PUSHES = np.zeros((0, 10))


class Took(NamedTuple):
    """What a call of the kernel did: why it ended, how many steps, and their end if there are."""

    code: int
    steps: int
    stepped: Stepped | None


class CompiledStepper(Stepper):
    """Steps as :class:`Stepper` does, to rounding, at a fraction of the time.

    Attributes:
        work: see ``step_kernels.Work``.
        parts: views of the work's parts.
    """

    def __init__(self, mechanism: CompiledMechanism, plan: Plan) -> None:
        super().__init__(mechanism, plan)
        self._compiled = mechanism
        nq, nv, points = mechanism.nq, mechanism.nv, len(mechanism.point_names)
        scheme = SCHEMES[plan.integrator]
        self._springs = np.zeros(springs_size(nv) if scheme.implicit else 0)
        self.work = np.zeros(work_size(nq, nv, points))
        numbers = mechanism.chosen(mechanism.initially_active).constants[0]
        work = Work(numbers, self.work)
        # Found once: each look at the work makes a view.
        self.parts = parts = SimpleNamespace(**{name: getattr(work, name) for name in PARTS})
        self._counts = np.array((1, 0, len(scheme.weights), scheme.implicit, 0))
        self._pulled = pulled = plan.baumgarte_rate > 0.0
        most_open = BAUMGARTE_FAILURE if pulled else PROJECTION_FAILURE
        fractions = (PROJECTION_TOLERANCE, ROUNDING_TOLERANCE, PROJECTION_FAILURE)
        parts.settings[:2] = plan.period / plan.substeps, scheme.late
        parts.settings[2:5] = np.array(fractions) * mechanism.length
        parts.settings[5:7] = plan.baumgarte_rate, most_open * mechanism.length
        parts.settings[7] = scheme.corrected and nq != nv
        parts.scheme[: len(scheme.weights), 0] = scheme.weights
        parts.scheme[: len(scheme.fractions), 1] = scheme.fractions

    def advance(self, start: Start, pushes: Pushes) -> Stepped:
        """Advance by one period with pushes held; see ``Simulator.step``."""
        return self.run(start, pushes, 1, _NO_SAMPLES, 0)

    def run(
        self, start: Start, pushes: Pushes, periods: int, samples: Array, every: int
    ) -> Stepped:
        """Advance by many periods with pushes held, and fill samples; see :class:`Stepper`."""
        self.check(pushes)
        total, apart = periods * self._plan.substeps, every * self._plan.substeps
        now, done, work_in, lost = start, 0, 0.0, 0.0
        while True:
            # After a step that was done alone there may be some before the next sample.
            since = done % apart if apart else 0
            count = min(total - done, apart - since) if since else total - done
            rows = samples[done // apart :] if apart and not since else _NO_SAMPLES
            chosen = self._compiled.chosen(now.active)
            code, steps, stepped = self._call(chosen, now, pushes, count, rows, apart)
            if stepped is not None:
                if steps == total:
                    return stepped
                work_in, lost = work_in + stepped.work_in, lost + stepped.energy_lost
                now = end_of(stepped, start)
            if steps < count:
                stepped = self._alone(code, now, pushes)
                work_in, lost = work_in + stepped.work_in, lost + stepped.energy_lost
                now = end_of(stepped, start)
                steps, since = steps + 1, 1
            done += steps
            if apart and since and done % apart == 0:
                samples[done // apart - 1] = np.concatenate((now.q, now.v))
            if done == total and stepped is not None:
                return stepped._replace(work_in=work_in, energy_lost=lost)

    def _alone(self, code: int, start: Start, pushes: Pushes) -> Stepped:
        """Do the step that the kernel stopped before."""
        if code == UNDECIDED:
            dense = self._compiled.chosen(start.active).dense
            took = self._call(dense, start, pushes, 1, _NO_SAMPLES, 0)
            if took.stepped is not None:
                return took.stepped
        return self.careful_substep(start, pushes)

    def _substep(self, start: Start, pushes: Pushes) -> Stepped:
        """Do a step whatever it starts at, leaves, or passes."""
        return cast(Stepped, self._once(start, pushes, HEEDLESS))

    def _watched_substep(self, start: Start, pushes: Pushes, limit: float) -> Stepped | None:
        """Do a step; None if a stage of it is next to a singular position, see the kernel."""
        return self._once(start, pushes, STAGES)

    def _once(self, start: Start, pushes: Pushes, heeded: int) -> Stepped | None:
        chosen = self._compiled.chosen(start.active)
        took = self._call(chosen, start, pushes, 1, _NO_SAMPLES, 0, heeded)
        if took.code == UNDECIDED:
            took = self._call(chosen.dense, start, pushes, 1, _NO_SAMPLES, 0, heeded)
        return took.stepped

    def _call(
        self,
        chosen: Chosen,
        start: Start,
        pushes: Pushes,
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
        known = self.load(start, chosen, pushes, heeded)
        counts[0], counts[1], counts[4] = count, apart, known is not None
        end = np.empty(chosen.size)
        first = first_terms(known, chosen, count)
        code = advance(
            *chosen.constants,
            first,
            end,
            chosen.scratch,
            self.work,
            self._springs,
            self.on_links(pushes),
            samples,
            counts,
        )
        return self.took(code, chosen, start.active, end)

    def load(
        self, start: Start, chosen: Chosen, pushes: Pushes, heeded: int = EVERYTHING
    ) -> Array | None:
        """Put where steps start, and what pushes, into the work; return known terms, if any.

        Args:
            start: where.
            chosen: the closures, and the kind of factorisation.
            pushes: from outside; those on links are left to :meth:`on_links`.
            heeded: see ``run_kernels``.
        """
        parts = self.parts
        parts.q0[:] = start.q
        parts.v0[:] = start.v
        parts.wrenches[:] = pushes.wrenches
        parts.held[:] = 0.0 if pushes.in_joints is None else pushes.in_joints
        # States that are pulled are off the closures anyway: no step needs care.
        parts.settings[8] = HEEDLESS if self._pulled else heeded
        account = parts.account
        account[0] = account[1] = account[5] = 0.0
        return _known(start, chosen)

    def took(self, code: int, chosen: Chosen, active: Active, end: Array) -> Took:
        """Return what a kernel did.

        Args:
            code: that it returned; a positive one that is no failure of ``settle`` ended it early.
            chosen: the closures.
            active: which they are.
            end: packed terms that it filled, at the end or where it failed.

        Raises:
            HapticMechError: a step failed.
        """
        parts = self.parts
        work_in, lost, _, stepped, moved, steps = parts.account.tolist()
        done = int(steps)
        if code not in (SETTLED, UNDECIDED) and code < NEEDS_CARE:
            raise self._failure(code, end, active, stepped, moved)
        if done == 0:
            return Took(code, 0, None)
        if code == SETTLED:
            q, v = parts.q.copy(), parts.v.copy()
            closing: Closing = CompiledClosing(self._compiled, chosen, end, q)
        else:
            q, v = parts.q0.copy(), parts.v0.copy()
            closing = self._compiled.factored(chosen, q)
        return Took(code, done, Stepped(q, v, closing.error, closing, work_in, lost))

    def _failure(
        self, code: int, packed: Array, active: Active, stepped: float, moved: float
    ) -> HapticMechError:
        """Return the error of a step that the kernel could not end."""
        mechanism, parts, worst = self._compiled, self.parts, float(packed.item(ERROR))
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
        return failure(code, mechanism.tree)

    def _turned(self, index: int) -> bool:
        return self._compiled.on_wrong_branch(index, self.parts.q)

    def on_links(self, pushes: Pushes) -> Array:
        """Return (pushes, 10) wrenches on links; see ``motion_kernels.add_link_forces``."""
        if not pushes.on_links:
            return _NO_PUSHES
        mechanism, rows = self._compiled, []
        for link, wrench in pushes.on_links.items():
            joint, placement = mechanism.link_place(link)
            rows.append(np.concatenate(([joint], placement.translation, wrench)))
        return np.array(rows, dtype=float)


def _known(start: Start, chosen: Chosen) -> Array | None:
    """Return the terms at a step's start if they are known, and of the same kind."""
    closing = start.closing if start.terms is None else start.terms.closing
    if closing is None:
        return None
    known = cast(CompiledClosing, closing)
    return known.packed if known.chosen is chosen else None


def first_terms(known: Array | None, chosen: Chosen, steps: int) -> Array:
    """Return the packed terms that a kernel begins so many steps with: known, or to be filled."""
    if known is None:
        return np.empty(chosen.size)
    # Others may hold what is known, and many steps use both arrays.
    return known if steps == 1 else known.copy()
