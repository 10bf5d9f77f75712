# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reading gives what the library rosbags gives, message for message, and finds damage."""

from __future__ import annotations

import random
from pathlib import Path
from zlib import crc32

import mcap.writer as mcap
import pytest
from mcap.reader import SeekingReader
from rosbags.highlevel import AnyReader

from bag.record import STORE, SUFFIXES, WRENCH, Bytes
from bag.record import alone as written_alone
from hapticmech_ros.bag import BagReader, BagWriter
from hapticmech_ros.errors import BagError
from sampling import sampled

TOPICS = ("/a", "/b", "/c")
Found = list[tuple[str, int, bytes]]


def read(path: Path, *names: str, **limits: int) -> Found:
    """Read as the library does."""
    with library(path) as reader:
        chosen = [one for one in reader.connections if not names or one.topic in names]
        stream = reader.messages(connections=chosen, **limits)
        return [(one.topic, time_ns, bytes(data)) for one, time_ns, data in stream]


def own(path: Path, *names: str, **limits: int) -> Found:
    with BagReader(path) as bag:
        return list(bag.serialized(*names, **{f"{key}_ns": ns for key, ns in limits.items()}))


def library(path: Path) -> AnyReader:
    return AnyReader([path], default_typestore=STORE)


def written(path: Path, storage: str, make: Bytes) -> Path:
    """Write messages that come out of order, at equal times, and in many chunks."""
    chance = random.Random(7)
    with BagWriter(path, storage) as bag:
        for name in TOPICS:
            bag.add_topic(name, WRENCH)
        for number in range(600):
            time_ns = 1000 + number + chance.choice((0, 0, 0, -3, 5))
            bag.write(chance.choice(TOPICS), time_ns, make(number, float(number)))
            if number % 37 == 0:
                bag.flush()
    return path


@pytest.fixture(params=SUFFIXES)
def storage(request: pytest.FixtureRequest) -> str:
    return str(request.param)


WINDOWS = [
    {},
    {"start": 1100},
    {"stop": 1300},
    {"start": 1100, "stop": 1300},
    {"start": 1300, "stop": 1300},
    {"start": 0, "stop": 1},
    {"start": 1_000_000},
]


@pytest.mark.parametrize(
    ("names", "limits"),
    [
        (names, limits)
        for names in [(), ("/a",), ("/b", "/c"), TOPICS]
        for limits in sampled(WINDOWS, names, 3)
    ],
    ids=str,
)
def test_messages_are_the_librarys(
    storage: str,
    names: tuple[str, ...],
    limits: dict[str, int],
    tmp_path: Path,
    wrench_bytes: Bytes,
) -> None:
    bag = written(tmp_path / "bag", storage, wrench_bytes)
    assert own(bag, *names, **limits) == read(bag, *names, **limits)
    (file,) = bag.glob(f"*{SUFFIXES[storage]}")
    assert own(file, *names, **limits) == read(file, *names, **limits)


def test_topics_types_and_counts_are_the_librarys(
    storage: str, tmp_path: Path, wrench_bytes: Bytes
) -> None:
    bag = written(tmp_path / "bag", storage, wrench_bytes)
    (file,) = bag.glob(f"*{SUFFIXES[storage]}")
    for path in (bag, file):
        with library(path) as expected, BagReader(path) as found:
            assert sum(topic.count for topic in found.topics.values()) == 600
            first, last = found.span_ns
            assert (first, last + 1) == (expected.start_time, expected.end_time)
            assert found.topics.keys() == expected.topics.keys()
            definitions = {topic.name: topic.definition for topic in found._stored}
            for name, info in expected.topics.items():
                topic = found.topics[name]
                assert (topic.type, topic.count) == (info.msgtype, info.msgcount)
                assert definitions[name] == info.msgdef
                (connection,) = info.connections
                assert list(topic.offered) == connection.ext.offered_qos_profiles
                # Of an mcap file alone the library does not read it.
                assert connection.digest in ("", topic.type_hash)
                assert topic.type_hash == STORE.hash_rihs01(WRENCH)


