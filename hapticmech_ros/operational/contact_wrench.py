# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""F_c at the operational points of a mechanism, of what acts on it elsewhere.

That is what its contacts do, and the other hands where there are several; see
:mod:`.observe_kernels`.
"""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.mechanism.evaluation import Evaluation
from hapticmech_ros.mechanism.mechanism import Mechanism
from hapticmech_ros.operational.analysis import Analyser
from hapticmech_ros.operational.observe_kernels import consistent_wrench


def contact_wrench(analyser: Analyser, terms: Evaluation, joint_force: Array) -> Array:
    """Return F_c (6,): by the environment on the mechanism, at the point, world axes, N and N m.

    Args:
        analyser: of the point.
        terms: of the mechanism at a state.
        joint_force: (nv,) Σ J_cᵀ λ, N m or N.
    """
    seen, closing, wrench = analyser.observe_terms(terms), terms.closing, np.zeros(6)
    consistent_wrench(
        *closing.active_set.constants,
        closing.packed,
        seen.numbers,
        analyser.rows,
        np.array(joint_force, dtype=float),
        wrench,
    )
    return wrench


class ContactWrenches:
    """What acts elsewhere on a mechanism, as a wrench at each of its operational points.

    Args:
        mechanism: whose.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self._analysers = [Analyser(mechanism, name) for name in mechanism.point_names]

    def at(self, terms: Evaluation, joint_forces: Array) -> Array:
        """Return F_c (points, 6), on the mechanism, N and N m, world axes at each point.

        Args:
            terms: of the mechanism at a state.
            joint_forces: (points, nv), N m or N: what each point is to feel, such as the sum of
                J_cᵀ λ of the contacts.
        """
        found = np.zeros((len(self._analysers), 6))
        for index, (analyser, force) in enumerate(zip(self._analysers, joint_forces, strict=True)):
            if force.any():
                found[index] = contact_wrench(analyser, terms, force)
        return found
