# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where processes of one user on one host find each other: a folder of sockets, theirs alone.

Processes that the middleware keeps apart have different folders: what tells them apart there (the
domain, the network namespace, the middleware and its settings) makes the folder's name.
"""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path

from hapticmech_ros.errors import HapticMechError

# What decides whom the middleware finds, besides the network that the process is in.
SETTINGS = (
    *("RMW_IMPLEMENTATION", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS"),
    *("ROS_LOCALHOST_ONLY", "ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT"),
    *("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE", "CYCLONEDDS_URI"),
)
DOMAIN = "ROS_DOMAIN_ID"
SECURED = "ROS_SECURITY_ENABLE"


class LaneError(HapticMechError):
    """The lane between processes cannot be had; messages go through the middleware."""


def lane_folder(environment: Mapping[str, str]) -> Path:
    """Return the folder of this environment's graphs, and make it if it is not there.

    It is in ``XDG_RUNTIME_DIR``, or else in the folder for temporary files.

    Raises:
        LaneError: it cannot be made, others could write into it, or permissions of DDS security
            are to be kept, which only the middleware knows.
    """
    if environment.get(SECURED, "").lower() == "true":
        raise LaneError(f"{SECURED} is true: only the middleware keeps to its permissions")
    user = os.geteuid()
    runtime = environment.get("XDG_RUNTIME_DIR", "")
    above = Path(runtime if _is_private(runtime) else tempfile.gettempdir())
    return _private(_private(above / f"hapticmech_ros-{user}") / _name(environment))


def _name(environment: Mapping[str, str]) -> str:
    """Return a name short enough for a socket's path, the same for those who can meet."""
    settings = [f"{name}={environment.get(name, '')}" for name in SETTINGS]
    found = Path("/proc/self/ns/net")
    network = str(found.readlink()) if found.exists() else ""
    told = hashlib.sha256("\n".join([network, *settings]).encode()).hexdigest()
    domain = environment.get(DOMAIN, "").strip() or "0"
    return f"{hashlib.sha256(domain.encode()).hexdigest()[:6]}{told[:10]}"


def _private(folder: Path) -> Path:
    """Make a folder unless it is there, and return it.

    Raises:
        LaneError: it cannot be made, or is not this user's alone.
        FileNotFoundError: it was removed in between.
    """
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError as error:
        raise LaneError(f"{folder}: {error.strerror}") from None
    if not folder.exists():
        raise FileNotFoundError(folder)
    if not _is_private(str(folder)):
        raise LaneError(f"{folder}: must be a folder of mode 0700 of this user")
    return folder


def _is_private(folder: str) -> bool:
    """Return whether a folder, which is no link, is this user's and nobody else's."""
    try:
        found = os.lstat(folder)
    except OSError:
        return False
    others = stat.S_IMODE(found.st_mode) & 0o077
    return stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid() and not others
