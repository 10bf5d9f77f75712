# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where compiled kernels are kept: one folder per content of the kernels' files.

Numba itself would not notice a change of a function in another file that a kernel calls. Loaded
code runs with the user's permissions: folder and file belong to this user or to root, and no other
user may write to them. A file is moved to its place when it is whole and on disk.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
from pathlib import Path

_PACKAGE = Path(__file__).parent.parent
# Readable by all users, writable by its own only, with any umask.
FOLDER_MODE = 0o755
_DIGEST_SIZE = 32
# All files whose functions or constants become part of a kernel.
_SOURCES = (
    "compilation/arrays.py",
    "compilation/builder.py",
    "compilation/decorators.py",
    "compilation/inner_functions.py",
    "compilation/numba_types.py",
    "compilation/records.py",
    "compilation/structures.py",
    "numerics/layout.py",
    "mechanism/tolerances.py",
    "numerics/small_matrices.py",
    "mechanism/kernels/many_rows.py",
    "mechanism/kernels/model.py",
    "mechanism/kernels/tree_kernels.py",
    "mechanism/kernels/manifold_kernels.py",
    "mechanism/kernels/articulated_kernels.py",
    "mechanism/kernels/band_kernels.py",
    "mechanism/kernels/closure_kernels.py",
    "mechanism/kernels/metric_kernels.py",
    "mechanism/kernels/factor_kernels.py",
    "mechanism/kernels/element_kernels.py",
    "mechanism/kernels/motion_kernels.py",
    "mechanism/kernels/step_kernels.py",
    "mechanism/kernels/settle_kernels.py",
    "mechanism/kernels/energy_kernels.py",
    "mechanism/kernels/run_kernels.py",
    "mechanism/schemes.py",
    "contact/layout.py",
    "contact/touch_kernels.py",
    "contact/impact_kernels.py",
    "contact/solver_kernels.py",
    "contact/step_kernels.py",
    "numerics/saturation.py",
    "operational/observe_kernels.py",
    "numerics/rotation_kernels.py",
    "device/hand_kernels.py",
    "device/motion_kernels.py",
    "device/kernels.py",
    "device/safety_kernels.py",
    "control/kernels.py",
    "control/loop_layout.py",
    "control/account_kernels.py",
    "control/device_side_kernels.py",
    "control/other_hands_kernels.py",
    "session/tick_kernels.py",
    "wire/messages.py",
    "wire/kernels.py",
    "nodes/lane_kernels.py",
    "nodes/analysis_kernels.py",
    "nodes/control_kernels.py",
    "nodes/device_kernels.py",
    "nodes/mechanism_kernels.py",
)


def folder() -> Path:
    """Return the folder of the kernels as they are now.

    It is below ``NUMBA_CACHE_DIR``, or ``hapticmech_ros`` in the user's cache folder.

    Raises:
        OSError: the user has no home, as one whom the system has no name for.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    cache = os.environ.get("XDG_CACHE_HOME") or (None if chosen else home() / ".cache")
    root = Path(chosen) if chosen else Path(str(cache)) / "hapticmech_ros"
    return root / f"kernels-{FINGERPRINT}"


def _fingerprint() -> str:
    contents = b"".join((_PACKAGE / name).read_bytes() for name in _SOURCES)
    return hashlib.sha256(contents).hexdigest()[:16]


FINGERPRINT = _fingerprint()
TAG = sys.implementation.cache_tag or "python"
# In a library: of which kernels it is, and for which Python.
IDENTITY = f"{FINGERPRINT} {TAG}".encode()


def warn(sentence: str) -> None:
    """Print to standard error, as kernels are loaded on import, before logging is set up."""
    sys.stderr.write(f"hapticmech_ros: {sentence}\n")
    sys.stderr.flush()


def home() -> Path:
    """Return the user's home.

    Raises:
        OSError: there is none: neither from HOME, nor from the system's list of users.
    """
    try:
        return Path("~").expanduser()
    except RuntimeError:
        rule = "set XDG_CACHE_HOME to a folder that it can write"
        raise OSError(f"user {os.geteuid()} has no home: {rule}") from None


def is_own(folder: Path) -> bool:
    """Make a folder, and return whether only its user can write it; a warning names the fault.

    Raises:
        OSError: it cannot be made.
    """
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.mkdir(FOLDER_MODE, exist_ok=True)
    found = folder.lstat()
    fault = _fault(found) if stat.S_ISDIR(found.st_mode) else "is no folder, but a link to one"
    if fault:
        warn(
            f"{folder} {fault}: kernels are neither loaded from nor kept in it; correct this, or "
            "set NUMBA_CACHE_DIR to another folder"
        )
    return not fault


def read_own(path: Path) -> bytes:
    """Return the content written by :func:`put_in_place`, where only this user or root can write.

    Raises:
        FileNotFoundError: there is none.
        OSError: it is another's, writable by others, a link, or no file; damaged, or of another
            place.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        fault = _fault(found) if stat.S_ISREG(found.st_mode) else "is no regular file"
        if fault:
            raise OSError(fault)
        digest, content = file.read(_DIGEST_SIZE), file.read()
    if digest != _digest(path, content):
        raise OSError("is damaged, or of other kernels")
    return content


def put_in_place(content: bytes, path: Path, beside: Path) -> None:
    """Write a file beside its place, and move it there when it is whole and on disk.

    Raises:
        OSError: a full disk, for instance; the file at its place is unchanged.
    """
    try:
        with beside.open("wb") as file:
            os.fchmod(file.fileno(), FOLDER_MODE)
            file.write(_digest(path, content) + content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def _digest(path: Path, content: bytes) -> bytes:
    """Return the beginning of a file: a digest of its content and its place."""
    return hashlib.sha256(f"{path.parent.name}/{path.name}\n".encode() + content).digest()


def _fault(found: os.stat_result) -> str:
    """Return the fault in owner or mode of a file or folder; empty without one."""
    if found.st_uid not in (os.geteuid(), 0):
        return f"belongs to user {found.st_uid}, not to {os.geteuid()} or root"
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"can be written by others (mode {stat.S_IMODE(found.st_mode):04o})"
    return ""
