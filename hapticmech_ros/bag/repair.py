# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Makes a new, complete bag from the readable parts of a damaged or unfinished one.

A child process with limits reads it, as its bytes may be anything.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosbags.interfaces import MessageDefinitionFormat
from rosbags.typesys import Stores, get_typestore

from hapticmech_ros.bag.mcap_file import McapScan
from hapticmech_ros.bag.metadata import is_unfinished, read_metadata
from hapticmech_ros.bag.reader import types_of
from hapticmech_ros.bag.sqlite_file import SqliteScan
from hapticmech_ros.bag.storage import (
    COMPRESSED,
    FILE_RATIO,
    SUFFIXES,
    UNPACKED_LIMIT,
    DamageError,
    StoredTopic,
    unpack_file,
    unpacked,
)
from hapticmech_ros.bag.writer import BagWriter
from hapticmech_ros.errors import BagError, FileError
from hapticmech_ros.files import check_file, exists, is_file
from hapticmech_ros.files.cage import CageError, Limits, caged

# First bytes of a compressed message; a serialized one begins with 0.
_ZSTD = b"\x28\xb5\x2f\xfd"
# Limits of the child: bytes of memory; s for any bag, and bytes that it reads in a second.
MEMORY = 4 * UNPACKED_LIMIT
SECONDS, BYTES_PER_SECOND = 4, 250_000


@dataclass(frozen=True, slots=True)
class FileRepair:
    """Result of one storage file.

    Attributes:
        name: of the damaged bag's file.
        messages: recovered.
        trouble: its damage; empty for a whole file.
        lost_bytes: that could not be read; how many messages they held is not known.
    """

    name: str
    messages: int
    trouble: str
    lost_bytes: int


@dataclass(frozen=True, slots=True)
class RepairReport:
    """Recovered and lost parts of a bag.

    Attributes:
        source: the damaged bag, untouched.
        path: the new bag.
        files: one entry per storage file of ``source``.
        counts: messages recovered, by topic.
        refused: topics that cannot be written, and why.
        stated: number of messages in the damaged bag's metadata; None if it was never finished.
    """

    source: Path
    path: Path
    files: tuple[FileRepair, ...]
    counts: dict[str, int]
    refused: dict[str, str]
    stated: int | None

    @property
    def messages(self) -> int:
        """Messages recovered."""
        return sum(self.counts.values())

    @property
    def lost_bytes(self) -> int:
        """Bytes that could not be read."""
        return sum(file.lost_bytes for file in self.files)


