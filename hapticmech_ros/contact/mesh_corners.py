# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Finds corners of the convex hull of a mesh in a file; runs in the child process that reads it.

It loads little, as each start of a node with meshes waits for it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import coal
import numpy as np
from scipy.spatial import ConvexHull, QhullError

MOST_VERTICES = 2000


def corners_of(item: Mapping[str, Any]) -> dict[str, Any]:
    """Return the corners of a file's hull, or the rule that the file breaks; runs in the child."""
    try:
        loaded = coal.MeshLoader().load(item["file"], np.array(item["scale"]))
        points = np.unique(np.array(loaded.vertices()), axis=0)
    except (RuntimeError, ValueError) as error:
        reason = " ".join(str(error).partition("message:")[2].split()) or str(error)
        return {"rule": f"cannot be read as a mesh: {reason}"}
    if not np.isfinite(points).all():
        return {"rule": "cannot be read as a mesh: a vertex is not finite"}
    try:
        corners = ConvexHull(points).vertices
    except (QhullError, ValueError, IndexError):
        return {"rule": "the mesh must not be flat"}
    if len(corners) > MOST_VERTICES:
        rule = f"the hull must have at most {MOST_VERTICES} corners, not {len(corners)}"
        return {"rule": rule}
    return {"corners": points[corners].tolist()}
