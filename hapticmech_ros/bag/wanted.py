"""The library's reader, with readers of storage files that cost what is wanted of them."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

from rosbags.highlevel import AnyReader
from rosbags.rosbag2.reader import DirectoryReader, Reader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from rosbags.typesys import Stores, get_typestore

from hapticmech_ros.bag.wanted_mcap import WantedMcap
from hapticmech_ros.bag.wanted_sqlite import WantedSqlite


class _Folder(DirectoryReader):
    # Counts are those of metadata.yaml.
    STORAGE_PLUGINS = MappingProxyType({"mcap": WantedMcap, "sqlite3": WantedSqlite})


class _Bag(Reader):
    # Of a file alone the counts are asked for, and only the library's reader has them.
    STORAGE_PLUGINS = MappingProxyType({"dir": _Folder, ".mcap": WantedMcap, ".db3": Sqlite3Reader})


def any_reader(path: Path) -> AnyReader:
    """Return a reader of a rosbag2 folder or storage file, not yet open.

    Raises:
        Exception: of the library; no such bag, or of another kind.
    """
    reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
    reader.readers = [_Bag(path)]
    return reader


def number_of_files(reader: AnyReader) -> int:
    """Return how many storage files an open reader reads."""
    return sum(
        len(one.storage.storages) if isinstance(one.storage, DirectoryReader) else 1
        for one in reader.readers
        if isinstance(one, Reader)
    )
