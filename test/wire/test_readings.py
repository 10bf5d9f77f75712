# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of the control rate, read without taking them apart: same numbers, same refusals."""

import numpy as np
import pinocchio as pin
import pytest

from hapticmech_ros.control import DeviceMeasurement, OperationalModel, PointMeasurement
from hapticmech_ros.control.measurements import flat_device, flat_operational_model
from hapticmech_ros.errors import InvalidInputError
from hapticmech_ros.scene.document import Limits
from hapticmech_ros.wire.cdr import FlatArray, decode
from hapticmech_ros.wire.layouts import (
    DEVICE_FIELDS,
    DEVICE_MEASURED,
    OPERATIONAL_MODEL_FIELDS,
    POINT_MODEL_PART,
    DeviceSample,
    OperationalModelMessage,
    device_bounds,
    operational_model_bounds,
    pack_device,
    pack_operational_model,
    unpack_device,
    unpack_operational_model,
)
from hapticmech_ros.wire.readings import read_device, read_operational_model

STAMP = 1_700_000_000_123_456_789
# Reader, readable reader, name in errors, first index of the quaternion.
KINDS = {
    "device": (read_device, unpack_device, "device state", DEVICE_FIELDS.start("quaternion")),
    "operational_model": (
        read_operational_model,
        unpack_operational_model,
        "operational_model",
        OPERATIONAL_MODEL_FIELDS.start("quaternion"),
    ),
}


def pose(rng):
    return pin.SE3(np.asarray(pin.exp3(rng.normal(size=3))), rng.normal(size=3))


def sample(kind, seed=0, stamp=STAMP):
    """Return a message's data, and the part of it that the control reads."""
    rng = np.random.default_rng(seed)
    if kind == "device":
        measured = DeviceMeasurement(pose(rng), *rng.normal(size=(2, 6)))
        return pack_device(DeviceSample(stamp, measured, rng.normal(size=6))), flat_device(measured)
    model = OperationalModel(*rng.normal(size=(3, 6, 6)), rng.normal(size=6))
    point = PointMeasurement(pose(rng), *rng.normal(size=(2, 6)))
    message = OperationalModelMessage(
        stamp, 2, rng.normal(size=5), model, point, bool(seed % 2), rng.normal(size=7)
    )
    operational_model = flat_operational_model(model, point)
    operational_model[: message.s.size] = message.s
    return pack_operational_model(message), operational_model


def refusal(read, data):
    """Return what, rule and text of the error that reading raises."""
    with pytest.raises(InvalidInputError) as caught:
        read(data)
    return caught.value.what, caught.value.rule, str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
def test_the_part_for_the_control_is_read_to_the_bit(kind):
    read, unpack, _, _ = KINDS[kind]
    fields = {"device": DEVICE_FIELDS, "operational_model": OPERATIONAL_MODEL_FIELDS}[kind]
    for seed in range(20):
        data, expected = sample(kind, seed)
        wire = decode(FlatArray(fields).encode(data))
        found = read(wire)
        assert found.stamp_ns == unpack(wire).stamp_ns == STAMP
        assert found[1].tobytes() == expected.tobytes()
        # Kernels take numbers where a processor expects them.
        assert found[1].flags.aligned
        if kind == "operational_model":
            assert found.commanded is unpack(wire).commanded is bool(seed % 2)
            assert found.grasp == unpack(wire).grasp.tobytes() == data[144:].tobytes()


def test_a_device_tells_its_round_trip_and_whether_it_obeys():
    measured = DeviceMeasurement(pose(np.random.default_rng(1)), np.zeros(6), np.zeros(6))
    for told in ((0.0, True), (0.104, True), (0.02, False)):
        data = pack_device(DeviceSample(STAMP, measured, np.zeros(6), *told))
        assert unpack_device(data)[3:] == told
        assert read_device(data)[2:] == told


def test_samples_of_older_versions_are_read_as_those_of_a_device_that_obeys():
    data, expected = sample("device")
    old = data[:27]
    assert unpack_device(old)[3:] == read_device(old)[2:] == (0.0, True)
    assert read_device(old).measured.tobytes() == expected.tobytes()


@pytest.mark.parametrize("kind", KINDS)
def test_the_message_may_be_overwritten_afterwards(kind):
    data, expected = sample(kind)
    found = KINDS[kind][0](data)
    data[:] = 0.0
    assert (found[1] == expected).all()


