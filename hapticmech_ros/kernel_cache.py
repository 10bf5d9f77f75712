"""Where compiled kernels are kept: one folder per content of the kernels' files.

Numba itself would not see that a function called by a kernel from another file has changed.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

_PACKAGE = Path(__file__).parent
# All files whose functions or constants become part of a kernel.
_SOURCES = (
    "compilation.py",
    "kernel_builder.py",
    "mechanism/constraint_space.py",
    "mechanism/small_matrices.py",
    "mechanism/many_rows.py",
    "saturation_kernels.py",
    "mechanism/tables.py",
    "mechanism/closure_kernels.py",
    "mechanism/packed.py",
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


def folder() -> Path:
    """Return the folder of the kernels as they are now.

    It is below ``NUMBA_CACHE_DIR``, or ``hapticmech_ros`` in the user's cache folder.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    cache = os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()
    root = Path(chosen) if chosen else Path(cache) / "hapticmech_ros"
    return root / f"kernels-{_FINGERPRINT}"


def _fingerprint() -> str:
    contents = b"".join((_PACKAGE / name).read_bytes() for name in _SOURCES)
    return hashlib.sha256(contents).hexdigest()[:16]


_FINGERPRINT = _fingerprint()
