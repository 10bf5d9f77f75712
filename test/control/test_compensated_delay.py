# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How late a loop is: what the mechanism does by itself, and what it learns of the hand."""

import pytest

from hapticmech_ros import load_scene
from hapticmech_ros.analysis.scene_variants import with_loop
from hapticmech_ros.control.loop_delay import compensated_loop_delay, periods_before
from hapticmech_ros.errors import InvalidInputError


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_a_device_that_corrects_commands_is_ahead_of_the_mechanism_by_the_delay(delay):
    scene = load_scene("five_bar")
    period = scene.simulation.period
    with_it, without = (
        compensated_loop_delay(with_loop(scene, local), delay) for local in (True, False)
    )
    # Half a period for the hold of what acts, and of what the mechanism learns of the hand.
    assert without == (delay + 0.5) * period
    assert with_it == pytest.approx(2.0 * without, abs=1e-15)


def test_a_negative_delay_is_refused():
    with pytest.raises(InvalidInputError, match="0 or more periods"):
        compensated_loop_delay(load_scene("five_bar"), -1)


@pytest.mark.parametrize(
    ("delay", "local", "periods"), [(0, False, 1), (1, False, 2), (1, True, 3)]
)
def test_past_rates_are_of_as_many_periods_ago_as_the_delay_has(delay, local, periods):
    scene = with_loop(load_scene("five_bar"), local)
    assert periods_before(scene, delay) == periods
    assert periods_before(scene.with_(connection={"expected": 0.05}), delay) == 0
