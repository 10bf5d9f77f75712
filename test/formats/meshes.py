# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
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


def _written(corners, triangles, between="\n"):
    return between.join(" ".join(str(x) for x in row) for row in (*corners, *triangles))


COUNTED = [(3, *triangle) for triangle in TRIANGLES]
COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="s"><float_array id="f" count="12">{corners}</float_array><technique_common>
<accessor source="#f" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>{triangles}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#w"/></scene></COLLADA>
"""
# The tetrahedron in other formats, by their suffix.
TEXTS = {
    "obj": "\n".join(
        [
            *(f"v {x} {y} {z}" for x, y, z in TETRAHEDRON),
            *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in TRIANGLES),
        ]
    ),
    "off": f"OFF\n4 4 0\n{_written(TETRAHEDRON, COUNTED)}\n",
    "dae": COLLADA.format(
        corners=_written(TETRAHEDRON, (), " "), triangles=_written((), TRIANGLES, " ")
    ),
}
