# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Opens a path only if it is a regular file of bounded size, and never blocks.

Reading a device never ends, a pipe may block, and either can be in a file's place: every file from
others is opened here. The package's own files are in the source tree, or in the share folder of a
prefix.
"""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from hapticmech_ros.errors import FileError

# Bytes of a file of ROS parameters; those that are shipped have some hundreds.
PARAMETER_FILE_LIMIT = 1_000_000


def open_file(path: str | os.PathLike[str], limit: int | None = None) -> BinaryIO:
    """Return a regular file, open for reading.

    Args:
        path: of the file.
        limit: most bytes that it may have; None for any number.

    Raises:
        FileError: not there, not readable, no regular file, or too large.
    """
    name = os.fspath(path)
    try:
        # Checked first: merely opening a device can have effects. Non-blocking: a pipe may have
        # taken its place since.
        _check(name, os.stat(name), limit)  # noqa: PTH116 - Path.stat() is a name more to refuse
        descriptor = os.open(name, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise FileError(name, _reason(error), "cannot be read") from None
    try:
        _check(name, os.fstat(descriptor), limit)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_file(path: str | os.PathLike[str], limit: int) -> bytes:
    """Return the contents of a regular file of at most ``limit`` bytes.

    Raises:
        FileError: see :func:`open_file`.
    """
    with open_file(path, limit) as file:
        try:
            # It may have grown since, and files of the kernel have size 0.
            data = file.read(limit + 1)
        except OSError as error:
            raise FileError(os.fspath(path), _reason(error), "cannot be read") from None
    if len(data) > limit:
        raise FileError(os.fspath(path), len(data), f"must have at most {limit} bytes")
    return data


def read_text(path: str | os.PathLike[str], limit: int) -> str:
    """Return the text, UTF-8, of a regular file of at most ``limit`` bytes.

    Raises:
        FileError: see :func:`open_file`; or not UTF-8.
    """
    try:
        return read_file(path, limit).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileError(os.fspath(path), str(error), "cannot be read") from None


def check_file(path: str | os.PathLike[str], limit: int | None = None) -> int:
    """Return the size in bytes of a file that :func:`open_file` would open.

    For libraries that open files themselves.

    Raises:
        FileError: see :func:`open_file`.
    """
    with open_file(path, limit) as file:
        return os.fstat(file.fileno()).st_size


def exists(path: str | os.PathLike[str]) -> bool:
    """Return whether anything is there; a name that cannot be one (too long) names nothing."""
    return _holds(Path.exists, path)


def is_file(path: str | os.PathLike[str]) -> bool:
    """Return whether a regular file is there; a name that cannot be one (too long) names none."""
    return _holds(Path.is_file, path)


def _holds(question: Callable[[Path], bool], path: str | os.PathLike[str]) -> bool:
    try:
        return question(Path(path))
    except (OSError, ValueError):
        return False


def _check(name: str, found: os.stat_result, limit: int | None) -> None:
    if not stat.S_ISREG(found.st_mode):
        raise FileError(name, name, "must be a regular file")
    if limit is not None and found.st_size > limit:
        raise FileError(name, found.st_size, f"must have at most {limit} bytes")


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


PACKAGE = "hapticmech_ros"


def shared(relative: str) -> Path | None:
    """Return the first existing ``relative`` file or folder of the package's data, or None."""
    candidates = (folder / relative for folder in _folders())
    return next((one for one in candidates if one.exists()), None)


def _folders() -> Iterator[Path]:
    here = Path(__file__).resolve()
    # The source tree: the package's folder stands beside config/.
    yield here.parents[2]
    # Installed, lib/pythonX.Y/site-packages/hapticmech_ros/: the prefix is a few levels up.
    for parent in here.parents[3:7]:
        yield parent / "share" / PACKAGE
    yield Path(sys.prefix) / "share" / PACKAGE
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix) / "share" / PACKAGE
