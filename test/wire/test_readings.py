# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of the control rate as they are read: the numbers, and what is refused."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.control import DeviceMeasurement, OperationalModel, PointMeasurement
from hapticmech_ros.control.measurements import (
    flat_device,
    flat_operational_model,
)
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.wire.bounds import message_bounds, read
from hapticmech_ros.wire.cdr import FlatArray, decode
from hapticmech_ros.wire.messages import DeviceStateMessage, OperationalModelMessage

STAMP = 1_700_000_000_123_456_789
KINDS = {"device": DeviceStateMessage, "operational_model": OperationalModelMessage}


def pose(rng):
    return pin.SE3(np.asarray(pin.exp3(rng.normal(size=3))), rng.normal(size=3))


def sample(kind, seed=0, stamp=STAMP):
    """Return a message's data, and the part of it that the control reads."""
    rng = np.random.default_rng(seed)
    if kind == "device":
        measured = flat_device(DeviceMeasurement(pose(rng), *rng.normal(size=(2, 6))))
        found = DeviceStateMessage.of(stamp, sample=measured, applied=rng.normal(size=6), obeys=1.0)
        return found.values, measured
    model = OperationalModel(*rng.normal(size=(3, 6, 6)), rng.normal(size=6))
    flat = flat_operational_model(model, PointMeasurement(pose(rng), *rng.normal(size=(2, 6))))
    flat[:5] = rng.normal(size=5)
    message = OperationalModelMessage.of(stamp, count=2, directions=5, operational_model=flat)
    message.commanded, message.grasp[:] = bool(seed % 2), rng.normal(size=7)
    return message.values, flat


def part(kind, data, bounds=None):
    """Return a message, and what of it the control reads."""
    found = read(KINDS[kind], data, bounds)
    return found, (found.sample if kind == "device" else found.operational_model).values


def refusal(kind, data):
    """Return what, rule and text of the error that reading raises."""
    with pytest.raises(InvalidInputError) as caught:
        read(KINDS[kind], data)
    return caught.value.what, caught.value.rule, str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_encoded_is_read_to_the_bit(kind):
    for seed in range(20):
        data, expected = sample(kind, seed)
        found, control = part(kind, decode(FlatArray(KINDS[kind].layout).encode(data)))
        assert found.stamp_ns == STAMP
        assert control.tobytes() == expected.tobytes()
        # Kernels take numbers where a processor expects them.
        assert control.flags.aligned
        if kind == "operational_model":
            assert found.commanded is bool(seed % 2)
            assert found.s.tobytes() == expected[:5].tobytes()
            assert found.grasp.tobytes() == data[144:].tobytes()


def test_a_device_tells_its_round_trip_and_whether_it_obeys():
    for round_trip, obeys in ((0.0, True), (0.104, True), (0.02, False)):
        data, _ = sample("device")
        data[27:] = round_trip, obeys
        found = read(DeviceStateMessage, data)
        assert (found.round_trip, found.obeys) == (round_trip, obeys)


def test_samples_of_older_versions_are_read_as_those_of_a_device_that_obeys():
    data, expected = sample("device")
    found = read(DeviceStateMessage, data[:27])
    assert (found.round_trip, found.obeys) == (0.0, True)
    assert found.sample.values.tobytes() == expected.tobytes()


@pytest.mark.parametrize("kind", KINDS)
def test_the_message_may_be_overwritten_afterwards(kind):
    data, expected = sample(kind)
    _, control = part(kind, data)
    data[:] = 0.0
    assert (control == expected).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_every_number_has_to_be_finite(kind, bad):
    name = KINDS[kind].what
    for index in range(sample(kind)[0].size):
        data, _ = sample(kind)
        data[index] = bad
        found = refusal(kind, data)
        assert found[0] == f"{name} message[{index}]"
        assert found[1] == "must be finite"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("change", [-1, 1, -30, 30])
