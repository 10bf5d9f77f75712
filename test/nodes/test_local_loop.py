# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Commands corrected by what the device has done since: which samples, which gains, how long."""

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.local_loop import FRESH_NS, REMEMBERED, WAITING, LocalLoop
from hapticmech_ros.nodes.teleoperation_controller import ZERO_AFTER_NS
from hapticmech_ros.wire.messages import LocalFeedbackGain

GAIN = np.diag([2.0, 0.0, 0.0, 0.0, 0.0, 3.0])
COMMAND = np.full(6, 0.5)
ONES = np.ones(108)
# Between samples.
PERIOD_NS = 1_000_000


def sample(push):
    """Return a device's sample at rest, pushed by ``push`` along all coordinates."""
    return np.concatenate((np.zeros(6), [1.0], np.zeros(6), np.full(6, float(push))))


def model(gain):
    """Return G, K and B as they are told, of a force gain alone."""
    return np.concatenate((gain.ravel(), np.zeros(72)))


def message(stamp, times=1.0, answered=None, energy=0.25):
    answered = stamp if answered is None else answered
    gain = model(times * GAIN)
    return LocalFeedbackGain.answering(stamp, answered * PERIOD_NS, energy, gain).values


def measured(numbers, periods=1, paired=False):
    """Return a loop of so long a period (ms) that has measured F_h = k at each of periods k."""
    loop = LocalLoop(1e-3 * periods, paired=paired)
    for number in numbers:
        loop.measured(sample(number), number * periods * PERIOD_NS)
    return loop


def filled(samples, lockstep=False):
    """Return a loop that has measured F_h = k at each period k, and was given G at time 0."""
    loop = measured(range(samples))
    loop.take(message(7), 0, lockstep)
    return loop


def corrected(command, times, periods):
    """Return the command along x after so many periods: F_h rises by 1, and goes on by a half."""
    return pytest.approx(command + times * 2.0 * (periods + 0.5), rel=1e-12)


def test_a_command_is_corrected_by_what_has_changed_since_its_sample():
    found = filled(10).correct(COMMAND, 6 * PERIOD_NS, 100)
    assert found[0] == corrected(0.5, 1.0, 3)
    assert found[1:5].tolist() == [0.5] * 4
    assert found[5] == pytest.approx(0.5 + 3.0 * 3.5, rel=1e-12)
    # The newest sample's own answer needs what the hand does until the next one.
    assert filled(10).correct(COMMAND, 9 * PERIOD_NS, 100)[0] == corrected(0.5, 1.0, 0)


def test_samples_that_a_busy_machine_left_out_are_carried_on_by_their_own_time():
    """F_h rises by 1 in each period, also where no sample tells so."""
    loop = measured((0, 1, 4, 6))
    loop.take(message(7), 0, lockstep=False)
    assert loop.correct(COMMAND, 1 * PERIOD_NS, 100)[0] == corrected(0.5, 1.0, 5)


def test_without_gain_or_with_an_old_one_nothing_is_corrected():
    loop = LocalLoop(1e-3)
    loop.measured(sample(1), 1)
    assert loop.correct(COMMAND, 1, 5) is COMMAND
    assert loop.to_mechanism is None
    assert filled(10).correct(COMMAND, 6 * PERIOD_NS, FRESH_NS + 1) is COMMAND
    forgetful = filled(10)
    assert forgetful.to_mechanism == 0.0
    forgetful.forget(8 * PERIOD_NS)
    assert forgetful.correct(COMMAND, 6 * PERIOD_NS, 100) is COMMAND
    assert forgetful.to_mechanism is None


def test_a_gain_for_a_sample_from_before_the_device_let_go_is_none():
    loop = filled(10)
    loop.forget(8 * PERIOD_NS)
    loop.take(message(11, answered=8), 100, lockstep=False)
    assert loop.correct(COMMAND, 6 * PERIOD_NS, 200) is COMMAND
    loop.take(message(12, answered=9), 100, lockstep=False)
    assert loop.correct(COMMAND, 6 * PERIOD_NS, 200)[0] == corrected(0.5, 1.0, 3)


