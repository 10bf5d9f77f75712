# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Records: arrays whose fields have names, in Python; kernels read them in test_kernel_calls."""

from __future__ import annotations

import numpy as np

from hapticmech_ros.numerics.layout import Nested, Number, Record, Vector, Whole, matrix


class Spring(Record):
    stiffness = Number("stiffness")
    rest = Vector(3, "position")


class Bench(Spring):
    turns = matrix(2, 3)
    other = Nested(Spring)


class Plan(Record):
    dtype = int
    steps = Whole()


def test_fields_are_views_one_after_the_other_those_of_the_base_first() -> None:
    values = np.arange(14.0)
    bench = Bench(values)
    assert bench.stiffness == 0.0
    assert bench.rest.tolist() == [1.0, 2.0, 3.0]
    assert bench.turns.tolist() == [[4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]
    assert (bench.other.stiffness, bench.other.rest.tolist()) == (10.0, [11.0, 12.0, 13.0])
    bench.stiffness = -1.0
    bench.turns[1, 2] = -2.0
    bench.other.rest[0] = -3.0
    assert [values[i] for i in (0, 9, 11)] == [-1.0, -2.0, -3.0]


def test_a_record_of_a_longer_array_has_its_own_numbers_only() -> None:
    assert Spring(np.arange(9.0)).values.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_a_record_of_its_own_is_zero_and_of_its_kind_of_numbers() -> None:
    assert Bench().values.tolist() == [0.0] * 14
    plan = Plan()
    assert plan.values.dtype == np.int64
    plan.steps = 3
    assert plan.steps == 3


def test_the_layout_has_the_same_places_and_quantities() -> None:
    assert dict(Bench.layout) == {"stiffness": 1, "rest": 3, "turns": 6, "other": 4}
    assert Bench.layout.slice("rest", "turns") == slice(1, 10)
    quantities = list(Bench.layout.quantities())
    assert quantities[:4] == quantities[10:] == ["stiffness", *["position"] * 3]
