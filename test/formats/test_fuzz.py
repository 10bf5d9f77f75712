# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Mutants of good files: each loads and evaluates to finite numbers, or is refused in our words."""

from __future__ import annotations

import re

import numpy as np
import pytest

from formats.children import outcomes
from formats.five_bars import PIN, REST, mjcf, sdf, urdf
from formats.test_mjcf import EQUALITIES, INERTIAL, LOOPS, TREES
from formats.test_sdf_gears import GEARS
from formats.test_sdf_nested import NESTED
from formats.test_urdf import random_urdf
from formats.test_urdf_mimic import MIMICS
from sampling import sampled

MUTANTS = len(sampled(range(200), every=8))
SIDECAR = f"""{REST}{PIN}
springs: [{{name: s, a: {{link: world}}, b: {{link: link3}}, stiffness: 10.0}}]
initial_state: {{q: {{joint1: 0.1, joint4: 0.2}}, v: {{joint2: 0.1}}}}
model:
  file: five_bar.urdf
  base: fixed
  joints:
    joint1: {{damping: 0.1, limits: {{lower: -1.0, upper: 2.0, stiffness: 50.0}}}}
    joint2: {{friction: 0.1, locked: false}}
    joint3: {{limits: null}}
"""
LOOP = LOOPS.format(inertial=INERTIAL, equality="".join(EQUALITIES.values()))
SEEDS = {
    "urdf": [urdf(), *(random_urdf(seed)[0] for seed in range(3)), MIMICS],
    "xml": [
        mjcf(),
        *(f"<mujoco>{text}</mujoco>" for text in (LOOP, TREES["ref"], TREES["classes"])),
        *(f"<mujoco>{TREES[name]}</mujoco>" for name in ("frames", "several joints", "shapes")),
    ],
    "sdf": [
        sdf(),
        sdf().replace('type="revolute"', 'type="ball"', 1),
        *(f"<sdf><model name='m'>{''.join(parts)}</model></sdf>" for parts in (NESTED, GEARS)),
    ],
    "yaml": [SIDECAR],
}
NUMBERS = ("0", "-1", "1e30", "-1e30", "1e-30", "nan", "inf", "1e999", "", "x", "0 0 0", "9" * 400)
IN_YAML = (
    "0.0",
    "-1.0",
    "1.0",
    "0.01",
    "2.5",
    "-0.3",
    "1.0e+30",
    "1.0e+308",
    "-1.0e-30",
    ".nan",
    ".inf",
    "",
    "x",
    "[]",
    "{}",
    "~",
    "[1.0]",
)


def mutated(text, rng, numbers):
    """Return the text with a change or two: of bytes, of numbers, of words, of whole elements."""
    data = text
    for _ in range(int(rng.integers(1, 3))):
        at, to = sorted(int(x) for x in rng.integers(0, len(data) + 1, size=2))
        to = min(to, at + int(rng.integers(1, 200)))
        # A scene file bears less: most changes of bytes leave no YAML.
        choice = int(rng.integers(0, 6)) if "<" in data else int(rng.choice((0, 1, 3, 3, 3, 4, 5)))
        if choice == 0:
            data = data[:at] + chr(int(rng.integers(1, 0x2FF))) + data[at + 1 :]
        elif choice == 1:
            data = data[:at] + data[to:]
        elif choice == 2:
            data = data[:to] + data[at:to] + data[to:]
        else:
            data = changed(data, rng, numbers, choice)
    return data


def changed(data, rng, numbers, choice):
    """Return the text with one number, word in quotes or whole element replaced."""
    pattern = {
        3: r"(?<![\w.])-?\d+\.?\d*(e-?\d+)?",
        4: r'"[^"]*"' if "<" in data else r"\b\w+\b",
        5: r"<(\w+)[^<>]*/>" if "<" in data else r"\{[^{}]*\}",
    }[choice]
    found = list(re.finditer(pattern, data))
    if not found:
        return data
    one, other = (found[int(k)] for k in rng.integers(0, len(found), size=2))
    value = {3: str(rng.choice(numbers)), 4: other[0], 5: other[0] * int(rng.integers(0, 3))}
    return data[: one.start()] + value[choice] + data[one.end() :]


@pytest.mark.parametrize("kind", SEEDS)
def test_mutants_load_or_are_refused(tmp_path, kind):
    rng = np.random.default_rng(7)
    (tmp_path / "five_bar.urdf").write_text(urdf())
    paths = []
    for number in range(MUTANTS):
        text = SEEDS[kind][number % len(SEEDS[kind])]
        if number >= len(SEEDS[kind]):  # those themselves come first
            text = mutated(text, rng, IN_YAML if kind == "yaml" else NUMBERS)
        paths.append(tmp_path / f"{number}.{kind}")
        paths[-1].write_text(text, encoding="utf-8")
    found = outcomes(paths, evaluated=True)
    bugs = [(p.name, one) for p, one in zip(paths, found, strict=True) if one.startswith("bug")]
    assert not bugs
    loaded = found.count("loads")
    assert 0.05 * MUTANTS < loaded < 0.9 * MUTANTS, "mutants that are all alike test nothing"