def repair(
    source: str | os.PathLike[str], path: str | os.PathLike[str] | None = None
) -> RepairReport:
    """Write a new bag with everything that can be read of ``source``; return a report.

    Files stay apart as they were; compressed ones are written uncompressed.

    Args:
        source: bag folder, or a single ``.mcap`` or ``.db3`` file.
        path: folder to make; by default the source's name with ``_repaired``.

    Raises:
        BagError: no such bag, no storage files in it, files of both kinds, or something is at
            ``path`` already.
    """
    given = Path(source)
    target = Path(path) if path is not None else given.with_name(f"{given.stem}_repaired")
    size = sum(check_file(file) for file in _storage_files(given) if is_file(file))
    limits = Limits(MEMORY, SECONDS + size // BYTES_PER_SECOND, UNPACKED_LIMIT + FILE_RATIO * size)
    with TemporaryDirectory(dir=_roomy(given)) as scratch:
        item = {"source": str(given), "target": str(target), "scratch": scratch}
        try:
            (said,) = caged(repair_in_child, [item], limits)
        except CageError as error:
            raise BagError(f"bag {given}: its repair {error.rule}") from None
    if "error" in said:
        raise BagError(said["error"])
    files = tuple(FileRepair(**file) for file in said.pop("files"))
    return RepairReport(given, target, files, **said)


def repair_in_child(item: Mapping[str, str]) -> dict[str, Any]:
    """Do :func:`repair` in the child; return the parts of its report, or the error."""
    given, target, scratch = Path(item["source"]), Path(item["target"]), Path(item["scratch"])
    information = read_metadata(given) if given.is_dir() else {}
    stated = None if is_unfinished(information) else information.get("message_count")
    mode = str(information.get("compression_mode") or "").lower()
    # Without metadata, a message's first bytes show whether it is compressed.
    packed = mode == "message" if information else None
    refused: dict[str, str] = {}
    try:
        files = _storage_files(given)
        (storage,) = {_storage(file) for file in files}
        with BagWriter(target, storage) as writer:
            done = [_copy(file, storage, writer, refused, packed, scratch) for file in files]
    except BagError as error:
        return {"error": str(error)}
    except OSError as error:
        return {"error": f"bag {given} cannot be repaired: {error}"}
    counts = writer.counts
    return {
        "files": [asdict(file) for file in done],
        "counts": counts,
        "refused": refused,
        "stated": stated,
    }


def _storage_files(given: Path) -> list[Path]:
    if not exists(given):
        raise BagError(f"no bag at {given}")
    candidates = list(given.iterdir()) if given.is_dir() else [given]
    files = sorted((file for file in candidates if _storage(file)), key=_natural)
    if not files:
        raise BagError(f"nothing to repair in {given}: no {' or '.join(SUFFIXES)} file")
    if len({_storage(file) for file in files}) > 1:
        raise BagError(f"bag {given} has files of both storages: repair them one by one")
    return files


def _storage(file: Path) -> str:
    plain = file.with_suffix("") if file.suffix == COMPRESSED else file
    return SUFFIXES.get(plain.suffix, "")


def _natural(file: Path) -> list[tuple[int, str]]:
    """Return a key that puts ``bag_10`` behind ``bag_9``."""
    return [
        (int(part or 0), "") if part.isdigit() else (-1, part)
        for part in re.split(r"(\d+)", file.name)
    ]


def _copy(
    file: Path,
    storage: str,
    writer: BagWriter,
    refused: dict[str, str],
    packed: bool | None,
    scratch: Path,
) -> FileRepair:
    """Write the readable messages of a file; these may be compressed one by one."""
    with TemporaryDirectory(dir=scratch) as folder:
        plain, trouble = file, ""
        messages, lost = 0, 0
        try:
            if file.suffix == COMPRESSED:
                plain = Path(folder) / file.stem
                trouble = unpack_file(file, plain)
            scan = McapScan(plain) if storage == "mcap" else SqliteScan(plain, Path(folder))
            writer.split()
            for topic, time_ns, data in scan:
                _announce(writer, topic, refused)
                if data is None or topic.name in refused:
                    continue
                is_packed = data.startswith(_ZSTD) if packed is None else packed
                try:
                    plain_data = unpacked(data, "zstd") if is_packed else data
                except DamageError as error:
                    trouble, lost = (
                        f"holds a message that cannot be read ({error})",
                        lost + len(data),
                    )
                    continue
                writer.write(topic.name, time_ns, plain_data)
                messages += 1
        except FileError as error:
            return FileRepair(file.name, messages, f"cannot be read: {error.rule}", lost)
    return FileRepair(file.name, messages, trouble or scan.trouble, lost + scan.lost_bytes)


def _announce(writer: BagWriter, topic: StoredTopic, refused: dict[str, str]) -> None:
    if topic.name in writer.counts or topic.name in refused:
        return
    given = None
    if topic.definition.format is not MessageDefinitionFormat.NONE:
        given = topic.definition, topic.type_hash or _hash(topic)
    try:
        writer.add_topic(topic.name, topic.type, offered=topic.offered, definition=given)
    except BagError as error:
        refused[topic.name] = str(error)


def _hash(topic: StoredTopic) -> str:
    """Return the hash of a topic's type, or nothing if its definition cannot be read."""
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(types_of(topic))
        return store.hash_rihs01(topic.type)
    except Exception:  # noqa: BLE001 - parsers raise anything on damaged text; a hash may be missing.
        return ""


def _roomy(path: Path) -> Path | None:
    """Return a folder for copies of large files: beside the bag, if we may write there.

    None stands for the system's folder for temporary files.
    """
    beside = path.resolve().parent
    try:
        with TemporaryDirectory(dir=beside):
            return beside
    except OSError:
        return None