def test_the_length_has_to_be_right(kind, change):
    name = KINDS[kind].what
    data, _ = sample(kind)
    size = data.size
    wrong = data[:change] if change < 0 else np.concatenate((data, np.ones(change)))
    wrong = wrong if size + change > 0 else data[:0]
    found = refusal(kind, wrong)
    assert found[:2] == (f"{name} message", f"must hold {size} numbers")


@pytest.mark.parametrize("kind", KINDS)
def test_the_quaternion_has_to_be_of_unit_length(kind):
    at = KINDS[kind].layout.start("quaternion")
    for length in (0.0, 0.5, 1.0 - 1.01e-3, 1.0 + 1.01e-3, 2.0, 1e100):
        data, _ = sample(kind)
        data[at : at + 4] *= length
        found = refusal(kind, data)
        assert found[0] == "length of quaternion"
    for length in (1.0 - 0.99e-3, 1.0 - 0.6e-3, 1.0 - 0.4e-3, 1.0 + 0.4e-3, 1.0 + 0.99e-3):
        data, _ = sample(kind)
        data[at : at + 4] *= length
        # Handed on as it came: whoever uses it divides by its length.
        _, control = part(kind, data)
        assert control.tobytes() in data.tobytes()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("seconds", "nanoseconds"),
    [
        (-1.0, 5.0),
        (-0.5, 0.0),
        (1e30, 0.0),
        (1.797e308, 0.0),
        (3.0, 1e9),
        (3.0, -7.0),
        (3.0, 1.797e308),
        (2.0**31, 0.0),
        (4e9, 1.0),
        (1.5, 0.0),
        (1.0, 0.5),
    ],
)
def test_stamps_that_are_none_are_refused_before_anything_is_computed(kind, seconds, nanoseconds):
    data, _ = sample(kind)
    data[:2] = seconds, nanoseconds
    found = refusal(kind, data)
    assert found[0] == "stamp, s and ns"
    assert repr(seconds) in found[2]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("seconds", "nanoseconds"), [(0, 0), (2**31 - 1, 999_999_999)])
def test_the_first_and_the_last_stamp_are_read(kind, seconds, nanoseconds):
    data, _ = sample(kind)
    data[:2] = seconds, nanoseconds
    assert read(KINDS[kind], data).stamp_ns == seconds * 1_000_000_000 + nanoseconds


@pytest.mark.parametrize("kind", KINDS)
def test_large_numbers_are_no_fault_where_no_scene_is_known(kind):
    data, _ = sample(kind)
    data[15:20] = 1e300
    assert read(KINDS[kind], data).stamp_ns == STAMP


@pytest.mark.parametrize("kind", KINDS)
def test_a_scene_bounds_every_number(kind):
    name, quaternion = KINDS[kind].what, KINDS[kind].layout.start("quaternion")
    bounds = message_bounds(KINDS[kind], Limits())
    for index in range(2, sample(kind)[0].size):
        data, expected = sample(kind)
        if kind == "operational_model":
            data[144] = 2.0
        assert part(kind, data, bounds)[1].tobytes() == expected.tobytes()
        data[index] = -1e80
        with pytest.raises(InvalidInputError) as caught:
            read(KINDS[kind], data, bounds)
        if quaternion <= index < quaternion + 4:
            assert caught.value.what == "length of quaternion"
        else:
            assert caught.value.what == f"{name} message[{index}]"
            assert "-1e+80" in str(caught.value)


def test_velocities_are_bounded_to_the_last_digit_that_the_scene_allows():
    bounds = message_bounds(DeviceStateMessage, Limits(linear_velocity=2.0))
    data, _ = sample("device")
    data[9] = 2.0
    assert read(DeviceStateMessage, data, bounds).stamp_ns == STAMP
    data[9] = np.nextafter(2.0, 3.0)
    with pytest.raises(InvalidInputError, match=r"at most 2 .*limits\.linear_velocity"):
        read(DeviceStateMessage, data, bounds)
