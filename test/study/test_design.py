# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which scenes a study is of."""

import math

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.study import Variation
from study.designs import of


def test_a_grid_has_every_combination_once_the_last_key_fastest():
    design = of("a=1:2:2", "b=x,y,z")
    assert len(design) == 6
    found = [design.values(index) for index in range(6)]
    assert found == [(a, b) for a in ("1.0", "2.0") for b in "xyz"]
    assert design.changes(4) == ("a=2.0", "b=y")


def test_a_range_has_its_ends_to_the_bit_and_is_spread_as_asked():
    linear, spread = Variation.read("m=0.1:0.7:4"), Variation.read("m=0.1:0.7:4:log")
    values = np.array([float(one) for one in linear.choices])
    assert [values[0], values[-1]] == [0.1, 0.7]
    assert np.abs(np.diff(values) - 0.2).max() < 1e-15
    logs = np.log([float(one) for one in spread.choices])
    assert [spread.choices[0], spread.choices[-1]] == ["0.1", "0.7"]
    assert np.abs(np.diff(logs, 2)).max() < 1e-14


@pytest.mark.parametrize(
    ("text", "choices"),
    [
        ("gravity=[0, 0, -9.81],[0, 0, 0]", ("[0, 0, -9.81]", "[0, 0, 0]")),
        ("controller.passivity.control=true,false", ("true", "false")),
        ("model=a.urdf,{file: b.urdf}", ("a.urdf", "{file: b.urdf}")),
        ("a=1", ("1",)),
    ],
)
def test_values_may_be_anything_of_yaml(text, choices):
    assert Variation.read(text).choices == choices
    assert len(of(text)) == len(choices)


def test_ends_may_be_angles():
    assert Variation.read("q=-90 deg:pi/2:3").range == (-math.pi / 2, math.pi / 2)


def test_several_keys_get_the_same_value():
    design = of("links[0].inertial.mass, links[2].inertial.mass=0.1:0.2:2")
    assert design.changes(1) == ("links[0].inertial.mass=0.2", "links[2].inertial.mass=0.2")


@pytest.mark.parametrize("samples", [7, 100])
def test_a_latin_hypercube_has_one_value_in_each_slice_of_each_range(samples):
    design = of("a=-1:3", "b=0.01:100:log", samples=samples, seed=3)
    assert len(design) == samples
    values = np.array([[float(v) for v in design.values(k)] for k in range(samples)])
    shares = np.stack([(values[:, 0] + 1) / 4, np.log10(values[:, 1] / 0.01) / 4])
    for row in shares:
        assert sorted(np.floor(row * samples).astype(int)) == list(range(samples))
    again = of("a=-1:3", "b=0.01:100:log", samples=samples, seed=3)
    assert [again.values(k) for k in range(samples)] == [design.values(k) for k in range(samples)]
    other = of("a=-1:3", "b=0.01:100:log", samples=samples, seed=4)
    assert other.values(0) != design.values(0)


def test_choices_of_a_latin_hypercube_come_equally_often():
    design = of("a=x,y", "b=0:1", samples=10)
    first = [design.values(k)[0] for k in range(10)]
    assert first.count("x") == first.count("y") == 5


@pytest.mark.parametrize(
    "text",
    [
        "mass",
        "mass=",
        "=1:2:3",
        "a,,b=1:2:3",
        "a=1:two:3",
        "a=1:2:0",
        "a=1:2:-3",
        "a=1:2:2.5",
        "a=1:2:3:4",
        "a=1:2:3:lin",
        "a=1,,2",
        "a=[1,2",
        "a=nan:1:2",
        "a=0:1:3:log",
        "a=1:inf:3",
        "a=1:2:100000000",
    ],
)
def test_what_is_no_variation_is_refused_with_its_text(text):
    with pytest.raises(InvalidInputError, match=r"must be|not"):
        of(text)


@pytest.mark.parametrize(
    ("texts", "more", "rule"),
    [
        ((), {}, "at least one"),
        (("a=1,2", "b, a=1,2"), {}, "a key varies once"),
        (("a=1:2",), {}, "FROM:TO:NUMBER, or set the number of samples"),
        (("a=1:2:4000", "b=1:2:4000"), {}, "10000000 or fewer"),
        (("a=1:2",), {"samples": -1}, "samples"),
    ],
)
def test_a_design_says_what_is_wrong_with_it(texts, more, rule):
    with pytest.raises(InvalidInputError, match=rule):
        of(*texts, **more)
