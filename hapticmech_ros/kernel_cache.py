"""Where compiled kernels are kept, and compiling them ahead of time. Does not import Numba itself.

One folder per content of the kernels' files: Numba itself would not see that a function called by a
kernel from another file has changed.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

# A slow machine takes a minute.
COMPILE_TIMEOUT_S = 300.0
_PACKAGE = Path(__file__).parent
# All files whose functions or constants become part of a kernel.
_SOURCES = (
    "compilation.py",
    "mechanism/constraint_space.py",
    "mechanism/small_matrices.py",
    "saturation_kernels.py",
    "mechanism/tables.py",
    "mechanism/closure_kernels.py",
    "mechanism/kernels.py",
    "mechanism/element_kernels.py",
    "mechanism/motion_kernels.py",
    "mechanism/implicit.py",
    "mechanism/projection.py",
    "mechanism/step_kernels.py",
    "mechanism/implicit_kernels.py",
    "mechanism/settle_kernels.py",
    "operational/kernels.py",
    "operational/point_kernels.py",
    "rotation_kernels.py",
    "device/hand.py",
    "device/hand_kernels.py",
    "device/kernels.py",
    "control/flat.py",
    "control/pose_kernels.py",
    "control/kernels.py",
    "wire/kernels.py",
)
# Imports every kernel.
_ALL = (
    "import hapticmech_ros.mechanism.compiled_stepping, hapticmech_ros.operational.compiled,"
    " hapticmech_ros.control.compiled, hapticmech_ros.device.compiled, hapticmech_ros.wire.readings"
)


def folder(chosen: str = "") -> Path:
    """Return the folder of the kernels as they are now, below ``chosen`` or the user's cache."""
    if chosen:
        root = Path(chosen)
    else:
        cache = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
        root = Path(cache) / "hapticmech_ros"
    return root / f"kernels-{_FINGERPRINT}"


def compile_ahead() -> None:
    """Compile all kernels, unless that was done before; takes some ten seconds.

    Nodes that start together would otherwise each do so, and keep the others waiting.
    """
    # Numba keeps apart what is for another interpreter, or another place of the package.
    place = hashlib.sha256(f"{sys.executable}{_PACKAGE}".encode()).hexdigest()[:16]
    done = folder(os.environ.get("NUMBA_CACHE_DIR", "")) / f"compiled-{place}"
    if done.exists():
        return
    command = [sys.executable, "-c", _ALL]
    try:
        compiled = subprocess.run(
            command, check=False, stdin=subprocess.DEVNULL, timeout=COMPILE_TIMEOUT_S
        )
    except subprocess.TimeoutExpired:
        # Each process then compiles for itself what it needs.
        return
    if compiled.returncode == 0 and done.parent.is_dir():
        done.touch()


def _fingerprint() -> str:
    contents = b"".join((_PACKAGE / name).read_bytes() for name in _SOURCES)
    return hashlib.sha256(contents).hexdigest()[:16]


_FINGERPRINT = _fingerprint()
