"""Small meshes, written where tests need them."""

from __future__ import annotations

import numpy as np

TETRAHEDRON = np.array(((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)), dtype=float)
TRIANGLES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))


def stl(path, corners):
    """Write a tetrahedron with these corners (4, 3) as a binary STL file."""
    record = np.zeros(
        len(TRIANGLES),
        dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")],
    )
    record["corners"] = corners[np.array(TRIANGLES)]
    path.write_bytes(bytes(80) + np.uint32(len(record)).tobytes() + record.tobytes())
    return path
