# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in order, samples' ages without common clocks, and answers to a device's samples."""

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.loading import load_scene
from hapticmech_ros.nodes import inputs
from hapticmech_ros.nodes.controller_ports import DevicePath
from hapticmech_ros.nodes.inputs import FORGET_NS, InOrder, Latest, SampleAge
from hapticmech_ros.nodes.local_loop import FRESH_NS, Answers, LocalLoop
from hapticmech_ros.wire.messages import DeviceStateMessage, LocalFeedbackGain
from nodes.stand_ins import MS

S = 1000 * MS


def test_what_a_newer_message_has_overtaken_is_dropped_and_counted():
    order = InOrder()
    found = [order.is_next(stamp * MS, 100 * MS) for stamp in (1, 3, 2, 3, 4, 1)]
    assert found == [True, True, False, True, True, False]
    assert order.overtaken == 2


def test_a_sender_that_began_anew_is_heard_after_a_pause():
    order = InOrder()
    assert order.is_next(900 * S, 5 * S)
    assert not order.is_next(2 * S, 5 * S + FORGET_NS)
    assert order.is_next(2 * S, 5 * S + FORGET_NS + 1)
    assert order.is_next(2 * S + MS, 5 * S + FORGET_NS + MS)


def test_a_message_without_stamp_is_taken_as_it_comes():
    order = InOrder()
    assert order.is_next(7 * S, 7 * S)
    # It says nothing of the order of those that have stamps.
    assert order.is_next(6 * S, 7 * S + MS)


def test_a_value_may_be_renewed_but_not_made():
    nothing: Latest[int] = Latest()
    nothing.renew(5)
    assert not nothing.fresh(5, 10)
    held = Latest(1, 5)
    held.renew(20)
    assert held.fresh(25, 10)


@pytest.fixture
def clock(monkeypatch):
    """A steady clock that the test sets, in ns."""
    now = [1000 * S]
    monkeypatch.setattr(inputs.time, "monotonic_ns", lambda: now[0])
    return now


@pytest.mark.parametrize("ahead", [-3600 * S, 0, 3600 * S])
def test_samples_are_judged_by_the_quickest_whatever_the_clocks_say(clock, ahead):
    ages = SampleAge()
    for _ in range(30_000):
        clock[0] += MS
        ages.check(clock[0] + ahead - 50 * MS, 250 * MS)
    ages.check(clock[0] + ahead - 50 * MS - 249 * MS + 250 * MS, 250 * MS)
    clock[0] += 500 * MS
    with pytest.raises(InvalidInputError, match="age of sample"):
        ages.check(clock[0] + ahead - 400 * MS, 250 * MS)


def test_a_device_whose_clock_was_set_back_is_judged_anew(clock):
    ages = SampleAge()
    ages.check(clock[0], 250 * MS)
    clock[0] += MS
    ages.check(clock[0] - 10 * S, 250 * MS)
    clock[0] += MS
    ages.check(clock[0] - 10 * S, 250 * MS)


def test_without_a_network_the_clock_of_the_host_counts():
    way, _ = path()
    assert way.received(reading(10 * S), 10 * S + 200 * MS, 250 * MS)
    for stamp in (10 * S + 10 * MS, 3600 * S):
        with pytest.raises(InvalidInputError, match="age of stamp"):
            way.received(reading(stamp), 10 * S + 300 * MS, 250 * MS)
    # What was refused is no newest one.
    assert way.received(reading(10 * S + 200 * MS), 10 * S + 300 * MS, 250 * MS)


def device(count, paired=False):
    loop = LocalLoop(1e-3, paired=paired)
    for number in range(count):
        loop.measured(np.zeros(19), number * MS)
    return loop, Answers(loop)


def obeys(answers, stamp_ns, now_ns, begins_ns=0):
    """Return whether the answer to a sample is obeyed."""
    answers.is_next(stamp_ns, now_ns)
    return answers.begin(answers.answered_ns, begins_ns)


def test_a_device_times_the_answers_to_its_own_samples():
    _, answers = device(200)
    assert answers.round_trip == 0.0
    for number in range(100):
        assert answers.is_next(number * MS, (number + 20) * MS)
    assert answers.round_trip == pytest.approx(0.02)
    # What answers no sample says nothing of the way.
    for number in range(400):
        answers.is_next(5 * S + number * MS, 6 * S + number * MS)
    assert answers.round_trip == pytest.approx(0.02)


