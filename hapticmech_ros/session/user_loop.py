# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What several users' session does with the session of each: a tick in parts."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.control.loop_layout import ANSWER, ON_MECHANISM
from hapticmech_ros.control.other_hands import coupling_gain
from hapticmech_ros.layout import DEVICE_SAMPLE, OPERATIONAL_MODEL
from hapticmech_ros.operational.observation import Observation
from hapticmech_ros.operational.results import OperationalAnalysis
from hapticmech_ros.session.loop import SessionLoop
from hapticmech_ros.session.tick_kernels import EVERY, OBSERVE, RECORDED, SENSE
from hapticmech_ros.simulation import MechanismState

_MODEL_SIZE = OPERATIONAL_MODEL.size
_FORCE, _WRENCHES = DEVICE_SAMPLE.slice("hand_wrench"), ANSWER.slice("wrenches")
_NO_RECORDS = np.zeros((0, 0))


class UserLoop(SessionLoop):
    """A session's ticks, of which another moves the mechanism; arguments as of ``Session``."""

    def put(self, state: MechanismState) -> None:
        """Go on from another state of the mechanism at the next tick."""
        self._begin(state)

    @property
    def answered(self) -> Array:
        """(6,) by the hand on the mechanism, of the last answer, which may not act yet."""
        wrenches: Array = self._given[_WRENCHES].reshape(6, 6)[ON_MECHANISM]
        return wrenches

    def sense(self, inputs: Array) -> Array:
        """Begin a tick: sample the device; return (6,) F_h, N and N m, world axes.

        Args:
            inputs: (1, 12) by others, as of :meth:`answer`.
        """
        if self._simulated:
            self._call(SENSE, inputs, _NO_RECORDS)
        else:
            self._sense_otherwise(inputs[0])
        wrench: Array = self._parts.sample[_FORCE].copy()
        return wrench

    def answer(self, inputs: Array, rows: Array, correction: Array) -> Array:
        """Do a tick, begun by :meth:`sense`, up to the mechanism's step, which is another's to do.

        Args:
            inputs: (1, 12) by others on the mechanism at the operational point, which counts as
                F_c, and on the device at the point held; N and N m, world axes.
            rows: (1, width) to fill with the tick's record, or (0, 0) for none.
            correction: (19,) of the command that acts now, for other hands; see ``other_hands``.

        Returns:
            (6,) by the hand on the mechanism at the operational point, N and N m, world axes.
        """
        clock = self._clock
        clock[EVERY], clock[RECORDED] = len(rows), 0
        self._parts.others[:] = correction
        self._answer_sample(inputs, rows, OBSERVE)
        wrench: Array = self._parts.wrenches[ON_MECHANISM].copy()
        return wrench

    def coupling_gain(self, transmitted: Array, share: float) -> Array:
        """Return H_j (6, 6) of this tick's answer; see :mod:`~hapticmech_ros.control.other_hands`.

        Args:
            transmitted: (6, 6) Y_ij, 1, m and 1/m.
            share: C3_j.
        """
        settings, model = self._parts.settings, self._parts.observation[:_MODEL_SIZE]
        return coupling_gain(settings, model, self.time, transmitted, share)

    @property
    def answers_in_python(self) -> bool:
        """Whether a control law of one's own answers, whose dependence on F_c is not known."""
        return self._control.answers_in_python

    @property
    def analysis(self) -> OperationalAnalysis:
        """Analysis of the operational point at this tick, once it is answered."""
        found = self._parts.observation.copy()
        mechanism, analyser = self.simulator.mechanism, self._analyser
        return Observation(found, analyser.layout, analyser.rows, mechanism.nv).analysis