@pytest.mark.parametrize("kind", KINDS)
def test_objects_hold_the_same_numbers(kind):
    data, expected = sample(kind)
    found = KINDS[kind][1](data)
    if kind == "device":
        again = flat_device(found.measured)
    else:
        again = flat_operational_model(found.model, found.point)
        again[: found.s.size] = found.s
    # A quaternion becomes a matrix and a quaternion again.
    assert np.abs(again - expected).max() < 1e-15


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_every_number_has_to_be_finite(kind, bad):
    read, unpack, name, _ = KINDS[kind]
    for index in range(sample(kind)[0].size):
        data, _ = sample(kind)
        data[index] = bad
        found = refusal(read, data)
        assert found == refusal(unpack, data)
        assert found[0] == f"{name} message[{index}]"
        assert found[1] == "must be finite"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("change", [-1, 1, -30, 30])
def test_the_length_has_to_be_right(kind, change):
    read, unpack, name, _ = KINDS[kind]
    data, _ = sample(kind)
    size = data.size
    wrong = data[:change] if change < 0 else np.concatenate((data, np.ones(change)))
    wrong = wrong if size + change > 0 else data[:0]
    found = refusal(read, wrong)
    assert found == refusal(unpack, wrong)
    assert found[:2] == (f"{name} message", f"must hold {size} numbers")


@pytest.mark.parametrize("kind", KINDS)
def test_the_quaternion_has_to_be_of_unit_length(kind):
    read, unpack, _, at = KINDS[kind]
    for length in (0.0, 0.5, 1.0 - 1.01e-3, 1.0 + 1.01e-3, 2.0, 1e100):
        data, _ = sample(kind)
        data[at : at + 4] *= length
        found = refusal(read, data)
        assert found == refusal(unpack, data)
        assert found[0] == "length of quaternion"
    for length in (1.0 - 0.99e-3, 1.0 - 0.6e-3, 1.0 - 0.4e-3, 1.0 + 0.4e-3, 1.0 + 0.99e-3):
        data, _ = sample(kind)
        data[at : at + 4] *= length
        # Handed on as it came: whoever uses it divides by its length.
        assert (
            read(data)[1] == data[DEVICE_MEASURED if kind == "device" else POINT_MODEL_PART]
        ).all()


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
    read, unpack, _, _ = KINDS[kind]
    data, _ = sample(kind)
    data[:2] = seconds, nanoseconds
    found = refusal(read, data)
    assert found == refusal(unpack, data)
    assert found[0] == "stamp, s and ns"
    assert repr(seconds) in found[2]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("seconds", "nanoseconds"), [(0, 0), (2**31 - 1, 999_999_999)])
def test_the_first_and_the_last_stamp_are_read(kind, seconds, nanoseconds):
    read, unpack, _, _ = KINDS[kind]
    data, _ = sample(kind)
    data[:2] = seconds, nanoseconds
    assert read(data).stamp_ns == unpack(data).stamp_ns == seconds * 1_000_000_000 + nanoseconds


@pytest.mark.parametrize("kind", KINDS)
def test_large_numbers_are_no_fault_where_no_scene_is_known(kind):
    data, _ = sample(kind)
    data[15:20] = 1e300
    assert KINDS[kind][0](data).stamp_ns == STAMP


@pytest.mark.parametrize("kind", KINDS)
def test_a_scene_bounds_every_number(kind):
    read, _, name, quaternion = KINDS[kind]
    bounds = {"device": device_bounds, "operational_model": operational_model_bounds}[kind](
        Limits()
    )
    for index in range(2, sample(kind)[0].size):
        data, expected = sample(kind)
        if kind == "operational_model":
            data[144] = 2.0
        assert read(data, bounds)[1].tobytes() == expected.tobytes()
        data[index] = -1e80
        with pytest.raises(InvalidInputError) as caught:
            read(data, bounds)
        if quaternion <= index < quaternion + 4:
            assert caught.value.what == "length of quaternion"
        else:
            assert caught.value.what == f"{name} message[{index}]"
            assert "-1e+80" in str(caught.value)


def test_velocities_are_bounded_to_the_last_digit_that_the_scene_allows():
    bounds = device_bounds(Limits(linear_velocity=2.0))
    data, _ = sample("device")
    data[9] = 2.0
    assert read_device(data, bounds).stamp_ns == STAMP
    data[9] = np.nextafter(2.0, 3.0)
    with pytest.raises(InvalidInputError, match=r"at most 2 .*limits\.linear_velocity"):
        read_device(data, bounds)
