# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Felt beside desired impedance: right where the device closes the force channel."""

import json

import numpy as np
import pytest

from commands import ran
from hapticmech_ros import load_scene
from hapticmech_ros.analysis.impedance import FREQUENCIES_HZ, Felt, felt
from hapticmech_ros.analysis.scene_variants import with_loop
from hapticmech_ros.errors import InvalidInputError
from sampling import only_long, sampled

# To 10 and to 30 Hz. Left of dampers is (ω τ / 2) (τ d / I) / (1 + τ d / I): d / I is 4, 34,
# 51 and 190 per s, τ 3 ms; and of the hand's wrench, 3/8 (ω T)³ (m / m_d - 1): the arm of 373 kg on
# a device of 0.3 kg.
ERRORS = {
    "five_bar": (0.005, 0.04),
    "door": (0.01, 0.025),
    "spatial_arm": (0.015, 0.05),
    "ur5e": (0.09, 0.9),
    "stewart_platform": (0.01, 0.03),
}
DIRECTIONS = {"five_bar": 2, "door": 1, "spatial_arm": 6, "ur5e": 6, "stewart_platform": 6}


@pytest.mark.parametrize("name", sampled(ERRORS, every=3))
def test_free_directions_feel_as_the_mechanism_does(name):
    found = felt(load_scene(name))
    assert len(found) == DIRECTIONS[name]
    for one in found:
        assert one.error(10.0) < ERRORS[name][0]
        assert one.error(30.0) < ERRORS[name][1]
        assert one.bandwidth == {103: 42.0, 373: 20.0}.get(round(one.mass), 85.0)


def test_closed_by_the_controller_a_heavy_mechanism_is_felt_wrong():
    errors = [one.error(10.0) for one in felt(with_loop(load_scene("five_bar"), local=False))]
    assert min(errors) > 0.5


@pytest.mark.parametrize(("delay", "error"), [(0, 0.005), (3, 0.012)])
def test_whatever_the_delay_the_device_corrects_it(delay, error):
    """What is left grows with the delay: 0.003 was found at one period, 0.010 at three."""
    for one in felt(load_scene("five_bar"), delay=delay):
        assert one.error(10.0) < error


def test_what_is_left_falls_with_the_period():
    """Second order and more: transparent in the limit, 0.1 % at 30 Hz at 4 kHz."""
    scene = load_scene("five_bar")
    periods = (1e-3, 5e-4, *only_long(2.5e-4))
    runs = [felt(scene.stepped(period=period)) for period in periods]
    for direction in range(2):
        errors = [run[direction].steady_error(10.0) for run in runs]
        assert (np.log2(np.divide(errors[:-1], errors[1:])) > 1.9).all()
        assert runs[-1][direction].error(30.0) < (0.001 if len(runs) == 3 else 0.0042)


def test_bandwidth_and_errors_of_a_ratio():
    frequencies = np.array(FREQUENCIES_HZ, dtype=float)
    ratio = np.ones(frequencies.size, dtype=complex)
    ratio[frequencies == 14.0] = 0.5
    one, right = np.eye(6)[0], np.ones(frequencies.size)

    def measured(values):
        model = {"predicted": right, "steady": 2.0 * right}
        return Felt(one, 1.0, frequencies, values, **model)

    found = measured(ratio)
    assert (found.bandwidth, found.error(10.0), found.error(14.0)) == (10.0, 0.0, 0.5)
    assert (found.model_error(10.0), found.model_error(14.0)) == (0.0, 1.0)
    assert found.steady_error(1.0) == 1.0
    assert measured(2.0 * ratio).bandwidth == 0.0
    assert measured(right).bandwidth == 85.0


@pytest.mark.parametrize("period", [0.0003, 0.005])
def test_periods_that_cannot_be_measured_are_refused(period):
    with pytest.raises(InvalidInputError, match="must divide 1 s"):
        felt(load_scene("five_bar").stepped(period=period))


def test_the_command_writes_table_file_and_picture(tmp_path):
    found = ran("feel", "impedance", "two_link", "--out", str(tmp_path))
    assert "two_link" in found
    rows = json.loads((tmp_path / "impedance.json").read_text(encoding="utf-8"))
    assert {row["loop"] for row in rows} == {"device", "controller"}
    assert len(rows) == 4
    assert (tmp_path / "impedance.png").stat().st_size > 5000
