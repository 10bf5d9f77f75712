# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Samples of sweeps: never empty, the same every time, and whole when all is asked for."""

import pytest

import sampling
from sampling import sampled


@pytest.mark.parametrize("count", [1, 2, 5, 12])
def test_a_sample_is_a_part_that_depends_on_what_it_is_of(monkeypatch, count):
    monkeypatch.setattr(sampling, "LONG", False)
    found = [sampled(range(count), of) for of in "abcdefghijklmnopqrst"]
    assert found == [sampled(range(count), of) for of in "abcdefghijklmnopqrst"]
    assert {len(one) for one in found} <= {max(count // 5, 1), -(-count // 5)}
    assert {case for one in found for case in one} == set(range(count))


def test_all_cases_are_tested_if_asked_for(monkeypatch):
    monkeypatch.setattr(sampling, "LONG", True)
    assert sampled(range(12), "a") == list(range(12))


def test_the_option_asks_for_all(request):
    assert sampling.LONG is request.config.getoption("--long")
