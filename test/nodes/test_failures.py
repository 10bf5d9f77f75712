# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What an actor does when something goes wrong: nothing escapes, it begins anew, or gives up."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from benchmarks.reliability.fake_graph import Log
from hapticmech_ros.errors import HapticMechError, InvalidInputError, OutputError
from hapticmech_ros.nodes.actor import CALM_S, MOST_DEFECTS, SILENCE_NS, Failures, LastValidState


class Bench:
    """Failures whose actor begins anew as often as it is told to."""

    def __init__(self, reset=None) -> None:
        self.log = Log()
        self.node = SimpleNamespace(active=True, end=self.end, get_logger=lambda: self.log)
        self.begun = self.ended = 0
        self.failures = Failures(self.node, reset or self.reset)

    def reset(self) -> None:
        self.begun += 1

    def end(self) -> None:
        self.ended += 1


@pytest.fixture
def bench():
    return Bench()


def raising(error):
    def call(*arguments):
        raise error

    return call


DEFECTS = [
    OverflowError("too large"),
    FloatingPointError("x"),
    ZeroDivisionError("x"),
    ValueError("x"),
    KeyError("x"),
    TypeError("x"),
    RuntimeError("x"),
    AssertionError("x"),
    MemoryError(),
    UnicodeDecodeError("utf-8", b"\xff", 0, 1, "x"),
]


@pytest.mark.parametrize("error", [*DEFECTS, OutputError("v", 1e9, "must be less")])
def test_nothing_escapes_and_the_actor_begins_anew(bench, error):
    bench.failures.run("tick", raising(error))
    assert (bench.failures.count, bench.begun, bench.node.active) == (1, 1, True)
    level, text = bench.log.lines[0]
    assert level == "error"
    if isinstance(error, HapticMechError):
        assert str(error) in text
        assert bench.failures.defects == 0
    else:
        assert type(error).__name__ in text
        # Where it was, for whoever mends it.
        assert "test_failures.py:" in text
        assert bench.failures.defects == 1


def test_what_goes_well_is_passed_through(bench):
    got = []
    bench.failures.run("tick", lambda *given: got.append(given), 1, "two")
    assert got == [(1, "two")]
    assert bench.failures.count == 0
    assert bench.log.lines == []


def test_who_keeps_on_meeting_a_defect_gives_up_and_is_deactivated(bench):
    for _ in range(MOST_DEFECTS - 1):
        bench.failures.run("tick", raising(TypeError("x")))
    assert bench.node.active
    bench.failures.run("tick", raising(TypeError("x")))
    assert not bench.node.active
    assert bench.ended == 1
    assert bench.begun == MOST_DEFECTS - 1
    assert bench.log.lines[-1][0] == "fatal"
    assert "deactivates itself" in bench.log.lines[-1][1]


def test_what_was_foreseen_may_come_as_often_as_its_cause_does(bench):
    for _ in range(10 * MOST_DEFECTS):
        bench.failures.run("tick", raising(OutputError("v", 1e9, "must be less")))
    assert bench.node.active
    assert bench.begun == bench.failures.count == 10 * MOST_DEFECTS
    # Said once in a while, not with every one.
    assert len(bench.log.lines) == 1


def test_who_cannot_begin_anew_gives_up():
    bench = Bench(reset=raising(OverflowError("again")))
    bench.failures.run("tick", raising(OutputError("v", 1e9, "must be less")))
    assert not bench.node.active
    assert bench.ended == 1
    assert "cannot begin anew: OverflowError: 'again'" in bench.failures.last


def test_a_node_that_cannot_even_be_deactivated_does_nothing_more():
    bench = Bench(reset=raising(OverflowError("again")))
    bench.node.end = raising(RuntimeError("end"))
    bench.failures.run("tick", raising(TypeError("x")))
    assert not bench.node.active


def test_who_waits_for_an_answer_is_told(bench):

    def answer(call):
        response = bench.failures.answer("closure", call, SimpleNamespace(), "done")
        return response.success, response.message

    refused, message = answer(raising(InvalidInputError("d", 1.0, "must be near")))
    assert not refused
    assert "must be near" in message
    assert bench.failures.count == bench.begun == 0
    # What cannot leave the node is no refusal, and neither is a defect.
    for number, error in enumerate((OutputError("v", 1e9, "must be less"), ValueError("x")), 1):
        done, message = answer(raising(error))
        assert not done
        assert message == bench.failures.last
        assert str(error) in message
        assert bench.failures.count == bench.begun == number
    assert answer(lambda: None) == (True, "done")


def test_a_status_tells_of_failures_and_cannot_fail_itself(bench):
    assert bench.failures.status(lambda: (True, "well", {"a": "1"})) == (
        True,
        "well",
        {"a": "1", "failures": "0", "last_failure": ""},
    )
    well, sentence, figures = bench.failures.status(raising(ValueError("none")))
    assert not well
    assert "status: ValueError: 'none'" in sentence
    assert figures["failures"] == "1"


def test_one_goes_back_to_what_was_well_and_from_there_to_the_start():
    last_valid = LastValidState("start", CALM_S / 10)
    assert last_valid.go_back(0) == "start"
    for tick in range(10):
        last_valid.keep(tick)
    assert last_valid.go_back(0) == 9
    for tick in range(10, 19):
        last_valid.keep(tick)
    # Too soon: where it went back to leads nowhere.
    assert last_valid.go_back(0) == "start"
    for tick in range(20, 30):
        last_valid.keep(tick)
    assert last_valid.go_back(0) == 29


def test_one_is_silent_for_all_to_notice_and_then_begins_once():
    last_valid, begun = LastValidState("start", 0.001), []
    assert not last_valid.rests(5, lambda: begun.append(1))
    last_valid.go_back(100)
    assert last_valid.rests(100, lambda: begun.append(1))
    assert last_valid.rests(99 + SILENCE_NS, lambda: begun.append(1))
    assert last_valid.resting
    assert begun == []
    assert not last_valid.rests(100 + SILENCE_NS, lambda: begun.append(1))
    assert not last_valid.rests(101 + SILENCE_NS, lambda: begun.append(1))
    assert begun == [1]
    # A clock that goes back does not make it wait for ever.
    last_valid.go_back(10 * SILENCE_NS)
    assert not last_valid.rests(SILENCE_NS, lambda: begun.append(1))
    assert begun == [1, 1]
