# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A file that is used only as it was written: whole, by whom it should be, and unchanged.

Beside it stands its seal, a few lines of JSON: size, SHA-256, and what it was made from. What is
looked at and what is used are the same bytes, so that nobody can put others in between.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Mapping
from pathlib import Path

from hapticmech_ros.compilation.custody import FOLDER_MODE, fault_of_owner
from hapticmech_ros.errors import HapticMechError

# Longer is no seal.
_LONGEST_SEAL = 4096


class BrokenSealError(HapticMechError):
    """A sealed file that is not what was written, or could have been written by others."""


def seal_of(path: Path) -> Path:
    """Return where the seal of a file is."""
    return path.with_name(f"{path.name}.seal")


def put_in_place(made: Path, path: Path, origin: Mapping[str, str]) -> None:
    """Seal a file that was made beside its place, and move it there, on disk before it is seen.

    Args:
        made: the file, in the folder of its place; it is gone afterwards.
        path: its place.
        origin: what it was made from.

    Raises:
        OSError: a full disk, for instance; at its place is what was there before.
    """
    with made.open("rb") as file:
        os.fchmod(file.fileno(), FOLDER_MODE)
        os.fsync(file.fileno())
        content = file.read()
        size, digest = len(content), hashlib.sha256(content).hexdigest()
    told = json.dumps({"size": size, "sha256": digest, "origin": dict(origin)}, indent=1)
    written = made.with_name(f"{made.name}.seal")
    try:
        with written.open("w", encoding="utf-8") as file:
            os.fchmod(file.fileno(), 0o644)
            file.write(told + "\n")
            file.flush()
            os.fsync(file.fileno())
        # The seal first: whoever comes between the two finds nothing yet, or what does not fit.
        written.replace(seal_of(path))
        made.replace(path)
    finally:
        written.unlink(missing_ok=True)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def read_sealed(path: Path, origin: Mapping[str, str]) -> bytes:
    """Return what is in a file that is as it was written.

    Args:
        path: the file.
        origin: what it must have been made from.

    Raises:
        FileNotFoundError: there is none.
        BrokenSealError: it is another's, writable by others, a link, truncated or changed.
    """
    with os.fdopen(_open_own(path), "rb") as file:
        size, digest, made_from = _seal(seal_of(path))
        content = file.read(size + 1)
        found = os.fstat(file.fileno()).st_size
    if found != size or len(content) != size:
        raise BrokenSealError(f"{path} has {found} bytes, not {size}")
    if made_from != dict(origin):
        raise BrokenSealError(f"{path} was made from {made_from}, not from {dict(origin)}")
    if hashlib.sha256(content).hexdigest() != digest:
        raise BrokenSealError(f"{path} has changed since it was written")
    return content


def _open_own(path: Path) -> int:
    """Return a descriptor of a regular file that only this user or root can write, to read it.

    Raises:
        FileNotFoundError: there is none.
        BrokenSealError: it is another's, writable by others, a link, or no file.
    """
    try:
        file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        raise
    except OSError as error:
        why = "is a symbolic link" if path.is_symlink() else f"cannot be read: {error.strerror}"
        raise BrokenSealError(f"{path} {why}") from None
    found = os.fstat(file)
    fault = fault_of_owner(found) if stat.S_ISREG(found.st_mode) else "is no regular file"
    if fault:
        os.close(file)
        raise BrokenSealError(f"{path} {fault}")
    return file


def _seal(path: Path) -> tuple[int, str, dict[str, str]]:
    try:
        file = _open_own(path)
    except FileNotFoundError:
        raise BrokenSealError(f"{path} is missing") from None
    try:
        told = json.loads(os.read(file, _LONGEST_SEAL))
        return int(told["size"]), str(told["sha256"]), dict(told["origin"])
    except (KeyError, TypeError, ValueError, RecursionError):
        raise BrokenSealError(f"{path} is no seal") from None
    finally:
        os.close(file)
