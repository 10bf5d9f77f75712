# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Two bags that differ in known ways."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bag.record import MS, STORE, WRENCH, Bytes, record
from hapticmech_ros.bag import BagReader, BagWriter
from hapticmech_ros.bag.compare import BagComparison, TopicComparison, by_nearest, by_stamp, compare
from hapticmech_ros.errors import BagError, InvalidInputError
from hapticmech_ros.wire.cdr import FlatArray
from hapticmech_ros.wire.messages import MechanismEnergy

Messages = Iterable[tuple[int, bytes]]
ARRAY = "std_msgs/msg/Float64MultiArray"
UINT8 = "std_msgs/msg/UInt8"
START = 10**18


def bag(path: Path, msgtype: str, messages: Messages, storage: str = "mcap") -> Path:
    return record(path, [("/t", *message) for message in messages], storage, msgtype)


def one(report: BagComparison) -> TopicComparison:
    (topic,) = report.topics
    return topic


def energies(count: int, first: int = START, **changed: float) -> list[tuple[int, bytes]]:
    """Return flat arrays whose fields are 0, 1, 2, ... but for those changed in message 3."""
    names = list(MechanismEnergy.layout)[1:]
    # Behind what comes before the numbers: no node sends some of these.
    head = FlatArray(MechanismEnergy.layout).encode(np.zeros(2 + len(names)))[
        : -8 * (2 + len(names))
    ]
    made = []
    for i in range(count):
        stamp = first + i * MS
        values = [changed.get(n, float(k)) if i == 3 else float(k) for k, n in enumerate(names)]
        made.append((stamp, head + np.array([*divmod(stamp, 10**9), *values]).tobytes()))
    return made


def wrenches(make: Bytes, count: int, first: int = START) -> list[tuple[int, bytes]]:
    return [(first + i * MS, make(first + i * MS, 0.1 * i)) for i in range(count)]


def late(make: Bytes) -> list[tuple[int, bytes]]:
    """Return messages of a run an hour later, whose stamps are a little uneven, but for one."""
    shift = HOUR + 400_000
    return [
        (t + shift + 50_000, make(t + shift + (i % 3) * 100_000, 0.1 * i))
        for i, (t, _) in enumerate(wrenches(make, 50))
        if i != 11
    ]


def stamped_later(make: Bytes, by_ns: int) -> list[tuple[int, bytes]]:
    return [(t, make(t + by_ns, 0.1 * i)) for i, (t, _) in enumerate(wrenches(make, 20))]


def without_stamps(first: int, count: int) -> list[tuple[int, bytes]]:
    return [(START + first + i, bytes((0, 1, 0, 0, i))) for i in range(count)]


HOUR = 3_600_000_000_000
ALL = {"matched": 50, "missing": 0, "extra": 0, "equal": 50, "matched_by": "stamp"}
# Type, messages of both bags, how they are aligned, and what is said of the topic.
MATCHED: dict[str, tuple[str, Callable[[Bytes], Messages], Callable[[Bytes], Messages], str, Any]]
MATCHED = {
    "itself": (
        *(WRENCH, lambda make: wrenches(make, 50), lambda make: wrenches(make, 50), "stamp"),
        ALL | {"is_exact": True, "largest": 0.0},
    ),
    "missing and extra": (
        WRENCH,
        lambda make: wrenches(make, 45),
        lambda make: [m for i, m in enumerate(wrenches(make, 50)) if i not in (7, 8, 30)],
        *("stamp", {"matched": 42, "missing": 3, "extra": 5, "equal": 42, "is_exact": False}),
    ),
    # What is only in the second bag does not make it less exact.
    "extra": (
        *(WRENCH, lambda make: wrenches(make, 10), lambda make: wrenches(make, 45), "stamp"),
        {"extra": 35, "is_exact": True},
    ),
    "shifted": (WRENCH, lambda make: wrenches(make, 50), late, "stamp", {"matched": 0}),
    # Stamps are not among the fields: they differ on purpose.
    "shifted, by the start": (
        *(WRENCH, lambda make: wrenches(make, 50), late, "start"),
        {"matched": 49, "missing": 1, "extra": 0, "equal": 49, "largest": 0.0},
    ),
    "without stamps": (
        *(UINT8, lambda _: without_stamps(0, 20), lambda _: without_stamps(5, 17), "stamp"),
        {"matched_by": "order", "matched": 17, "missing": 3, "equal": 17},
    ),
    "stamps of zero": (
        WRENCH,
        lambda make: [(START + i, make(0, float(i))) for i in range(9)],
        lambda make: [(START + i, make(0, float(i))) for i in range(9)],
        *("stamp", {"matched_by": "order"}),
    ),
    "apart": (
        *(WRENCH, lambda make: wrenches(make, 20), lambda make: stamped_later(make, 300_000)),
        *("stamp", {"matched": 0}),
    ),
    "apart, the nearest": (
        *(WRENCH, lambda make: wrenches(make, 20), lambda make: stamped_later(make, 300_000)),
        *("nearest", {"matched": 20, "missing": 0, "extra": 0}),
    ),
    "far apart, the nearest": (
        *(WRENCH, lambda make: wrenches(make, 20), lambda make: stamped_later(make, HOUR)),
        *("nearest", {"matched": 0}),
    ),
}


