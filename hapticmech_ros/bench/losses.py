"""Messages that were lost, told by stamps: an answer carries the stamp of what it answers."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from hapticmech_ros.bench.percentiles import Percentiles, percentiles_of


@dataclass(frozen=True, slots=True)
class Losses:
    """Questions and answers of one node within a window, in a bag.

    Attributes:
        asked: messages that were to be answered.
        answered: those whose answer is there.
        strays: answers to messages that are not there: the recorder lost those, not the node.
    """

    asked: int
    answered: int
    strays: int

    @property
    def lost(self) -> int:
        """Messages without an answer."""
        return self.asked - self.answered


def losses(asked: Collection[int], answers: Collection[int], window: tuple[int, int]) -> Losses:
    """Return what was lost between stamps of ``window``, first included and last not.

    Args:
        asked: stamps of the messages to be answered, ns.
        answers: stamps of the answers, ns.
        window: ns; to end a little before recording does, or the last answers are missing.
    """
    first, last = window
    questions = {stamp for stamp in asked if first <= stamp < last}
    found = {stamp for stamp in answers if first <= stamp < last}
    return Losses(len(questions), len(questions & found), len(found - questions))


def total(parts: Collection[Losses]) -> Losses:
    """Return the sum of several."""
    return Losses(
        sum(part.asked for part in parts),
        sum(part.answered for part in parts),
        sum(part.strays for part in parts),
    )


def hop(
    before: Mapping[int, int], after: Mapping[int, int], window: tuple[int, int]
) -> Percentiles | None:
    """Return how much later messages came than those they answer.

    Args:
        before: stamp -> time of reception, ns.
        after: the same, of the answers.
        window: of stamps, ns.
    """
    first, last = window
    waits = [after[s] - time for s, time in before.items() if first <= s < last and s in after]
    return percentiles_of(np.array(waits, dtype=float) / 1000.0)


def delay(received: Mapping[int, int], window: tuple[int, int]) -> Percentiles | None:
    """Return how long after its stamp each message came.

    Args:
        received: stamp -> time of reception, ns.
        window: of stamps, ns.
    """
    return hop({stamp: stamp for stamp in received}, received, window)
