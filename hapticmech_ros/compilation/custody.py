# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Who else may write where kernels are kept: what is loaded runs with all that its user may do.

The rules are those of ssh's StrictModes. A folder, or a file in it, belongs to this user or to
root, and nobody else may write to it. The folders above, up to the user's home, may be root's or
this user's, and writable by others only where their sticky bit keeps names safe, as in ``/tmp``;
there a group that has no other member counts as its user.

A file that is used is sealed: it is whole, by whom it should be, and unchanged. Beside it stands
its seal, a few lines of JSON: size, SHA-256, and what it was made from. What is looked at and what
is used are the same bytes, so that nobody can put others in between.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import shutil
import stat
import sys
from collections.abc import Mapping
from pathlib import Path

from hapticmech_ros.errors import HapticMechError

# Read and run by everybody, written by its user alone.
FOLDER_MODE = 0o755
_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def warn(sentence: str) -> None:
    """Tell a person, also where no logging is set up yet: kernels are loaded on import."""
    sys.stderr.write(f"hapticmech_ros: {sentence}\n")
    sys.stderr.flush()


def home() -> Path:
    """Return the user's home.

    Raises:
        OSError: there is none: neither HOME says so, nor has the system a name for this user.
    """
    try:
        return Path("~").expanduser()
    except RuntimeError:
        rule = "set XDG_CACHE_HOME to a folder that it can write"
        raise OSError(f"user {os.geteuid()} has no home: {rule}") from None


def fault_of_owner(found: os.stat_result) -> str:
    """Return what is wrong with owner or mode of a file or folder; nothing if all is well."""
    if found.st_uid not in (os.geteuid(), 0):
        return f"belongs to user {found.st_uid}, not to {os.geteuid()} or root"
    if found.st_mode & _OTHERS_WRITE:
        return f"can be written by others (mode {stat.S_IMODE(found.st_mode):04o})"
    return ""


@functools.cache
def is_safe(folder: Path) -> bool:
    """Make a folder that only its user can write, and return whether it is one; looks once.

    Where others could have written into this user's own folder, what is in it is given up: the
    folder begins anew, empty. What cannot be mended is told.

    Raises:
        OSError: it cannot be made.
    """
    fault = _fault_above(folder)
    if not fault:
        # While this one looked, another process may have put a new one in its place: look again.
        for _ in range(2):
            _make(folder)
            found = folder.lstat()
            fault = fault_of_owner(found)
            if not stat.S_ISDIR(found.st_mode):
                fault = "is no folder of its own, but a link or a file"
            elif fault and found.st_uid == os.geteuid():
                warn(f"{folder} {fault}: what is in it is not trusted, and made anew")
                _give_up(folder)
                continue
            break
        fault = f"{folder} {fault}" if fault else ""
    if fault:
        warn(
            f"{fault}: no kernels are loaded from {folder}, nor kept there; mend that, or name "
            "another folder by NUMBA_CACHE_DIR"
        )
    return not fault


def _fault_above(folder: Path) -> str:
    """Return which of the folders above is open to others, and why."""
    parent = folder.parent.resolve()
    try:
        own = home().resolve()
    except OSError:
        own = Path("/")
    for above in (parent, *parent.parents):
        try:
            found = above.stat()
        except FileNotFoundError:
            continue
        shared = found.st_mode & stat.S_IWOTH or (
            found.st_mode & stat.S_IWGRP and not _is_private(found.st_gid)
        )
        if shared and not found.st_mode & stat.S_ISVTX:
            return f"{above} can be written by others (mode {stat.S_IMODE(found.st_mode):04o})"
        if found.st_uid not in (os.geteuid(), 0):
            return f"{above} belongs to user {found.st_uid}, not to {os.geteuid()} or root"
        if above == own:
            # As ssh does: what is above a home is the machine's.
            break
    return ""


def _is_private(group: int) -> bool:
    """Return whether a group has this user's name, and nobody else in it."""
    import grp
    import pwd

    try:
        name = pwd.getpwuid(os.geteuid()).pw_name
        found = grp.getgrgid(group)
    except KeyError:
        return False
    return found.gr_name == name and set(found.gr_mem) <= {name}


def _make(folder: Path) -> None:
    """Make a folder and those above it, whatever the umask, unless they are there."""
    for one in reversed([folder, *folder.parents]):
        with contextlib.suppress(FileExistsError):
            if not one.exists():
                one.mkdir(FOLDER_MODE)


def _give_up(folder: Path) -> None:
    """Take a folder out of the way at once, then remove it."""
    aside = folder.with_name(f"{folder.name}.refused-{os.getpid()}")
    with contextlib.suppress(FileNotFoundError):
        folder.rename(aside)
    shutil.rmtree(aside, ignore_errors=True)


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