@pytest.mark.parametrize(
    ("kind", "first", "second", "align", "expected"), MATCHED.values(), ids=MATCHED
)
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_messages_are_matched(
    storage: str,
    kind: str,
    first: Callable[[Bytes], Messages],
    second: Callable[[Bytes], Messages],
    align: str,
    expected: dict[str, Any],
    tmp_path: Path,
    wrench_bytes: Bytes,
) -> None:
    a = bag(tmp_path / "a", kind, first(wrench_bytes), storage)
    report = compare(a, bag(tmp_path / "b", kind, second(wrench_bytes), storage), align=align)
    topic = one(report)
    found = {name: getattr(topic, name, report.is_exact) for name in expected}
    assert found == expected


def test_known_deviation(tmp_path: Path, wrench_bytes: Bytes) -> None:
    sent = wrenches(wrench_bytes, 50)
    offsets = {20: 0.25, 30: 0.125}
    moved = [(t, wrench_bytes(t, 0.1 * i + offsets.get(i, 0.0))) for i, (t, _) in enumerate(sent)]
    a, b = bag(tmp_path / "a", WRENCH, sent), bag(tmp_path / "b", WRENCH, moved)
    report = compare(a, b)
    fields = {field.name: field for field in one(report).fields}
    assert [name for name in fields if "force" in name] == [f"wrench.force.{x}" for x in "xyz"]
    # Force is (f, 2 f, -f). Rounding: 0.1 i is at most 5, with an ulp of 9e-16.
    for axis, factor in (("x", 1.0), ("y", 2.0), ("z", 1.0)):
        field = fields[f"wrench.force.{axis}"]
        assert field.largest == pytest.approx(0.25 * factor, abs=4e-15)
        rms = math.hypot(0.25, 0.125) / math.sqrt(50)
        assert field.rms == pytest.approx(rms * factor, abs=4e-15)
        assert field.worst_at_ns == START + 20 * MS
    assert fields["wrench.torque.z"].largest == 0.0
    assert one(report).equal == 48
    worst = one(report).worst
    assert worst.name == "wrench.force.y"


def test_fields_of_flat_arrays_have_their_names(tmp_path: Path) -> None:
    a = bag(tmp_path / "a", ARRAY, energies(10))
    b = bag(tmp_path / "b", ARRAY, energies(10, work_in=2.5, closure_error=5.0 + 1e-9))
    fields = {field.name: field for field in one(compare(a, b)).fields}
    assert set(fields) == set(MechanismEnergy.layout) - {"stamp"}
    assert fields["work_in"].largest == 0.5
    assert fields["work_in"].worst_at_ns == START + 3 * MS
    assert fields["closure_error"].largest == pytest.approx(1e-9, rel=1e-6)
    assert fields["kinetic"].largest == 0.0


def test_nan_is_equal_to_itself_and_infinitely_far_from_numbers(tmp_path: Path) -> None:
    numbers = bag(tmp_path / "numbers", ARRAY, energies(10))
    broken = bag(tmp_path / "broken", ARRAY, energies(10, potential=math.nan, kinetic=math.inf))
    same = compare(broken, broken)
    assert same.is_exact
    assert same.largest == 0.0
    for report in (compare(numbers, broken), compare(broken, numbers)):
        fields = {field.name: field for field in one(report).fields}
        assert fields["potential"].largest == math.inf
        assert fields["kinetic"].largest == math.inf
        assert fields["latch_loss"].largest == 0.0
        text = json.dumps(report.as_dict(), allow_nan=False)
        assert json.loads(text)["topics"]["/t"]["fields"]["potential"]["largest"] == "inf"
    other = bag(
        tmp_path / "other",
        ARRAY,
        energies(10, potential=math.nan, kinetic=math.inf, latch_loss=4.5),
    )
    assert compare(broken, other).largest == 0.5
    negative = bag(tmp_path / "negative", ARRAY, energies(10, kinetic=-math.inf))
    assert compare(broken, negative).largest == math.inf


