# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Records: arrays whose fields have names, in Python and compiled."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from commands import printed_by
from hapticmech_ros.compilation import local, put
from hapticmech_ros.compilation.records import Nested, Number, Record, Vector, Whole, matrix
from hapticmech_ros.numerics import Array


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


def test_a_record_has_no_more_than_its_own_numbers() -> None:
    values = np.arange(20.0)
    assert Spring(Bench(values).values).values.tolist() == [0.0, 1.0, 2.0, 3.0]


def write(bench: Bench, given: Array) -> None:
    """Write fields that are not read afterwards, of an argument and of a record on the stack."""
    other, room = bench.other, local(3)
    put(room, given)
    own = Spring(local(4))
    for i in range(3):
        other.rest[i] = 2.0 * room[i]
        own.rest[i] = 3.0 * room[i]
    bench.stiffness = own.rest[1]


def compiled() -> None:
    """Print what the same function leaves when Numba has translated it."""
    from hapticmech_ros.compilation.numba_types import numba, teach_record, translated

    for kind in (Spring, Bench):
        teach_record(kind)
    inner = translated(write)
    bench = Bench()
    numba.njit(lambda values, given: inner(Bench(values), given))(bench.values, np.arange(1.0, 4.0))
    sys.stdout.write(json.dumps(bench.values.tolist()))


def test_what_kernels_write_to_fields_is_written() -> None:
    bench = Bench()
    write(bench, np.arange(1.0, 4.0))
    assert bench.values[[0, 11, 12, 13]].tolist() == [6.0, 2.0, 4.0, 6.0]
    program = "import test_records; test_records.compiled()"
    printed = printed_by("-c", program, cwd=Path(__file__).parent)
    assert json.loads(printed) == bench.values.tolist()


def test_a_field_is_written_whole_or_not_at_all() -> None:
    spring = Spring()
    spring.rest = np.array((1.0, 2.0, 3.0))  # type: ignore[assignment]
    assert spring.values.tolist() == [0.0, 1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match="cannot reshape"):
        spring.fill(rest=0.0)
    with pytest.raises(KeyError):
        spring.fill(rust=0.0)
