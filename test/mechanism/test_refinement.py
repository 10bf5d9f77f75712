# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Steps that are done again in smaller ones: of equal length, and by their errors."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from hapticmech_ros.errors import ClosureError
from hapticmech_ros.mechanism.kernels.energy_kernels import Balance
from hapticmech_ros.mechanism.refinement import Ways, refined


class Sudden:
    """A step from 0 to 1 by the midpoint rule; the rate changes within ``width`` of ``at``."""

    def __init__(self, at, width):
        self.at, self.width, self.done = at, width, 0

    def _exact(self, time):
        return math.atan((time - self.at) / self.width)

    def _to(self, begin, end):
        self.done += 1
        middle = 0.5 * (begin + end) - self.at
        off = (end - begin) * self.width / (self.width**2 + middle**2)
        return off - (self._exact(end) - self._exact(begin))

    def ways(self):
        def moved(begin, end, steps):
            mesh = np.linspace(begin, end, steps + 1)
            off = sum(map(self._to, mesh[:-1], mesh[1:]))
            return Ended(begin, end, off)

        return Ways(
            lambda count: moved(0.0, 1.0, count),
            lambda now, share: moved(now.time, now.time + share, 1),
            lambda now, stepped: balance(stepped.off),
        )


class Ended(SimpleNamespace):
    """Where steps ended, and by how much they are off."""

    def __init__(self, begin, end, off):
        super().__init__(begin=begin, time=end, off=off)

    def after(self, before):
        return Ended(before.begin, self.time, before.off + self.off)


@pytest.fixture(autouse=True)
def _of_times(monkeypatch):
    """States are times here."""
    monkeypatch.setattr(
        "hapticmech_ros.mechanism.refinement.end_of", lambda stepped, start: stepped
    )


def balance(off):
    return Balance(np.array((off, abs(off), max(off, 0.0), 1.0, 0.0, 1.0, 0.0)))


BEGUN = SimpleNamespace(time=0.0)


@pytest.mark.parametrize(("order", "whole", "done"), [(4, 1.9e-4, 8), (2, 4e-5, 4)])
def test_where_halving_pays_steps_are_halved_once_the_account_closes(order, whole, done):
    """Two of them close it. Of order 4: 8 to a hundredth. Of order 2: as 4 show, 16 would."""
    counts = []

    def divided(count):
        counts.append(count)
        return Ended(0.0, 1.0, whole / count**order)

    ways = Ways(divided, divided, lambda now, stepped: balance(stepped.off))
    _, found = refined(BEGUN, 1.2e-5, 32, ways)
    assert found.judged == whole / done**order
    assert max(counts) == done


@pytest.mark.parametrize("at", [0.1, 0.37, 0.73])
@pytest.mark.parametrize("width", [3e-3, 1e-2])
def test_steps_become_short_where_something_happens(at, width):
    """With as many steps as equal ones, errors of a rule of order 2 are ten times smaller."""
    motion = Sudden(at, width)
    ways = motion.ways()
    equal = abs(ways.divided(32).off)
    ended, found = refined(BEGUN, 1e-12, 32, ways)
    assert found.judged < 0.1 * equal
    assert ended.time == pytest.approx(1.0, abs=1e-12)
    assert motion.done <= 32 + 63 + 3 * 32


def test_a_part_that_cannot_be_done_leaves_the_best_of_equal_steps():
    motion = Sudden(0.5, 1e-2)

    def fails(*_):
        raise ClosureError("came apart", 1.0, ["pin"])

    ended, found = refined(BEGUN, 1e-12, 8, motion.ways()._replace(part=fails))
    assert found.judged == min(abs(Sudden(0.5, 1e-2).ways().divided(n).off) for n in (1, 2, 4, 8))
    assert ended.time == 1.0
