# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where compiled kernels are kept: one folder per content of the kernels' files.

Numba itself would not see that a function called by a kernel from another file has changed.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from hapticmech_ros.compilation.custody import home

_PACKAGE = Path(__file__).parent.parent
# All files whose functions or constants become part of a kernel.
_SOURCES = (
    "compilation/arrays.py",
    "compilation/builder.py",
    "compilation/decorators.py",
    "compilation/inner_functions.py",
    "compilation/numba_types.py",
    "compilation/structures.py",
    "layout.py",
    "mechanism/tolerances.py",
    "mechanism/kernels/small_matrices.py",
    "mechanism/kernels/many_rows.py",
    "mechanism/kernels/model.py",
    "mechanism/kernels/data.py",
    "mechanism/kernels/pair_kernels.py",
    "mechanism/kernels/tree_kernels.py",
    "mechanism/kernels/manifold_kernels.py",
    "mechanism/kernels/articulated_kernels.py",
    "mechanism/kernels/band_kernels.py",
    "mechanism/kernels/closure_kernels.py",
    "mechanism/kernels/dense_kernels.py",
    "mechanism/kernels/metric_kernels.py",
    "mechanism/kernels/factor_kernels.py",
    "mechanism/kernels/element_kernels.py",
    "mechanism/kernels/motion_kernels.py",
    "mechanism/kernels/step_kernels.py",
    "mechanism/kernels/step_layout.py",
    "mechanism/kernels/implicit_kernels.py",
    "mechanism/kernels/settle_kernels.py",
    "mechanism/kernels/energy_kernels.py",
    "mechanism/kernels/run_kernels.py",
    "mechanism/tableaus.py",
    "contact/layout.py",
    "contact/shape_kernels.py",
    "contact/touch_kernels.py",
    "contact/impact_kernels.py",
    "contact/solver_kernels.py",
    "contact/step_kernels.py",
    "saturation_kernels.py",
    "operational/kernels.py",
    "operational/delay_compensation_kernels.py",
    "operational/observe_kernels.py",
    "rotation_kernels.py",
    "device/device_layout.py",
    "device/hand_kernels.py",
    "device/motion_kernels.py",
    "device/kernels.py",
    "device/safety_kernels.py",
    "control/kernels.py",
    "control/loop_layout.py",
    "control/account_kernels.py",
    "control/device_side_kernels.py",
    "control/hand_lead_kernels.py",
    "control/render_kernels.py",
    "control/channel_kernels.py",
    "session/data.py",
    "session/tick_kernels.py",
    "wire/kernels.py",
    "nodes/watch_kernels.py",
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
    return root / f"kernels-{_FINGERPRINT}"


def _fingerprint() -> str:
    contents = b"".join((_PACKAGE / name).read_bytes() for name in _SOURCES)
    return hashlib.sha256(contents).hexdigest()[:16]


_FINGERPRINT = _fingerprint()
