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

_PACKAGE = Path(__file__).parent
# All files whose functions or constants become part of a kernel.
_SOURCES = (
    "compilation.py",
    "mechanism/constraint_space.py",
    "mechanism/small_matrices.py",
    "mechanism/closure_kernels.py",
    "mechanism/kernels.py",
    "mechanism/motion_kernels.py",
    "operational/kernels.py",
)
# Imports every kernel.
_ALL = "import hapticmech_ros.operational.compiled"


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
    compiled = subprocess.run([sys.executable, "-c", _ALL], check=False, stdin=subprocess.DEVNULL)
    if compiled.returncode == 0 and done.parent.is_dir():
        done.touch()


def _fingerprint() -> str:
    contents = b"".join((_PACKAGE / name).read_bytes() for name in _SOURCES)
    return hashlib.sha256(contents).hexdigest()[:16]


_FINGERPRINT = _fingerprint()
