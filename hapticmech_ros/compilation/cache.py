"""Where compiled kernels are kept: one folder per content of the kernels' files.

Numba itself would not see that a function called by a kernel from another file has changed.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

_PACKAGE = Path(__file__).parent.parent
# All files whose functions or constants become part of a kernel.
_SOURCES = (
    "compilation/arrays.py",
    "compilation/builder.py",
    "compilation/decorators.py",
    "compilation/numba_types.py",
    "compilation/structures.py",
    "layout.py",
    "mechanism/constraint_space.py",
    "mechanism/compiled/small_matrices.py",
    "mechanism/compiled/many_rows.py",
    "mechanism/compiled/tables.py",
    "mechanism/compiled/packed.py",
    "mechanism/compiled/pair_kernels.py",
    "mechanism/compiled/tree_kernels.py",
    "mechanism/compiled/manifold_kernels.py",
    "mechanism/compiled/articulated_kernels.py",
    "mechanism/compiled/band_kernels.py",
    "mechanism/compiled/closure_kernels.py",
    "mechanism/compiled/coupling_kernels.py",
    "mechanism/compiled/dense_kernels.py",
    "mechanism/compiled/metric_kernels.py",
    "mechanism/compiled/kernels.py",
    "mechanism/compiled/element_kernels.py",
    "mechanism/compiled/motion_kernels.py",
    "mechanism/compiled/step_kernels.py",
    "mechanism/compiled/implicit_kernels.py",
    "mechanism/compiled/settle_kernels.py",
    "mechanism/compiled/run_kernels.py",
    "mechanism/implicit.py",
    "mechanism/projection.py",
    "contact/layout.py",
    "contact/shape_kernels.py",
    "contact/clip_kernels.py",
    "contact/touch_kernels.py",
    "contact/near_kernels.py",
    "contact/rate_kernels.py",
    "contact/newton_kernels.py",
    "contact/solver_kernels.py",
    "contact/effect_kernels.py",
    "contact/step_kernels.py",
    "saturation_kernels.py",
    "operational/kernels.py",
    "operational/foresee_kernels.py",
    "operational/late_kernels.py",
    "operational/observe_kernels.py",
    "rotation_kernels.py",
    "device/grip.py",
    "device/hand_kernels.py",
    "device/resistance_kernels.py",
    "device/kernels.py",
    "device/safety_layout.py",
    "device/safety_kernels.py",
    "control/pose_kernels.py",
    "control/kernels.py",
    "control/loop_layout.py",
    "control/account_kernels.py",
    "control/device_side_kernels.py",
    "control/render_kernels.py",
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
