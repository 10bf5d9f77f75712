# Copyright 2026 The hapticmech_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Convex polytopes: vertices and flat faces, of boxes and of hulls of points.

Convex hulls of meshes in files, which a child process with limits reads, and their triangles.

The files are not trusted, the library that reads them does not check them, and they may have
millions of vertices: only the corners of a hull are returned, and for pictures so many triangles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hapticmech_ros.contact.mesh_corners import corners_of, surface_of
from hapticmech_ros.errors import FileError, SceneError, SceneProblem
from hapticmech_ros.files import check_file
from hapticmech_ros.files.cage import CageError, Limits, caged
from hapticmech_ros.numerics import Array
from hapticmech_ros.scene.contacts import Mesh, Shape
from hapticmech_ros.scene.rules import MESH_SIZE_LIMIT

# Bytes of memory for any file and for each byte of it; bytes that are read in a second.
MEMORY, MEMORY_PER_BYTE = 256_000_000, 32
SECONDS, BYTES_PER_SECOND = 2, 4_000_000
# Of a hull's corners as text, and of a drawn mesh.
OUTPUT, OUTPUT_DRAWN = 400_000, 8_000_000
# How many hulls are remembered: a scene is built more than once in a process.
_REMEMBERED = 64


class _Key(NamedTuple):
    """Source of a hull: a file's present version, and a scale."""

    file: str
    changed_ns: int
    bytes: int
    scale: tuple[float, float, float]


_hulls: dict[_Key, Polytope] = {}


def mesh_hulls(shapes: Sequence[Shape]) -> dict[int, Polytope]:
    """Return the hulls of those shapes that are meshes, by their places in ``shapes``.

    All files that this process has not read yet are read by one child.

    Raises:
        SceneError: a file cannot be read within the limits, or holds no body, or too many corners.
    """
    keys = {
        index: _key(shape.geometry, _place(index))
        for index, shape in enumerate(shapes)
        if isinstance(shape.geometry, Mesh)
    }
    new = {key: index for index, key in keys.items() if key not in _hulls}
    if new:
        _read(list(new), [_place(index) for index in new.values()])
    found = {index: _hulls[key] for index, key in keys.items()}
    while len(_hulls) > max(_REMEMBERED, len(found)):
        del _hulls[next(iter(_hulls))]
    return found


def read_mesh(file: str, scale: tuple[float, float, float], key: str) -> Polytope:
    """Return the convex hull of a mesh in a file.

    Args:
        file: path.
        scale: of its coordinates.
        key: of the scene that names the file, for errors.

    Raises:
        SceneError: see :func:`mesh_hulls`.
    """
    one = _key(Mesh(kind="mesh", file=file, scale=scale), key)
    if one not in _hulls:
        _read([one], [key])
    return _hulls[one]


# Of a body that is drawn: (n, 3) corners, m, and (t, 3) triangles as indices of these.
Surface = tuple[Array, Array]
_surfaces: dict[_Key, Surface] = {}


def drawn_meshes(meshes: Sequence[Mesh]) -> list[Surface | None]:
    """Return meshes that are drawn alone; None of those that cannot be read.

    Of large ones they are coarser forms, of the largest the hulls: see ``mesh_corners``.

    Args:
        meshes: in files that may be missing, or no meshes.
    """
    keys: list[_Key | None] = []
    for index, mesh in enumerate(meshes):
        try:
            keys.append(_key(mesh, _place(index)))
        except SceneError:
            keys.append(None)
    new = list(dict.fromkeys(key for key in keys if key is not None and key not in _surfaces))
    try:
        _read_surfaces(new)
    except SceneError:  # one by one, as the others can be read
        for key in new:
            with suppress(SceneError):
                _read_surfaces([key])
    found = [None if key is None else _surfaces.get(key) for key in keys]
    while len(_surfaces) > max(_REMEMBERED, len(found)):
        del _surfaces[next(iter(_surfaces))]
    return found


def _place(index: int) -> str:
    return f"shapes[{index}].geometry.file"


def _key(mesh: Mesh, place: str) -> _Key:
    try:
        size = check_file(mesh.file, MESH_SIZE_LIMIT)
        return _Key(mesh.file, Path(mesh.file).stat().st_mtime_ns, size, mesh.scale)
    except FileError as error:
        raise _refused(place, mesh.file, error.rule) from None
    except OSError as error:
        raise _refused(place, mesh.file, str(error)) from None


def _read(keys: Sequence[_Key], places: Sequence[str]) -> None:
    """Read the hulls of files, and remember them."""
    answers = _answers(keys, places, corners_of, OUTPUT)
    for key, place, answer in zip(keys, places, answers, strict=True):
        points: Array = np.array(answer["corners"], dtype=float)
        try:
            _hulls[key] = hull(points)
        except (QhullError, ValueError, IndexError):
            raise _refused(place, key.file, "the mesh must not be flat") from None


