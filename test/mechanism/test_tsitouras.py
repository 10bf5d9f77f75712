# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of Tsitouras' rule: the conditions of order 5, one for each rooted tree."""

from __future__ import annotations

from collections.abc import Iterator
from math import prod

import numpy as np
import pytest

from hapticmech_ros.mechanism.schemes import TSITOURAS_REACHED, TSITOURAS_WEIGHTS

Tree = tuple  # of its root's subtrees, sorted


def trees(size: int) -> Iterator[Tree]:
    """Yield the rooted trees of a size, each once."""
    yield from {tuple(sorted(one)) for one in _forests(size - 1)}


def _forests(size: int) -> Iterator[tuple[Tree, ...]]:
    """Yield multisets of trees of a size in all, in any order."""
    if size == 0:
        yield ()
    for first in range(1, size + 1):
        for tree in trees(first):
            for rest in _forests(size - first):
                yield (tree, *rest)


def order(tree: Tree) -> int:
    return 1 + sum(map(order, tree))


def density(tree: Tree) -> int:
    """Return γ: the order, times the densities of the subtrees."""
    return order(tree) * prod(map(density, tree))


def reached(tree: Tree, table: np.ndarray) -> np.ndarray:
    """Return the elementary weights of a tree's stages (6,)."""
    return prod((table @ reached(one, table) for one in tree), start=np.ones(len(table)))


ALL = [tree for size in range(1, 6) for tree in trees(size)]


@pytest.mark.parametrize("tree", ALL, ids=str)
def test_a_condition_of_order_5_holds(tree):
    found = TSITOURAS_WEIGHTS @ reached(tree, TSITOURAS_REACHED)
    # The published table has 16 digits, of numbers up to 13 that cancel.
    assert found == pytest.approx(1.0 / density(tree), abs=5e-14)


def test_its_leading_error_is_one_fifty_sixth_of_that_of_the_classical_rule():
    """Norms over the trees of the first order that is not met, of Hairer, Nørsett and Wanner."""

    def leading(table, weights, size):
        errors = [weights @ reached(tree, table) - 1.0 / density(tree) for tree in trees(size)]
        return np.linalg.norm(errors)

    classical = np.array([[0, 0, 0, 0], [0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 1.0, 0]])
    fourth = leading(classical, np.array([1, 2, 2, 1]) / 6.0, 5)
    assert fourth / leading(TSITOURAS_REACHED, TSITOURAS_WEIGHTS, 6) == pytest.approx(
        56.2, abs=0.05
    )


def test_stages_are_explicit():
    assert not np.triu(TSITOURAS_REACHED).any()
    assert TSITOURAS_REACHED.sum(axis=1)[-1] == pytest.approx(1.0, abs=1e-14)
