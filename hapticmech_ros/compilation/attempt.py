"""Whether it makes sense to build the library of kernels, and what is remembered of a failure.

A failure is forgotten once its cause may be gone: with another compiler, interpreter or Numba, and
after a while in any case. What comes and goes by itself, such as a full disk, is not remembered.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import sysconfig
import time
from collections.abc import Iterator
from pathlib import Path

# What a build takes at most, on the disk of temporary files and where the library is kept.
ROOM_BYTES = 64 << 20
# How long a failure counts: what a machine was too busy for, and what the compiler refused.
BUSY_S = 600.0
REFUSED_S = 86400.0
# What compilers and linkers say when it was the disk.
_DISK = ("No space left on device", "Disk quota exceeded", "File too large", "Errno 28]")


def obstacle(folder: Path) -> str:
    """Return what is missing for a build: compiler, headers or room; nothing if all is there."""
    compiler = _compiler()
    if shutil.which(compiler) is None:
        return f"there is no C compiler ({compiler})"
    # Not at every start.
    import tempfile

    header = Path(sysconfig.get_path("include")) / "Python.h"
    if not header.exists():
        return f"Python's headers are missing ({header})"
    for place in (folder, Path(tempfile.gettempdir())):
        free = shutil.disk_usage(_existing(place)).free
        if free < ROOM_BYTES:
            return f"{place} has {free >> 20} MB left of {ROOM_BYTES >> 20} MB that a build takes"
    return ""


def remember(mark: Path, reason: str, counts_s: float) -> bool:
    """Write down why a build failed, unless its cause passes; return whether that was done.

    Args:
        mark: where.
        reason: what the builder said.
        counts_s: s, after which it is tried again in any case.
    """
    if any(words in reason for words in _DISK):
        return False
    told = {"reason": reason, "time": time.time(), "counts_s": counts_s, "with": _tools()}
    try:
        mark.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    except OSError:
        # A disk that is full is not remembered: nor is it here.
        return False
    return True


def remembered(mark: Path) -> bool:
    """Return whether a build has failed, and would fail again for all that is known."""
    try:
        told = json.loads(mark.read_text(encoding="utf-8"))
        # Also a clock that was put back forgets.
        fresh = 0.0 <= time.time() - float(told["time"]) < float(told["counts_s"])
        return bool(fresh and told["with"] == _tools())
    except (OSError, KeyError, TypeError, ValueError, RecursionError):
        return False


def _tools() -> dict[str, str]:
    """Return what a build is done with, so far as that can be told in a millisecond."""
    return dict(_tools_one_by_one())


def _tools_one_by_one() -> Iterator[tuple[str, str]]:
    # Not at every start.
    import importlib.metadata

    yield "python", sys.version
    yield "headers", sysconfig.get_path("include")
    for package in ("numba", "llvmlite", "numpy"):
        try:
            yield package, importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            yield package, ""
    found = shutil.which(_compiler())
    if found is not None:
        status = Path(found).stat()
        yield "compiler", f"{Path(found).resolve()} {status.st_size} {status.st_mtime_ns}"


def _compiler() -> str:
    words = (os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc").split()
    return str(words[0]) if words else "cc"


def _existing(place: Path) -> Path:
    """Return a folder, or the next above it that exists."""
    return next((one for one in (place, *place.parents) if one.exists()), Path("/"))
