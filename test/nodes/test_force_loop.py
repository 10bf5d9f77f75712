"""Commands corrected by what the hand has done since: which samples, which gains, how long."""

import numpy as np
import pytest

from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.nodes.force_loop import FRESH_NS, REMEMBERED, ForceLoop
from hapticmech_ros.wire.layouts import pack_gain

GAIN = np.diag([2.0, 0.0, 0.0, 0.0, 0.0, 3.0])
COMMAND = np.full(6, 0.5)


def filled(samples, lockstep=False):
    """Return a loop that has measured F_h = k at each stamp k, and was given G at time 0."""
    loop = ForceLoop()
    for stamp in range(samples):
        loop.measured(np.full(6, float(stamp)), stamp)
    loop.take(pack_gain(GAIN, 7), 0, lockstep)
    return loop


def test_a_command_is_corrected_by_what_has_changed_since_its_sample():
    found = filled(10).correct(COMMAND, 6, 100)
    assert found.tolist() == [0.5 + 2.0 * 3.0, 0.5, 0.5, 0.5, 0.5, 0.5 + 3.0 * 3.0]
    # The newest sample's own answer needs nothing.
    assert filled(10).correct(COMMAND, 9, 100).tolist() == COMMAND.tolist()


def test_without_gain_or_with_an_old_one_nothing_is_corrected():
    loop = ForceLoop()
    loop.measured(np.ones(6), 1)
    assert loop.correct(COMMAND, 1, 5) is COMMAND
    assert filled(10).correct(COMMAND, 6, FRESH_NS + 1) is COMMAND
    forgetful = filled(10)
    forgetful.forget()
    assert forgetful.correct(COMMAND, 6, 100) is COMMAND


def test_samples_that_were_never_measured_or_long_ago_are_no_ground():
    assert filled(10).correct(COMMAND, 12345, 100) is COMMAND
    many = filled(REMEMBERED + 10)
    assert many.correct(COMMAND, 9, 100) is COMMAND
    assert many.correct(COMMAND, 10, 100) is not COMMAND


def test_what_is_measured_may_be_overwritten():
    loop, wrench = ForceLoop(), np.zeros(6)
    for stamp in range(3):
        wrench[:] = stamp
        loop.measured(wrench, stamp)
    loop.take(pack_gain(GAIN, 0), 0, lockstep=False)
    assert loop.correct(COMMAND, 0, 1)[0] == 0.5 + 2.0 * 2.0


def test_in_lockstep_the_gain_of_the_same_sample_counts():
    loop = filled(10, lockstep=True)
    loop.take(pack_gain(2.0 * GAIN, 8), 0, lockstep=True)
    assert loop.correct_in_lockstep(COMMAND, 7)[0] == 0.5 + 2.0 * 2.0
    assert loop.correct_in_lockstep(COMMAND, 8)[0] == 0.5 + 4.0 * 1.0


@pytest.mark.parametrize("data", [np.zeros(37), np.full(38, np.nan)])
def test_gains_that_are_none_are_refused(data):
    with pytest.raises(InvalidInputError, match="gain message"):
        ForceLoop().take(data, 0, lockstep=False)