def test_a_gain_that_a_newer_one_has_overtaken_is_dropped():
    loop = filled(10)
    loop.take(message(9, 2.0), 100, lockstep=False)
    loop.take(message(8, 5.0, energy=3.0), 200, lockstep=False)
    assert loop.correct(COMMAND, 8 * PERIOD_NS, 300)[0] == corrected(0.5, 2.0, 1)
    assert loop.order.overtaken == 1
    assert loop.to_mechanism == 0.0


def test_the_account_counts_from_when_the_device_obeys():
    loop = filled(10)
    loop.take(message(8, energy=5.0), 100, lockstep=False)
    loop.begin()
    assert loop.to_mechanism == 0.0
    loop.take(message(9, energy=5.5), 200, lockstep=False)
    assert loop.to_mechanism == 0.5
    # Another controller counts from 0: what was told before it is forgotten with letting go.
    loop.forget(9 * PERIOD_NS)
    loop.begin()
    loop.take(message(10, energy=0.25), 300, lockstep=False)
    assert loop.to_mechanism == 0.0
    loop.take(message(11, energy=0.0), 400, lockstep=False)
    assert loop.to_mechanism == -0.25


def gain_of(command, times):
    return message(command * PERIOD_NS, times, answered=command)


def test_over_a_network_a_command_is_corrected_by_its_own_gain():
    loop = measured(range(100), paired=True)
    loop.take(gain_of(90, 1.0), 0, lockstep=False)
    loop.take(gain_of(91, 5.0), 0, lockstep=False)
    assert loop.correct(COMMAND, 90 * PERIOD_NS, 100)[0] == corrected(0.5, 1.0, 9)
    # As long as it stands.
    assert loop.correct(COMMAND, 90 * PERIOD_NS, 200)[0] == corrected(0.5, 1.0, 9)
    assert loop.correct(2.0 * COMMAND, 91 * PERIOD_NS, 200)[0] == corrected(1.0, 5.0, 8)


def test_a_command_that_lost_its_gain_gives_way_to_the_last_that_has_one():
    loop = measured(range(100), paired=True)
    loop.take(gain_of(70, 1.0), 0, lockstep=False)
    assert loop.correct(COMMAND, 70 * PERIOD_NS, 100)[0] == corrected(0.5, 1.0, 29)
    assert loop.correct(9.0 * COMMAND, 90 * PERIOD_NS, 100)[0] == corrected(0.5, 1.0, 29)
    # Not for ever: then by the newest gain.
    assert loop.correct(9.0 * COMMAND, 91 * PERIOD_NS, 100)[0] == corrected(4.5, 1.0, 8)
    # A gain that comes after its command still belongs to it.
    loop.take(gain_of(91, 3.0), 100, lockstep=False)
    assert loop.correct(9.0 * COMMAND, 91 * PERIOD_NS, 200)[0] == corrected(4.5, 3.0, 8)
    loop.forget(91 * PERIOD_NS)
    assert loop.correct(COMMAND, 91 * PERIOD_NS, 300) is COMMAND


def test_a_slow_loop_waits_as_many_periods_for_a_command_with_its_gain():
    loop = measured(range(100), periods=4, paired=True)
    loop.take(message(70 * 4 * PERIOD_NS, answered=70 * 4), 0, lockstep=False)
    obeyed = loop.correct(COMMAND, 70 * 4 * PERIOD_NS, 100)[0]
    assert loop.correct(9.0 * COMMAND, 90 * 4 * PERIOD_NS, 100)[0] == obeyed
    assert loop.correct(9.0 * COMMAND, 91 * 4 * PERIOD_NS, 100)[0] != obeyed


