# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the campaign of messages measures: time, memory and force; each can break its limit."""

from __future__ import annotations

import time

import numpy as np
import pytest

from benchmarks.reliability import messages
from benchmarks.reliability.memory_growth import SAMPLES, MemoryGrowth, worst_growth
from benchmarks.reliability.messages import Trial
from benchmarks.reliability.outputs import Outputs
from hapticmech_ros.loading import load_scene


def test_a_tick_that_takes_long_is_the_longest_also_while_the_graph_is_looked_at(monkeypatch):
    monkeypatch.setattr(messages, "SETTLED_S", 1.0)
    trial = Trial("five_bar", 1)
    pauses = [0.3]
    trial.graph.tick = lambda: time.sleep(pauses.pop() if pauses else 0.0)
    trial.longest_s = 0.0
    trial._look()
    assert trial.longest_s >= 0.3
    pauses, trial.longest_s = [0.4], 0.0
    trial.send(8)
    assert trial.longest_s >= 0.4


def kept_of_each(count, leak, start=0.0):
    """Return the memory of a process that keeps so many bytes of each message."""
    memory = MemoryGrowth()
    for sent in range(0, count + 1, count // SAMPLES):
        # What comes and goes, and what is taken once.
        wave = 2e6 * (sent // (count // SAMPLES) % 3 == 0)
        memory.add(sent, 2e8 + min(start, 10.0 * start * sent / count) + wave + leak * sent)
    return memory


@pytest.mark.parametrize(
    ("leak", "kept"), [(0.0, True), (14.0, True), (18.0, False), (75.0, False)]
)
def test_growth_by_16_bytes_of_each_message_breaks_the_limit(leak, kept):
    # One scene's share of a million.
    memory = kept_of_each(333_000, leak, start=5e7)
    assert memory.mebi == pytest.approx(leak * 0.75 * 333_000 / 2**20, rel=0.03, abs=1e-6)
    found = worst_growth("somewhere", [kept_of_each(333_000, 0.0), memory], 333_000)
    assert found.kept == kept


def test_force_beyond_its_limit_or_none_at_all_is_seen():
    def figures(renders, *forces):
        seen = Outputs(load_scene("five_bar").device)
        for force in forces:
            seen.look_at(np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0]))
        found = seen.figures("here", renders)
        return [one.name.removeprefix("here: ") for one in found if not one.kept]

    assert figures(True, 0.0, 0.0, 20.0) == []
    assert figures(True, 0.0, 5.0) == ["largest force, of the limit"]
    assert "share of samples with force" in figures(True, 20.0, *[0.0] * 5)
    assert "share of samples with force" in figures(True)
    assert figures(False, 0.0) == []
    for wrong in (20.001, -21.0, np.nan, np.inf):
        assert figures(True, 20.0, wrong) == ["samples beyond the force limit"]