def test_negative_zero_differs_in_bits_only(tmp_path: Path) -> None:
    a = bag(tmp_path / "a", ARRAY, energies(10))
    b = bag(tmp_path / "b", ARRAY, energies(10, kinetic=-0.0))
    report = compare(a, b)
    assert report.largest == 0.0
    assert not report.is_exact


def test_big_endian_stamps_are_read(tmp_path: Path) -> None:
    body = struct.pack(">iI", 5, 7) + struct.pack(">I", 6) + b"world\0" + b"\0" * 6 + b"\0" * 48
    a = bag(tmp_path / "a", WRENCH, [(START, b"\x00\x00\x00\x00" + body)])
    with BagReader(a) as reader:
        read = reader.stamps_of("/t")
        ((_, _, data),) = list(reader.serialized())
        assert read(data) == 5 * 10**9 + 7
        assert read(data[:9]) is None


def test_texts_and_lengths(tmp_path: Path) -> None:
    kind, types = "sensor_msgs/msg/JointState", STORE.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](5, 7), "")

    def joints(name: str, *positions: float) -> bytes:
        message = types[kind](header, [name], np.array(positions), np.zeros(0), np.zeros(0))
        return bytes(STORE.serialize_cdr(message, kind))

    a = bag(tmp_path / "a", kind, [(START, joints("elbow", 1.0, 2.0))])
    b = bag(tmp_path / "b", kind, [(START, joints("wrist", 1.0, 2.5))])
    c = bag(tmp_path / "c", kind, [(START, joints("elbow", 1.0))])
    fields = {field.name: field.largest for field in one(compare(a, b)).fields}
    assert fields["name[0]"] == math.inf
    assert (fields["position[0]"], fields["position[1]"]) == (0.0, 0.5)
    assert {f.name: f.largest for f in one(compare(a, c)).fields}["position[0]"] == math.inf


def test_topics_in_one_bag_only(tmp_path: Path, wrench_bytes: Bytes) -> None:
    a = bag(tmp_path / "a", WRENCH, wrenches(wrench_bytes, 3))
    with BagWriter(tmp_path / "b") as writer:
        writer.add_topic("/other", WRENCH)
        writer.write("/other", START, wrench_bytes(START, 0.0))
        writer.add_topic("/silent", WRENCH)
    report = compare(a, tmp_path / "b")
    assert (report.missing_topics, report.extra_topics) == (("/t",), ("/other",))
    assert not report.is_exact
    assert compare(a, tmp_path / "b", topics=["/other"]).missing_topics == ()


@pytest.mark.parametrize(
    ("other", "given", "rule"),
    [
        ("b", {}, r"/t: .*WrenchStamped in one bag, .*MultiArray in"),
        ("a", {"topics": ["/u"]}, "topic /u"),
        ("a", {"align": "end"}, "must be one of stamp, nearest, start"),
    ],
)
def test_refuses_what_cannot_be_compared(
    tmp_path: Path, wrench_bytes: Bytes, other: str, given: dict[str, Any], rule: str
) -> None:
    bag(tmp_path / "a", WRENCH, wrenches(wrench_bytes, 3))
    bag(tmp_path / "b", ARRAY, energies(3))
    error = InvalidInputError if "align" in given else BagError
    with pytest.raises(error, match=rule):
        compare(tmp_path / "a", tmp_path / other, **given)


def test_equal_stamps_are_matched_in_order() -> None:
    assert by_stamp([1, 1, 2, 3], [1, 3, 1, 1]) == [(0, 0), (1, 2), (3, 1)]


def test_nearest_takes_no_message_twice() -> None:
    assert by_nearest([0, 10, 20, 30], [1, 19, 22, 31]) == [(0, 0), (2, 1), (3, 3)]
    assert by_nearest([0, 10, 20], []) == []
    assert by_nearest([5], [5]) == [(0, 0)]
    # As near to the second as to the third.
    assert by_nearest([0, 10, 20], [15]) == [(1, 0)]