def test_gains_that_wait_for_lost_commands_are_forgotten():
    loop = measured(range(100), paired=True)
    for number in range(1000, 1000 + 3 * WAITING):
        loop.take(gain_of(number, 1.0), 0, lockstep=False)
    assert len(loop._unpaired) == WAITING


def test_answers_to_one_sample_may_be_told_apart_by_nanoseconds():
    assert filled(10).correct(COMMAND, 6 * PERIOD_NS + 999, 100)[0] == corrected(0.5, 1.0, 3)


def test_samples_that_were_never_measured_or_long_ago_are_no_ground():
    assert filled(10).correct(COMMAND, 12345, 100) is COMMAND
    many = filled(REMEMBERED + 10)
    assert many.correct(COMMAND, 9 * PERIOD_NS, 100) is COMMAND
    assert many.correct(COMMAND, 10 * PERIOD_NS, 100) is not COMMAND


def test_what_is_measured_may_be_overwritten():
    loop, numbers = LocalLoop(1e-3), sample(0)
    for number in range(3):
        numbers[13:] = number
        loop.measured(numbers, number * PERIOD_NS)
    loop.take(message(0), 0, lockstep=False)
    assert loop.correct(COMMAND, 0, 1)[0] == corrected(0.5, 1.0, 2)


def test_in_lockstep_the_gain_of_the_same_command_counts_and_names_its_sample():
    loop = filled(10, lockstep=True)
    loop.take(message(8, 2.0, answered=5, energy=0.5), 0, lockstep=True)
    assert loop.correct_in_lockstep(COMMAND, 7)[0] == corrected(0.5, 1.0, 2)
    assert loop.to_mechanism == 0.25
    assert loop.correct_in_lockstep(COMMAND, 8)[0] == corrected(0.5, 2.0, 4)
    assert loop.to_mechanism == 0.5


@pytest.mark.parametrize("data", [np.zeros(112), np.full(113, np.nan)])
def test_gains_that_are_none_are_refused(data):
    with pytest.raises(InvalidInputError, match="gain message"):
        LocalLoop(1e-3).take(data, 0, lockstep=False)


@pytest.mark.parametrize("which", ["stamp_ns", "answered_ns"])
@pytest.mark.parametrize("sign", [-1, 1], ids=["old", "future"])
def test_a_gain_whose_stamps_are_too_far_from_now_is_refused(which, sign):
    loop, limit, now = filled(10), 20 * PERIOD_NS, 100 * PERIOD_NS
    stamps = {"stamp_ns": now, "answered_ns": now}
    just = LocalFeedbackGain.answering(
        **{**stamps, which: now + sign * limit}, to_mechanism=0.5, model=ONES
    )
    beyond = LocalFeedbackGain.answering(
        **{**stamps, which: now + sign * (limit + 1)}, to_mechanism=9.0, model=ONES
    )
    loop.take(just.values, now, False, limit)
    with pytest.raises(InvalidInputError, match="age of stamp"):
        loop.take(beyond.values, now, False, limit)
    # Nothing of it is taken, and nothing counts as overtaken by it.
    assert loop.to_mechanism == 0.25
    just.to_mechanism = 0.75
    loop.take(just.values, now, False, limit)
    assert (loop.to_mechanism, loop.order.overtaken) == (0.5, 0)


@pytest.mark.parametrize("paired", [False, True])
def test_a_last_zero_is_obeyed_as_it_is_whatever_gain_stands(paired):
    loop = measured(range(10), paired=paired)
    answered = 6 * PERIOD_NS
    loop.take(LocalFeedbackGain.answering(answered, answered, 0.0, model(GAIN)).values, 0, False)
    assert loop.correct(COMMAND, answered, 100)[0] == corrected(0.5, 1.0, 3)
    # As the controller stamps it: after its last answer, with no sample at that time.
    zero = loop.correct(np.zeros(6), answered + ZERO_AFTER_NS, 100)
    assert not zero.any()