def _read_surfaces(keys: Sequence[_Key]) -> None:
    """Read files to be drawn, and remember them."""
    answers = _answers(keys, [key.file for key in keys], surface_of, OUTPUT_DRAWN)
    for key, answer in zip(keys, answers, strict=True):
        corners: Array = np.array(answer["corners"], dtype=float)
        if "triangles" in answer:
            _surfaces[key] = corners, np.array(answer["triangles"], dtype=int)
        else:
            body = hull(corners)
            _surfaces[key] = body.vertices, body.triangles


def _answers(
    keys: Sequence[_Key],
    places: Sequence[str],
    work: Callable[[Any], dict[str, Any]],
    output: int,
) -> Iterator[dict[str, Any]]:
    """Yield what a child answers of files; ``output`` is the size (bytes) of one as text.

    Raises:
        SceneError: of the first file that cannot be read.
    """
    if not keys:
        return
    size = sum(key.bytes for key in keys)
    largest = max(key.bytes for key in keys)
    limits = Limits(
        MEMORY + MEMORY_PER_BYTE * largest,
        SECONDS + len(keys) // 10 + size // BYTES_PER_SECOND,
        output * len(keys),
    )
    items = [{"file": key.file, "scale": key.scale} for key in keys]
    try:
        answers = caged(work, items, limits)
    except CageError as error:
        number = len(error.done)
        rule = f"cannot be read as a mesh: it {error.rule}"
        raise _refused(places[number], keys[number].file, rule) from None
    for key, place, answer in zip(keys, places, answers, strict=True):
        if "rule" in answer:
            raise _refused(place, key.file, str(answer["rule"]))
        yield answer


def _refused(key: str, file: str, rule: str) -> SceneError:
    return SceneError("shapes", [SceneProblem(key, file, rule)])


# Triangles whose normals differ by less are one face.
FLAT = 1e-6


class Polytope(NamedTuple):
    """A convex body.

    Attributes:
        vertices: (n, 3) m.
        faces: indices of the corners of each, in order around its outward normal.
        normals: (f, 3) outward unit normals.
        triangles: (t, 3) indices of corners, in order around the outward normal.
    """

    vertices: Array
    faces: tuple[tuple[int, ...], ...]
    normals: Array
    triangles: Array


def box(size: tuple[float, float, float]) -> Polytope:
    """Return a box about the origin, lengths in m."""
    return hull(np.array(list(product((-0.5, 0.5), repeat=3))) * np.array(size))


def hull(points: Array) -> Polytope:
    """Return the convex hull of points, in their axes.

    Args:
        points: (n, 3) m.

    Raises:
        QhullError: all of them are in one plane.
    """
    found = ConvexHull(points)
    kept = np.sort(found.vertices)
    place = {int(old): new for new, old in enumerate(kept)}
    vertices = np.ascontiguousarray(points[kept], dtype=float)
    triangles = [[place[int(corner)] for corner in simplex] for simplex in found.simplices]
    merged = _merged(found, place)
    normals = np.array([_unit(normal) for normal, _ in merged])
    faces = tuple(_around(vertices, members, normal) for normal, members in merged)
    outwards = [
        _turned(vertices, corners, normal)
        for corners, normal in zip(triangles, found.equations[:, :3], strict=True)
    ]
    return Polytope(vertices, faces, normals, np.array(outwards))


def _merged(found: ConvexHull, place: dict[int, int]) -> list[tuple[Array, set[int]]]:
    """Return normals and corners of faces: triangles beside each other with one normal are one."""
    normals = found.equations[:, :3]
    seen = np.zeros(len(normals), dtype=bool)
    faces: list[tuple[Array, set[int]]] = []
    for first in range(len(normals)):
        if seen[first]:
            continue
        seen[first] = True
        members: set[int] = set()
        waiting = [first]
        while waiting:
            one = waiting.pop()
            members |= {place[int(corner)] for corner in found.simplices[one]}
            for other in found.neighbors[one].tolist():
                if not seen[other] and np.linalg.norm(normals[other] - normals[first]) < FLAT:
                    seen[other] = True
                    waiting.append(other)
        faces.append((normals[first], members))
    return faces


def _around(vertices: Array, members: set[int], normal: Array) -> tuple[int, ...]:
    """Return corners of a face in order around its normal, beginning with the first."""
    corners = sorted(members)
    middle = vertices[corners].mean(axis=0)
    first = vertices[corners[0]] - middle
    second = np.cross(normal, first)
    away = vertices[corners] - middle
    angles = np.arctan2(away @ second, away @ first)
    order = sorted(range(len(corners)), key=lambda k: float(angles[k]) % (2.0 * np.pi))
    return tuple(corners[k] for k in order)


def _turned(vertices: Array, corners: list[int], normal: Array) -> list[int]:
    """Return a triangle whose corners go around its outward normal."""
    a, b, c = vertices[corners]
    return corners if np.cross(b - a, c - a) @ normal > 0.0 else corners[::-1]


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