def test_what_answers_a_sample_from_before_the_device_let_go_is_not_obeyed():
    _, answers = device(200)
    assert obeys(answers, 50 * MS, 80 * MS)
    answers.let_go(90 * MS)
    assert not answers.obeys
    for stamp in (60, 90):
        assert not obeys(answers, stamp * MS, (stamp + 40) * MS)
    answers.let_go(100 * MS)  # it does nothing anyway: the time of letting go stays
    assert obeys(answers, 91 * MS, 131 * MS)


def test_who_answers_no_sample_is_obeyed_again_at_once():
    _, answers = device(10)
    assert obeys(answers, 50 * MS + 7, 50 * MS + 8)
    answers.let_go(70 * MS)
    assert obeys(answers, 60 * MS + 7, 71 * MS)


def test_over_a_network_nothing_is_obeyed_that_lacks_its_correction():
    loop, answers = device(200, paired=True)
    assert not obeys(answers, 50 * MS, 60 * MS, 60 * MS)
    none = np.zeros(108)
    loop.take(
        LocalFeedbackGain.answering(50 * MS, 50 * MS, 0.0, none).values, 61 * MS, lockstep=False
    )
    assert answers.begin(answers.answered_ns, 62 * MS)
    assert answers.lost(62 * MS) == ""
    assert answers.lost(61 * MS + FRESH_NS + 1) == "local_feedback_gain is lost"
    # What answers no sample needs none: nobody closes a loop with it.
    answers.is_next(500 * MS + 7, 500 * MS + 8)
    assert answers.lost(61 * MS + FRESH_NS + 1) == ""


def reading(stamp, round_trip=0.0, obeys=True):
    return DeviceStateMessage.of(stamp, round_trip=round_trip, obeys=obeys)


def path(delay=0.0):
    said = []
    return DevicePath(load_scene("five_bar", 0.0, delay), said.append), said


def test_a_path_takes_what_the_newest_sample_tells():
    way, _ = path(0.01)
    assert way.paced
    assert way.received(reading(5 * MS, 0.03, obeys=False), S, S)
    assert not way.received(reading(4 * MS, 9.0), S, S)
    assert (way.round_trip, way.obeyed, way.overtaken) == (0.03, False, 1)
    assert not path()[0].paced


def test_answers_to_one_sample_have_stamps_of_their_own():
    way, _ = path(0.01)
    assert way.take() is None
    way.put(np.zeros(19), 7 * MS + 997)
    assert [way.take()[1] - 7 * MS for _ in range(4)] == [997, 998, 999, 999]
    way.put(np.ones(19), 8 * MS)
    sample, stamp = way.take()
    assert (sample[0], stamp) == (1.0, 8 * MS)


class Control:
    """What a path tunes."""

    aim = None

    def apply_gains(self, gains, delay):
        self.aim = gains, delay
        self.way = "at once"

    def tune(self, time, gains, delay):
        self.aim = gains, delay
        self.way = time


def test_a_longer_way_than_declared_is_said_and_softened_for():
    way, said = path()
    gains, control = load_scene("five_bar").controller, Control()
    way.received(reading(MS, 0.1), S, S)
    assert way.changed(1.0)
    way.tune(control, gains, soften=True, time=1.0)
    assert control.aim == (gains, 0.05)
    assert control.way == 1.0
    assert "takes 100 ms" in said[0]
    assert "reduced for a one-way delay of 50 ms" in said[0]
    figures = way.figures(gains, True, "")
    assert figures["loop_warning"] == said[0]
    assert figures["round_trip_ms"] == "100.0"
    # Forbidden: it is warned of, and gains stay as they are.
    way.tune(control, gains, soften=False, time=2.0)
    assert control.aim == (gains, 0.0)
    assert "gains are not reduced" in way.warning(gains, soften=False)


def test_a_way_as_declared_is_not_warned_of():
    way, said = path(0.05)
    gains, control = load_scene("five_bar").controller, Control()
    way.received(reading(MS, 0.118), S, S)
    assert not way.changed(1.0)
    way.tune(control, gains, soften=True, time=1.0)
    assert control.aim == (gains, 0.05)
    assert not said
    assert way.figures(gains, True, "of the scene")["loop_warning"] == "of the scene"
