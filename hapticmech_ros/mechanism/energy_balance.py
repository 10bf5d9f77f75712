# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""By how much the energy account of a step is off."""

from __future__ import annotations

import math
from typing import NamedTuple

from hapticmech_ros.mechanism.inertia import inaccurate
from hapticmech_ros.mechanism.kernels.energy_kernels import allowed
from hapticmech_ros.mechanism.model import TreeModel
from hapticmech_ros.mechanism.motion import Owed, Start, Stepped
from hapticmech_ros.mechanism.tolerances import ROUNDED_STEPS

# A step that is off by this share of what it exchanged, however it is divided, is an error.
FAILURE = 0.1


class Balance(NamedTuple):
    """Energy account of a step, J; see ``energy_kernels.put_balance``.

    Attributes:
        off: energy at the end less that at the start and the work done, plus losses: 0 is exact.
        judged: what of that is held against a tolerance.
        made: what was made from nothing.
        exchanged: kinetic energy at both ends, change of the potential one, work and losses, and
            what the step's forces would give to a free mechanism at rest.
        rounding: of the potential energies, and what nobody feels.
        kinetic: at the end.
        lost: to dampers, friction and stops, and to a rule that damps what is too fast for it.
    """

    off: float
    judged: float
    made: float
    exchanged: float
    rounding: float
    kinetic: float
    lost: float

    def is_within(self, tolerance: float) -> bool:
        """Return whether the step is off by no more than a share of what was exchanged."""
        return self.judged <= allowed(tolerance, self.exchanged, self.rounding)


# Of no step.
NO_BALANCE = Balance(math.inf, math.inf, math.inf, 0.0, 0.0, 0.0, 0.0)


def judged(
    tree: TreeModel,
    start: Start,
    stepped: Stepped,
    balance: Balance,
    tolerance: float,
    most: float,
) -> Stepped:
    """Return a step with its account; without what was made from nothing, if that is too much.

    In the step, or in all since the start: then all of it is taken out of the motion.

    Args:
        tree: the mechanism's.
        start: of the step.
        stepped: what it did.
        balance: its account.
        tolerance: share of what it exchanged by which it may be off.
        most: share of what was exchanged that all steps may make from nothing.

    Raises:
        InaccurateStepError: it is off by a tenth of what it exchanged.
    """
    within, made = balance.is_within(tolerance), 0.0
    if not within:
        if balance.judged > FAILURE * balance.exchanged:
            raise inaccurate(tree, stepped.v - start.v, balance.off, balance.exchanged)
        made = min(balance.made, balance.kinetic)
    surplus, kinetic = balance.off - made, balance.kinetic - made
    drifts = drift(start.owed, stepped, surplus, balance, most)
    drifted = min(max(drifts, 0.0), kinetic)
    taken = made + drifted
    share = math.sqrt(1.0 - taken / balance.kinetic) if taken > 0.0 else 1.0
    return stepped._replace(
        v=share * stepped.v if taken > 0.0 else stepped.v,
        energy_lost=balance.lost,
        surplus=surplus - drifted,
        refined=1,
        inaccurate=int(not within or drifts != 0.0),
        moved=kinetic - drifted,
    )


def drift(owed: Owed, stepped: Stepped, surplus: float, balance: Balance, most: float) -> float:
    """Return what steps made from nothing since the start, J, or lost, if it is too much; 0 if not.

    Args:
        owed: by the account before the step.
        stepped: what it did.
        surplus: that is left of the step, J.
        balance: its account.
        most: share of what was exchanged that is not too much.
    """
    work, lost = owed.work_in + stepped.work_in, owed.lost + balance.lost
    total = owed.surplus + surplus
    exchanged = abs(work) + lost + max(owed.moved, balance.kinetic)
    within = abs(total) <= most * exchanged + ROUNDED_STEPS * balance.rounding
    return 0.0 if within else total
