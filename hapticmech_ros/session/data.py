# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All that a session's ticks read and write besides the mechanism: one array, allocated once."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hapticmech_ros.arrays import Array
from hapticmech_ros.compilation import Part, Size, Structure, structure
from hapticmech_ros.compilation.structures import SIZES
from hapticmech_ros.layout import Field, Layout

_ONE = Field(1)
# Period, s; length of the mechanism, m; τ of the loop, s; and delay, s, jitter and loss of the
# connection.
TIMES = Layout(dict.fromkeys(("period", "length", "loop_delay", "delay", "jitter", "loss"), _ONE))
# Of the mechanism: time, s; work done on it, and energy lost, J; closure error, m or rad; number of
# joint constraints reported; energy lost in contacts, and held by them, J; and of its account
# ``surplus``, ``refined``, ``inaccurate``, ``latch_loss``, ``moved`` and ``contact_most``.
TOTALS = Layout(
    dict.fromkeys(
        (
            "time",
            "work_in",
            "damping_loss",
            "closure_error",
            "constraints",
            "contact_loss",
            "contact_energy",
            "surplus",
            "refined",
            "inaccurate",
            "latch_loss",
            "moved",
            "contact_most",
        ),
        _ONE,
    )
)


@structure
class SessionData(Structure):
    """Data of a session; t rows of the task space, d periods of delay.

    Attributes:
        index: number of the operational point.
        steps: of the mechanism's integrator in a period.
        stages: of a step.
        implicit: 1 for an implicit rule.
        connected: 1 if a connection is between device and controller.
        period_ns: of a tick.
        received: 1 if a sample has reached the controller in this tick.
        rows: (t,) rows of a six-vector that the task space has.
        forth_state, back_state: channels of the connection, see ``channel_kernels``.
        times: (6,) see ``TIMES``.
        metric: constants of the analysis, see ``metric_of``.
        observation: of the operational point, see ``observation_layout``.
        controller: its account, settings and so on: see ``loop_layout``.
        settings: of the controllers.
        faded: (6,) what is carried on from another grasp, N and N m, world axes.
        commanded: (d, 6) the wrenches commanded on the mechanism that do not act yet.
        account: the device's.
        safety: its envelope.
        answers: (d + 2, ...) answers that do not act yet, the row after them, and the last one.
        sample: (19,) of the device.
        device: the device, see ``device_layout``.
        state: (107,) of the device.
        later: (107,) its next one.
        counter: of joint constraints.
        wrenches: (3, 6) rows ``ON_HAND``, ``ON_MECHANISM``, ``COMMANDED`` of ``loop_layout``.
        external: (6,) on the mechanism at the operational point, by others, N and N m, world axes.
        push: (6,) on the device, by others than the hand, likewise.
        contact: (6,) part of F_c by virtual objects, N and N m, world axes.
        locality: (3,) see ``loop_layout.LOCALITY``.
        added: (6,) by the device's driver.
        others: (19,) what a command is corrected by for other hands, see ``control.other_hands``.
        given: the last answer that was given, over a connection.
        q: (nq,) configuration at the tick's start.
        v: (nv,) rates there.
        totals: (13,) see ``TOTALS``.
        began_state, began_q, began_v, began_totals: of the device and the mechanism when the tick
            began.
        hand: (22,) its last wrenches, see ``hand_lead_kernels``.
        forth, back: messages on the way to the controller, and back.
        past: (n + 1, 1 + nv) rates of the last ticks, one row each by turns, or none: the tick's
            number + 1, and its rates.
        before: (1 + nv,) how long ago, s, and the rates that were, or 0. From ``forth`` on, no
            sample has these parts.
    """

    __slots__ = ()

    index, steps, stages, implicit = Size(0), Size(1), Size(2), Size(3)
    connected, period_ns, received = Size(4), Size(5), Size(6)
    rows = Part(0, 1, whole=True)
    forth_state, back_state = Part(1, 1, whole=True), Part(2, 1, whole=True)
    times, metric, observation = Part(3, 1), Part(4, 1), Part(5, 1)
    controller, settings, faded, commanded = Part(6, 1), Part(7, 1), Part(8, 1), Part(9, 2)
    account, safety, answers, sample = Part(10, 1), Part(11, 1), Part(12, 2), Part(13, 1)
    device, state, later, counter = Part(14, 1), Part(15, 1), Part(16, 1), Part(17, 1)
    wrenches, external, push, contact = Part(18, 2), Part(19, 1), Part(20, 1), Part(21, 1)
    locality, added, others, given = Part(22, 1), Part(23, 1), Part(24, 1), Part(25, 1)
    q, v, totals = Part(26, 1), Part(27, 1), Part(28, 1)
    began_state, began_q, began_v, began_totals = Part(29, 1), Part(30, 1), Part(31, 1), Part(32, 1)
    hand = Part(33, 1)
    forth, back, past, before = Part(34, 2), Part(35, 2), Part(36, 2), Part(37, 1)

    def sampled(self) -> Array:
        """Return (n,) the part of the data that a sample has: all but messages and past rates."""
        return self.data[: int(self.numbers[vars(SessionData)["forth"].at])]


# Names of its parts.
PARTS = tuple(name for name, part in vars(SessionData).items() if isinstance(part, Part))


def session_data(sizes: Mapping[str, int], parts: Mapping[str, Array]) -> SessionData:
    """Return session data with these sizes, and parts that begin with these numbers.

    Args:
        sizes: by name; all of them.
        parts: name -> (n,) or (n, m) array; all of them. They are copied.
    """
    kinds = vars(SessionData)
    numbers = np.zeros(SIZES, dtype=np.int64)
    for name, size in sizes.items():
        numbers[kinds[name].index] = size
    ordered = sorted(parts, key=lambda name: int(kinds[name].at))
    whole = [name for name in ordered if kinds[name].whole]
    real = [name for name in ordered if not kinds[name].whole]
    places = np.zeros(3 * len(parts), dtype=np.int64)
    for names, first in ((whole, SIZES + places.size), (real, 0)):
        start = first
        for name in names:
            shape = parts[name].shape
            columns = shape[1] if len(shape) == 2 else 1
            at = kinds[name].at - SIZES
            places[at : at + 3] = start, shape[0], columns
            start += parts[name].size
    integers = [np.asarray(parts[name], dtype=np.int64).ravel() for name in whole]
    floats = [np.asarray(parts[name], dtype=float).ravel() for name in real]
    return SessionData(np.concatenate((numbers, places, *integers)), np.concatenate(floats))