def with_checksums(bag: Path) -> Path:
    """Write the checksums that the format provides for, which this writer leaves out."""
    (file,) = bag.glob("*.mcap")
    data = bytearray(file.read_bytes())
    with file.open("rb") as stream:
        summary = SeekingReader(stream).get_summary()
    for chunk in summary.chunk_indexes:
        head = chunk.chunk_start_offset + 9
        records = data[head + 40 : head + 40 + chunk.compressed_size]
        data[head + 24 : head + 28] = crc32(records).to_bytes(4, "little")
    file.write_bytes(data)
    return file


def test_a_changed_bit_is_found_though_nobody_wants_its_topic(
    tmp_path: Path, wrench_bytes: Bytes
) -> None:
    """A chunk's checksum is looked at before any of its messages is handed out."""
    bag = written(tmp_path / "bag", "mcap", wrench_bytes)
    before = read(bag)
    file = with_checksums(bag)
    assert own(bag) == read(bag) == before
    data = bytearray(file.read_bytes())
    unwanted = next(message for topic, _, message in before if topic == "/c")
    data[data.index(unwanted) + len(unwanted) - 20] ^= 1
    file.write_bytes(data)
    with pytest.raises(BagError, match="checksum"), BagReader(bag) as reader:
        list(reader.serialized("/a"))


def test_a_chunk_of_nonsense_is_damage(tmp_path: Path, wrench_bytes: Bytes) -> None:
    """Without a checksum too: records have to end where the chunk does."""
    bag = written(tmp_path / "bag", "mcap", wrench_bytes)
    (file,) = bag.glob("*.mcap")
    data = bytearray(file.read_bytes())
    _, _, first = read(bag, "/a")[0]
    place = data.index(first)
    data[place - 22 - 8 : place - 22] = (1 << 40).to_bytes(8, "little")
    file.write_bytes(data)
    with pytest.raises(BagError, match="damaged"), BagReader(bag) as reader:
        list(reader.serialized("/a"))


def alone(path: Path, make: Bytes, times: range, **kinds: object) -> Path:
    sent = [("/a", time_ns, make(time_ns, 1.0)) for time_ns in times]
    return written_alone(path, sent, WRENCH, compression=mcap.CompressionType.NONE, **kinds)


@pytest.mark.parametrize("place", [0.001, 0.3, 0.6, 0.9])
def test_a_changed_bit_of_the_index_is_found(
    place: float, tmp_path: Path, wrench_bytes: Bytes
) -> None:
    file = alone(tmp_path / "a.mcap", wrench_bytes, range(50))
    with file.open("rb") as stream:
        summary = SeekingReader(stream).get_summary()
    last = max(one.chunk_start_offset + one.chunk_length for one in summary.chunk_indexes)
    data = bytearray(file.read_bytes())
    begin = data.index(WRENCH.encode(), last) - 4
    data[begin + int(place * (len(data) - 37 - begin))] ^= 1
    file.write_bytes(data)
    with pytest.raises(BagError, match=r"checksum of its index|cannot be read"):
        BagReader(file)


def test_a_changed_bit_of_loose_messages_is_found(tmp_path: Path, wrench_bytes: Bytes) -> None:
    kinds = {"use_chunking": False, "enable_data_crcs": True, "use_statistics": False}
    file = alone(tmp_path / "a.mcap", wrench_bytes, range(50), **kinds)
    assert len(own(file)) == 50
    data = bytearray(file.read_bytes())
    data[data.index(wrench_bytes(30, 1.0)) + 40] ^= 1
    file.write_bytes(data)
    with pytest.raises(BagError, match="checksum does not match"):
        BagReader(file)


def test_messages_out_of_order_are_sorted_by_chunks_or_refused(
    tmp_path: Path, wrench_bytes: Bytes
) -> None:
    """Chunks are found without an index of topics too."""
    back = range(50, 0, -1)
    file = alone(tmp_path / "a.mcap", wrench_bytes, back, repeat_channels=False)
    assert [time_ns for _, time_ns, _ in own(file)] == list(range(1, 51))
    loose = alone(tmp_path / "b.mcap", wrench_bytes, back, use_chunking=False)
    with pytest.raises(BagError, match="not in order of time"):
        own(loose)
