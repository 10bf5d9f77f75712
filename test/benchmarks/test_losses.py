# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0

import numpy as np

from benchmarks.graph.recorded import Losses, delay, hop, losses, total

WINDOW = (1000, 2000)


def test_what_is_answered_and_what_is_lost_add_up() -> None:
    random = np.random.default_rng(5)
    for _ in range(20):
        asked = random.choice(3000, 400, replace=False).tolist()
        answers = random.choice(3000, 300, replace=False).tolist()
        found = losses(asked, answers, WINDOW)
        assert 0 <= found.answered <= found.asked
        assert found.answered + found.lost == found.asked
        within = [stamp for stamp in answers if WINDOW[0] <= stamp < WINDOW[1]]
        assert found.answered + found.strays == len(within)


def test_each_lost_answer_is_told_and_said_twice_counts_once() -> None:
    asked = range(1000, 2000, 10)
    whole = losses(asked, asked, WINDOW)
    assert whole == Losses(100, 100, 0)
    assert whole.lost == 0
    without = [stamp for stamp in asked if stamp not in (1000, 1500, 1990)]
    assert losses(asked, [*without, *without], WINDOW).lost == 3


def test_an_answer_to_what_is_not_there_is_the_recorders_loss() -> None:
    asked = [stamp for stamp in range(1000, 2000, 10) if stamp != 1500]
    assert losses(asked, range(1000, 2000, 10), WINDOW) == Losses(99, 99, 1)


def test_only_the_window_counts() -> None:
    assert losses([999, 1000, 1999, 2000], [1000], WINDOW) == Losses(2, 1, 0)


def test_totals_add_up() -> None:
    parts = [Losses(10, 9, 1), Losses(20, 15, 0)]
    assert total(parts) == Losses(30, 24, 1)
    assert total(parts).lost == sum(part.lost for part in parts)
    assert total([]) == Losses(0, 0, 0)


def test_hops_of_one_message_add_up_to_its_delay() -> None:
    stamp, sample_us, answer_us = 1_500_000, 300.0, 450.0
    before = {stamp: stamp + round(1000 * sample_us)}
    after = {stamp: stamp + round(1000 * (sample_us + answer_us))}
    window = (1_000_000, 2_000_000)
    first, second = delay(before, window), hop(before, after, window)
    whole = delay(after, window)
    assert first is not None
    assert second is not None
    assert whole is not None
    assert (first.p50_us, second.p50_us) == (sample_us, answer_us)
    assert first.p50_us + second.p50_us == whole.p50_us


def test_what_was_lost_has_no_latency() -> None:
    assert hop({1500: 1600}, {}, WINDOW) is None
    assert delay({}, WINDOW) is None
